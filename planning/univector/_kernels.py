"""Compiled inner loops of the univector field: one pose or a whole picture, the same code.

No angle is formed where a rotation of the unit vector does, and no place is asked about an obstacle that
cannot reach it: places are taken in runs of 64, and what lies beyond the box about a run is left out at once.
Arrays and scalars only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

RUN = 64


@njit(cache=True)
def _towards(
    ux: float,
    uy: float,
    rho: float,
    heading: float,
    goal_heading: float,
    k_alpha: float,
    k_beta: float,
    near: float,
    ramp: bool,
    literal: bool,
) -> tuple[float, float]:
    """Eq. (8) within d_con, with angles; (ux, uy) leads to the goal."""
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
def _quarter_turns(share: float) -> tuple[float, float]:
    """Cosine and sine of share quarter turns, 0 <= share <= 2, to 1e-11."""
    z = 0.5 * math.pi * (share - 1.0)
    s = z * z
    sine = z * (
        1.0
        + s
        * (
            -1.0 / 6.0
            + s
            * (
                1.0 / 120.0
                + s
                * (
                    -1.0 / 5040.0
                    + s
                    * (
                        1.0 / 362880.0
                        + s * (-1.0 / 39916800.0 + s * (1.0 / 6227020800.0 - s / 1307674368000.0))
                    )
                )
            )
        )
    )
    cosine = 1.0 + s * (
        -0.5
        + s
        * (
            1.0 / 24.0
            + s
            * (
                -1.0 / 720.0
                + s
                * (
                    1.0 / 40320.0
                    + s
                    * (
                        -1.0 / 3628800.0
                        + s
                        * (1.0 / 479001600.0 + s * (-1.0 / 87178291200.0 + s / 20922789888000.0))
                    )
                )
            )
        )
    )
    return -sine, cosine


@njit(cache=True)
def _avoid(
    places: np.ndarray,
    first: int,
    last: int,
    goal_x: float,
    goal_y: float,
    centres: np.ndarray,
    radii: np.ndarray,
    virtual: np.ndarray,
    d_e: float,
    d_b: float,
    k_r: float,
    literal: bool,
    to_goal: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Sum of eq. (9) over the obstacles for one run of places; `to_goal` holds their distances to the goal."""
    low_x = high_x = places[first, 0]
    low_y = high_y = places[first, 1]
    for i in range(first, last):
        sums[i - first, 0] = sums[i - first, 1] = 0.0
        low_x, high_x = min(low_x, places[i, 0]), max(high_x, places[i, 0])
        low_y, high_y = min(low_y, places[i, 1]), max(high_y, places[i, 1])
    for j in range(centres.shape[0]):
        cx, cy, radius = centres[j, 0], centres[j, 1], radii[j]
        reach = radius + d_e + d_b
        away_x, away_y = max(low_x - cx, cx - high_x, 0.0), max(low_y - cy, cy - high_y, 0.0)
        if away_x * away_x + away_y * away_y > reach * reach:
            continue
        bx, by = goal_x - cx, goal_y - cy  # p_od
        goal_away = math.sqrt(bx * bx + by * by)
        edge = radius + d_e
        for i in range(first, last):
            ox, oy = places[i, 0] - cx, places[i, 1] - cy  # p_or
            square = ox * ox + oy * oy
            if square > reach * reach or square < 1e-24:
                continue
            rho = math.sqrt(square)
            inverse = 1.0 / rho
            ux, uy = ox * inverse, oy * inverse
            if rho < radius:
                if not literal:
                    sums[i - first, 0] += ux
                    sums[i - first, 1] += uy
                continue
            if not virtual[j]:
                if to_goal[i - first] + radius < goal_away:
                    continue  # the obstacle lies far behind the goal's back
                if -ox * (goal_x - places[i, 0]) - oy * (goal_y - places[i, 1]) <= 0.0:
                    continue  # it lies behind the robot
            share = (rho - radius) / d_e if rho < edge else 2.0 - (edge + k_r) / (rho + k_r)
            c, s = _quarter_turns(share)
            if bx * oy - by * ox >= 0.0:
                s = -s
            sums[i - first, 0] += ux * c - uy * s
            sums[i - first, 1] += ux * s + uy * c


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
    virtual: np.ndarray,
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
    """Eq. (10) at every place; a weight of zero leaves that part out.

    Args:
        places: (n, 2). headings: (n,).
        centres: (m, 2). radii: (m,). virtual: (m,), what lies beside the robot by its nature.
        out: (n, 2), written. The others: as in `fields`.
    """
    turn_x, turn_y = math.cos(goal_heading), math.sin(goal_heading)
    dipole = not literal and not ramp and k_alpha == 1.0 and k_beta == -1.0
    to_goal = np.empty(RUN)
    sums = np.zeros((RUN, 2))
    for first in range(0, places.shape[0], RUN):
        last = min(first + RUN, places.shape[0])
        for i in range(first, last):
            dx, dy = goal_x - places[i, 0], goal_y - places[i, 1]
            to_goal[i - first] = math.sqrt(dx * dx + dy * dy)
        if w_avoid != 0.0:
            _avoid(
                *(places, first, last, goal_x, goal_y, centres, radii, virtual),
                *(d_e, d_b, k_r, literal, to_goal, sums),
            )
        for i in range(first, last):
            mx, my, rho = 0.0, 0.0, to_goal[i - first]
            if w_goal != 0.0 and rho >= 1e-12:
                mx, my = (goal_x - places[i, 0]) / rho, (goal_y - places[i, 1]) / rho
                if not (oriented and rho <= near):
                    if literal:
                        mx, my = -mx, -my
                elif dipole:  # phi = 2 th_rd - th_tg: the square of u, turned back by th_tg
                    a, b = mx * mx - my * my, 2.0 * mx * my
                    mx, my = a * turn_x + b * turn_y, b * turn_x - a * turn_y
                else:
                    mx, my = _towards(
                        *(mx, my, rho, headings[i], goal_heading),
                        *(k_alpha, k_beta, near, ramp, literal),
                    )
            sx, sy = sums[i - first, 0], sums[i - first, 1]
            size = math.sqrt(sx * sx + sy * sy)
            if size < 1e-9:
                weight = w_goal if literal or w_goal == 0.0 else 1.0
                out[i, 0] = weight * k_rho * mx
                out[i, 1] = weight * k_rho * my
            else:
                out[i, 0] = w_goal * k_rho * mx + w_avoid * sx / size
                out[i, 1] = w_goal * k_rho * my + w_avoid * sy / size
