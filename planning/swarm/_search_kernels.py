"""Compiled searches over the objective: the epochs of the swarm, and the exact sweep."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

from ._objective_kernels import (
    WIDEST,
    Arrays,
    Geometry,
    column_of,
    edge_line,
    footprint_blocked,
    left_of,
    value,
)

ALONG = (1.0, -1.0, 2 / 3, 1 / 3, 0.0, -1 / 3, -2 / 3)
"""Lines that are swept: both edges of the corridor, and lines between them less than 4.5 cm apart."""
FANS = 512  # directions that are swept, equal steps of the tangent: about two columns each


class Weights(NamedTuple):
    """Weights of a particle: inertia, attraction to its own best and to the best of others.

    Args:
        in_pixels: Whether the inertia is a length in pixels instead of a factor.
    """

    inertia: float
    own: float
    others: float
    in_pixels: bool


@njit(cache=True)
def fly(
    objective: Arrays,
    position: np.ndarray,
    velocity: np.ndarray,
    chance: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    weights: Weights,
    neighbours: int,
    own: np.ndarray,
    own_value: np.ndarray,
) -> None:
    """All epochs of a swarm.

    Args:
        objective: The objective.
        position, velocity: (n, 2) particles, px and px per epoch; changed.
        chance: (epochs, n, 2, 2) uniform draws from [0, 1): r1 and r2 per component.
        low, high: (2,) bounds of the position.
        weights: Of inertia and of both attractions.
        neighbours: Neighbours to each side whose best attracts a particle; 0: all particles.
        own, own_value: Output: best position of each particle and its value.
    """
    n = position.shape[0]
    best = 0
    for i in range(n):
        own[i] = position[i]
        own_value[i] = at(objective, position[i], np.inf)
        if own_value[i] < own_value[best]:
            best = i
    for epoch in range(chance.shape[0]):
        for i in range(n):
            leader = best
            if neighbours > 0:
                leader = i
                for k in range(-neighbours, neighbours + 1):
                    if own_value[(i + k) % n] < own_value[leader]:
                        leader = (i + k) % n
            inertia = weights.inertia
            if weights.in_pixels:
                length = math.hypot(velocity[i, 0], velocity[i, 1])
                inertia = weights.inertia / length if length > 0.0 else 0.0
            for d in range(2):
                velocity[i, d] = (
                    inertia * velocity[i, d]
                    + weights.own * chance[epoch, i, 0, d] * (own[i, d] - position[i, d])
                    + weights.others * chance[epoch, i, 1, d] * (own[leader, d] - position[i, d])
                )
                position[i, d] = min(max(position[i, d] + velocity[i, d], low[d]), high[d])
        for i in range(n):
            found = at(objective, position[i], own_value[i])
            if found < own_value[i]:
                own_value[i] = found
                own[i] = position[i]
                if found < own_value[best]:
                    best = i


@njit(cache=True)
def at(
    objective: Arrays,
    pixel: np.ndarray,
    bound: float,
) -> float:
    """O of the nearest pixel; exact below the bound only."""
    u, v = math.floor(pixel[0] + 0.5), math.floor(pixel[1] + 0.5)
    return value(objective, u, v, bound)


@njit(cache=True)
def sweep(
    blocked: np.ndarray, rows: np.ndarray, view: Geometry, first: float, step: float
) -> np.ndarray:
    """Upper bound of the free distance in each fan of directions, from the lowest row upwards.

    A row closes a fan if it is blocked in every column that a line of the corridor may cross in any direction of the
    fan. An open fan is never closed; a closed one may stay open.

    Args:
        blocked, rows, view: Of the objective.
        first, step: Tangent of the beginning of the first fan, and width of a fan.

    Returns:
        (FANS,) distances ahead, m, from which on every place is blocked; infinite if there is none.
    """
    height, width = blocked.shape
    limit = np.full(FANS, np.inf)
    a, b = np.empty(FANS + 1), np.empty(FANS + 1)
    closed = np.empty(FANS, np.bool_)
    lower, upper = np.empty(FANS + 1, np.int32), np.empty(FANS + 1, np.int32)
    shut = np.array([row.any() for row in blocked])
    for side in ALONG:
        for k in range(FANS + 1):
            tangent = first + k * step
            a[k], b[k] = edge_line(view, tangent, math.sqrt(1.0 + tangent * tangent), side)
        closed[:] = False
        for y in range(height - 1, -1, -2):
            ahead = rows[y, 0]
            if ahead <= 0.0 or y < view.first_row:
                break
            if ahead <= view.half_m or not shut[y]:  # nearer by, the edges of a fan may cross
                continue
            for k in range(FANS + 1):  # first and last column that the edge may touch
                place = min(max(a[k] + b[k] * y + 0.5, -2.0), width + 2.0)
                lower[k] = np.int32(np.floor(place - 1e-6))
                upper[k] = np.int32(np.floor(place + 1e-6))
            for k in range(FANS):
                if closed[k]:
                    continue
                left, right = min(lower[k], lower[k + 1]), max(upper[k], upper[k + 1])
                if left < 0 or right > width - 1:
                    continue
                free = False
                for x in range(left, right + 1):
                    if not blocked[y, x]:
                        free = True
                        break
                if free:
                    continue
                closed[k] = True
                lateral = 0.0
                for tangent in (first + k * step, first + (k + 1) * step):
                    sine = tangent / math.sqrt(1.0 + tangent * tangent)
                    lateral = max(lateral, side * sine if abs(side) == 1.0 else abs(sine))
                limit[k] = min(limit[k], ahead + view.half_m * lateral + 1e-6)
    return limit


@njit(cache=True)
def first_feasible(
    objective: Arrays,
    limit: np.ndarray,
    fans: np.ndarray,
    v: int,
    u: int,
    last: int,
    stride: int,
) -> int:
    """The first column without penalty in row v, from u to `last`; -1 if there is none."""
    rows, view, penalty = objective.rows, objective.geometry, objective.penalty
    ahead, per_px = rows[v, 0], rows[v, 1]
    towards = 1 if last >= u else -1
    while (last - u) * towards >= 0:
        tangent = left_of(view, u, per_px) / ahead
        k = int((tangent - fans[0]) / fans[1])
        if 0 <= k < FANS and ahead >= limit[k]:  # continue at the next fan
            border = fans[0] + (k + (0 if towards > 0 else 1)) * fans[1]
            u_border = column_of(view, border * ahead, per_px)
            reached = math.floor(u_border) if towards > 0 else math.ceil(u_border)
            u = reached if (reached - u) * towards > 0 else u + towards
            continue
        if not footprint_blocked(objective, u, v) and value(objective, u, v, penalty) < penalty:
            return u
        u += towards * stride
    return -1


@njit(cache=True)
def search(
    objective: Arrays,
) -> tuple[int, int, float]:
    """The pixel (u, v) with the least O without penalty, and O; (-1, -1, inf) if there is none."""
    blocked, rows, boxes = objective.blocked, objective.rows, objective.boxes
    view, penalty = objective.geometry, objective.penalty
    height = blocked.shape[0]
    low = max(view.least_rad - view.heading_rad, -WIDEST)
    high = min(view.greatest_rad - view.heading_rad, WIDEST)
    if low >= high:
        return -1, -1, np.inf
    fans = np.empty(2)
    fans[0] = math.tan(low) - 1e-9
    fans[1] = (math.tan(high) - math.tan(low) + 2e-9) / FANS
    limit = sweep(blocked, rows, view, fans[0], fans[1])
    best_u, best_v, best = -1, -1, np.inf
    top = max(math.ceil(view.first_row), 0)
    while top < height and rows[top, 0] <= 0.0:
        top += 1
    goal_row = height - 1
    while goal_row > top and rows[goal_row, 0] < view.goal_ahead:
        goal_row -= 1
    for stride in (16, 1):  # a coarse pass for a bound, then every pixel
        up, down = goal_row, goal_row + stride
        while up >= top or down < height:
            gap_up = abs(rows[up, 0] - view.goal_ahead) if up >= top else np.inf
            gap_down = abs(rows[down, 0] - view.goal_ahead) if down < height else np.inf
            if min(gap_up, gap_down) >= best:
                break
            if gap_up <= gap_down:
                v, gap = up, gap_up
                up -= stride
            else:
                v, gap = down, gap_down
                down += stride
            ahead, per_px = rows[v, 0], rows[v, 1]
            first = max(view.first_column, float(boxes[v, 2]))
            end = min(view.end_column - 1.0, float(boxes[v, 3]))
            middle = column_of(view, view.goal_left, per_px)
            first = max(first, column_of(view, math.tan(high) * ahead, per_px))
            end = min(end, column_of(view, math.tan(low) * ahead, per_px))
            if best < np.inf:
                reach = math.sqrt(max(best * best - gap * gap, 0.0)) / per_px
                first, end = max(first, middle - reach), min(end, middle + reach)
            left, right = math.ceil(first - 1e-6), math.floor(end + 1e-6)
            if left > right:
                continue
            start = min(max(math.floor(middle + 0.5), left), right)
            for last in (right, left):
                u = first_feasible(
                    objective,
                    limit,
                    fans,
                    v,
                    start,
                    last,
                    stride,
                )
                if u >= 0:
                    found = value(objective, u, v, penalty)
                    if found < best:
                        best_u, best_v, best = u, v, found
    return best_u, best_v, best


@njit(cache=True)
def search_all(objective: Arrays) -> tuple[int, int, float]:
    """The pixel (u, v) with the least O of all pixels, and O, penalties included."""
    best_u, best_v, best = -1, -1, np.inf
    height, width = objective.blocked.shape
    for v in range(height):
        for u in range(width):
            found = value(objective, u, v, np.inf)
            if found < best:
                best_u, best_v, best = u, v, found
    return best_u, best_v, best
