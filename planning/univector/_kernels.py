"""Compiled loops of the univector field, for one pose or many.

Rotations of unit vectors replace angles where possible. Places are processed in runs of 64; an obstacle that does not
reach the bounding box of a run is skipped for all of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

RUN = 64
K_ALPHA, K_BETA = 1.0, -1.0  # ours: the field depends on the position alone, a dipole field


class Shape(NamedTuple):
    """Parameters of the field: d_con, d_e, d_b and K_r, m; weights of both parts; whether eq. (8), (9) are as printed."""

    d_con: float
    d_e: float
    d_b: float
    k_r: float
    w_goal: float
    w_avoid: float
    literal: bool


class Discs(NamedTuple):
    """Obstacles: middles (m, 2) and extended radii (m,), m; weight (m,) of each virtual one, 0 for a real one."""

    centres: np.ndarray
    radii: np.ndarray
    virtual: np.ndarray


@njit(cache=True)
def _as_printed(ux: float, uy: float, heading: float, goal_heading: float) -> tuple[float, float]:
    """Eq. (8) within d_con as printed; (ux, uy) points to the goal."""
    th_rd = math.atan2(uy, ux)
    two_pi = 2.0 * math.pi
    alpha = (th_rd - heading + math.pi) % two_pi - math.pi
    beta = (goal_heading - th_rd + math.pi) % two_pi - math.pi
    th_c = K_ALPHA * alpha + K_BETA * beta
    return -math.cos(th_c), -math.sin(th_c)


@njit(cache=True)
def _quarter_turns(share: float) -> tuple[float, float]:
    """Cosine and sine of a number of quarter turns, 0 <= share <= 2, to 1e-11."""
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
    discs: Discs,
    shape: Shape,
    to_goal: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Weighted sum of eq. (9) over the obstacles, and the largest weight, for one run of places.

    `to_goal` holds the distances of the places to the goal.
    """
    centres, radii, virtual = discs
    d_e, d_b, k_r, literal = shape.d_e, shape.d_b, shape.k_r, shape.literal
    low_x = high_x = places[first, 0]
    low_y = high_y = places[first, 1]
    for i in range(first, last):
        sums[i - first] = 0.0
        low_x, high_x = min(low_x, places[i, 0]), max(high_x, places[i, 0])
        low_y, high_y = min(low_y, places[i, 1]), max(high_y, places[i, 1])
    for j in range(centres.shape[0]):
        cx, cy, radius = centres[j, 0], centres[j, 1], radii[j]
        weight = virtual[j] if virtual[j] > 0.0 else 1.0
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
                    sums[i - first, 0] += weight * ux
                    sums[i - first, 1] += weight * uy
                    sums[i - first, 2] = max(sums[i - first, 2], weight)
                continue
            if virtual[j] == 0.0:
                if to_goal[i - first] + radius < goal_away:
                    continue  # the obstacle lies beyond the goal
                if -ox * (goal_x - places[i, 0]) - oy * (goal_y - places[i, 1]) <= 0.0:
                    continue  # the obstacle lies behind the robot
            share = (rho - radius) / d_e if rho < edge else 2.0 - (edge + k_r) / (rho + k_r)
            c, s = _quarter_turns(share)
            if bx * oy - by * ox >= 0.0:
                s = -s
            sums[i - first, 0] += weight * (ux * c - uy * s)
            sums[i - first, 1] += weight * (ux * s + uy * c)
            sums[i - first, 2] = max(sums[i - first, 2], weight)


@njit(cache=True)
def field(
    places: np.ndarray,
    headings: np.ndarray,
    goal_x: float,
    goal_y: float,
    goal_heading: float,
    oriented: bool,
    discs: Discs,
    shape: Shape,
    out: np.ndarray,
) -> None:
    """Eq. (10) at every place; a weight of zero leaves that part out.

    Args:
        places: (n, 2), world frame, m.
        headings: (n,) of the robot, rad; used by the printed form only.
        goal_x, goal_y, goal_heading: World frame, m and rad.
        oriented: Whether the heading at the goal matters.
        discs: Obstacles.
        shape: Parameters of the field.
        out: (n, 2) output.
    """
    turn_x, turn_y = math.cos(goal_heading), math.sin(goal_heading)
    w_goal, w_avoid, literal = shape.w_goal, shape.w_avoid, shape.literal
    to_goal = np.empty(RUN)
    sums = np.zeros((RUN, 3))
    for first in range(0, places.shape[0], RUN):
        last = min(first + RUN, places.shape[0])
        for i in range(first, last):
            dx, dy = goal_x - places[i, 0], goal_y - places[i, 1]
            to_goal[i - first] = math.sqrt(dx * dx + dy * dy)
        if w_avoid != 0.0:
            _avoid(places, first, last, goal_x, goal_y, discs, shape, to_goal, sums)
        for i in range(first, last):
            mx, my, rho = 0.0, 0.0, to_goal[i - first]
            if w_goal != 0.0 and rho >= 1e-12:
                mx, my = (goal_x - places[i, 0]) / rho, (goal_y - places[i, 1]) / rho
                if not (oriented and rho <= shape.d_con):
                    if literal:
                        mx, my = -mx, -my
                elif literal:
                    mx, my = _as_printed(mx, my, headings[i], goal_heading)
                else:  # phi = 2 th_rd - th_tg: the square of u, rotated back by th_tg
                    a, b = mx * mx - my * my, 2.0 * mx * my
                    mx, my = a * turn_x + b * turn_y, b * turn_x - a * turn_y
            sx, sy = sums[i - first, 0], sums[i - first, 1]
            size = math.sqrt(sx * sx + sy * sy)
            if size < 1e-9:
                weight = w_goal if literal or w_goal == 0.0 else 1.0
                out[i, 0] = weight * mx
                out[i, 1] = weight * my
            else:
                most = sums[i - first, 2]
                to, off = w_goal + (1.0 - most) * (1.0 - w_goal), most * w_avoid / size
                out[i, 0] = to * mx + off * sx
                out[i, 1] = to * my + off * sy
