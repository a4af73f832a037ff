"""Compiled inner loops of the univector field: one pose or a whole picture, the same code.

No angle is ever formed where a rotation of the unit vector does. Arrays and scalars only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def _towards(
    dx: float,
    dy: float,
    heading: float,
    goal_heading: float,
    oriented: bool,
    k_alpha: float,
    k_beta: float,
    near: float,
    ramp: bool,
    literal: bool,
) -> tuple[float, float]:
    """Eq. (8) at one place; (dx, dy) leads to the goal. Zero at the goal itself."""
    rho = math.sqrt(dx * dx + dy * dy)
    if rho < 1e-12:
        return 0.0, 0.0
    ux, uy = dx / rho, dy / rho
    inside = oriented and rho <= near
    if not inside:
        return (-ux, -uy) if literal else (ux, uy)
    if not literal and not ramp and k_alpha == 1.0 and k_beta == -1.0:
        # phi = 2 th_rd - th_tg: the square of u, turned back by th_tg
        c, s = math.cos(goal_heading), math.sin(goal_heading)
        a, b = ux * ux - uy * uy, 2.0 * ux * uy
        return a * c + b * s, b * c - a * s
    th_rd = math.atan2(uy, ux)
    two_pi = 2.0 * math.pi
    alpha = (th_rd - heading + math.pi) % two_pi - math.pi
    beta = (goal_heading - th_rd + math.pi) % two_pi - math.pi
    if literal:
        th_c = k_alpha * alpha + k_beta * beta
        return -math.cos(th_c), -math.sin(th_c)
    weight = k_beta * min(1.0, 2.0 * (1.0 - rho / near)) if ramp else k_beta
    phi = heading + k_alpha * alpha + weight * beta
    return math.cos(phi), math.sin(phi)


@njit(cache=True)
def _around(
    x: float,
    y: float,
    goal_x: float,
    goal_y: float,
    cx: float,
    cy: float,
    radius: float,
    d_e: float,
    d_b: float,
    k_r: float,
    literal: bool,
) -> tuple[float, float]:
    """Eq. (9) at one place for one obstacle."""
    ox, oy = x - cx, y - cy  # p_or
    rho = math.sqrt(ox * ox + oy * oy)
    if rho > radius + d_e + d_b or rho < 1e-12:
        return 0.0, 0.0
    ux, uy = ox / rho, oy / rho
    if rho < radius:
        return (0.0, 0.0) if literal else (ux, uy)
    gx, gy = goal_x - x, goal_y - y
    to_goal = math.sqrt(gx * gx + gy * gy)
    bx, by = goal_x - cx, goal_y - cy  # p_od
    if to_goal + radius < math.sqrt(bx * bx + by * by):
        return 0.0, 0.0  # the obstacle lies far behind the goal's back
    if -ox * gx - oy * gy <= 0.0:
        return 0.0, 0.0  # it lies behind the robot
    share = (rho - radius) / d_e if rho < radius + d_e else 2.0 - (radius + d_e + k_r) / (rho + k_r)
    turn = 0.5 * math.pi * share
    if bx * oy - by * ox >= 0.0:
        turn = -turn
    c, s = math.cos(turn), math.sin(turn)
    return ux * c - uy * s, ux * s + uy * c


@njit(cache=True)
def field(
    places: np.ndarray,
    headings: np.ndarray,
    goal_x: float,
    goal_y: float,
    goal_heading: float,
    oriented: bool,
    centres: np.ndarray,
    radii: np.ndarray,
    k_rho: float,
    k_alpha: float,
    k_beta: float,
    near: float,
    ramp: bool,
    d_e: float,
    d_b: float,
    k_r: float,
    w_goal: float,
    w_avoid: float,
    literal: bool,
    out: np.ndarray,
) -> None:
    """Eq. (10) at every place; a weight of zero leaves that part out."""
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        sx, sy = 0.0, 0.0
        if w_avoid != 0.0:
            for j in range(centres.shape[0]):
                ax, ay = _around(
                    x,
                    y,
                    goal_x,
                    goal_y,
                    centres[j, 0],
                    centres[j, 1],
                    radii[j],
                    d_e,
                    d_b,
                    k_r,
                    literal,
                )
                sx += ax
                sy += ay
        size = math.sqrt(sx * sx + sy * sy)
        mx, my = 0.0, 0.0
        if w_goal != 0.0:
            mx, my = _towards(
                goal_x - x,
                goal_y - y,
                headings[i],
                goal_heading,
                oriented,
                k_alpha,
                k_beta,
                near,
                ramp,
                literal,
            )
        if size < 1e-9:
            weight = w_goal if literal or w_goal == 0.0 else 1.0
            out[i, 0] = weight * k_rho * mx
            out[i, 1] = weight * k_rho * my
        else:
            out[i, 0] = w_goal * k_rho * mx + w_avoid * sx / size
            out[i, 1] = w_goal * k_rho * my + w_avoid * sy / size
