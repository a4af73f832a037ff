"""Compiled searches over the objective: the swarm's epochs, and the exact sweep. Arrays and scalars only."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ._objective_kernels import WIDEST, column_of, edge_line, footprint_blocked, left_of, value

ALONG = (1.0, -1.0, 2 / 3, 1 / 3, 0.0, -1 / 3, -2 / 3)
"""Lines swept: both edges of the corridor, and between them so many that nothing 4.5 cm wide is missed."""
FANS = 512  # directions swept, even in the tangent: about two columns each


@njit(cache=True)
def fly(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
    position: np.ndarray,
    velocity: np.ndarray,
    chance: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    weights: np.ndarray,
    neighbours: int,
    own: np.ndarray,
    own_value: np.ndarray,
) -> None:
    """All epochs of a swarm.

    Args:
        blocked, integral, rows, boxes, shape, penalty: The objective.
        position, velocity: (n, 2) particles, px and px an epoch; changed.
        chance: (epochs, n, 2, 2) even draws from [0, 1): r1 and r2 per component.
        low, high: (2,) least and greatest position.
        weights: Inertia, pull to the own best, pull to the others' best, and 1 if the inertia is a length
            in pixels instead of a factor.
        neighbours: How many to each side tell a particle of their best; 0: all.
        own, own_value: Output: best position of each particle and its value.
    """
    n = position.shape[0]
    best = 0
    for i in range(n):
        own[i] = position[i]
        own_value[i] = at(blocked, integral, rows, boxes, shape, penalty, position[i], np.inf)
        if own_value[i] < own_value[best]:
            best = i
    for epoch in range(chance.shape[0]):
        for i in range(n):
            told = best
            if neighbours > 0:
                told = i
                for k in range(-neighbours, neighbours + 1):
                    if own_value[(i + k) % n] < own_value[told]:
                        told = (i + k) % n
            inertia = weights[0]
            if weights[3] > 0.0:
                length = math.hypot(velocity[i, 0], velocity[i, 1])
                inertia = weights[0] / length if length > 0.0 else 0.0
            for d in range(2):
                velocity[i, d] = (
                    inertia * velocity[i, d]
                    + weights[1] * chance[epoch, i, 0, d] * (own[i, d] - position[i, d])
                    + weights[2] * chance[epoch, i, 1, d] * (own[told, d] - position[i, d])
                )
                position[i, d] = min(max(position[i, d] + velocity[i, d], low[d]), high[d])
        for i in range(n):
            found = at(blocked, integral, rows, boxes, shape, penalty, position[i], own_value[i])
            if found < own_value[i]:
                own_value[i] = found
                own[i] = position[i]
                if found < own_value[best]:
                    best = i


@njit(cache=True)
def at(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
    pixel: np.ndarray,
    bound: float,
) -> float:
    """O of one pixel given in fractions; of interest below the bound only."""
    u, v = math.floor(pixel[0] + 0.5), math.floor(pixel[1] + 0.5)
    return value(blocked, integral, rows, boxes, shape, penalty, u, v, bound)


@njit(cache=True)
def sweep(
    blocked: np.ndarray, rows: np.ndarray, shape: np.ndarray, first: float, step: float
) -> np.ndarray:
    """How far ahead each fan of directions may be open, at most: from the lowest row upwards.

    A fan is closed by a row in which every column that an edge of the corridor, or another line along it,
    may pass, in any direction of the fan, is blocked. Nothing that is open is called closed; the reverse happens.

    Args:
        blocked, rows, shape: The objective.
        first, step: Tangent where the first fan begins, and width of each.

    Returns:
        (FANS,) distances ahead from which on a place is surely cut off; infinite where none.
    """
    height, width = blocked.shape
    limit = np.full(FANS, np.inf)
    a, b = np.empty(FANS + 1), np.empty(FANS + 1)
    closed = np.empty(FANS, np.bool_)
    for side in ALONG:
        if abs(side) < 1.0 and shape[24] == 0.0:
            break
        for k in range(FANS + 1):
            tangent = first + k * step
            a[k], b[k] = edge_line(shape, tangent, math.sqrt(1.0 + tangent * tangent), side)
        closed[:] = False
        for y in range(height - 1, -1, -2):
            ahead = rows[y, 0]
            if ahead <= 0.0 or y < shape[21]:
                break
            if ahead <= shape[7]:  # nearer, the edges of a fan may cross
                continue
            later = a[0] + b[0] * y
            for k in range(FANS):
                sooner, later = later, a[k + 1] + b[k + 1] * y
                if closed[k]:
                    continue
                left = math.floor(min(sooner, later) + 0.5 - 1e-6)
                right = math.floor(max(sooner, later) + 0.5 + 1e-6)
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
                limit[k] = min(limit[k], ahead + shape[7] * lateral + 1e-6)
    return limit


@njit(cache=True)
def first_feasible(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
    limit: np.ndarray,
    fans: np.ndarray,
    v: int,
    u: int,
    last: int,
    stride: int,
) -> int:
    """The first pixel without penalty from column u to column last in a row; -1 if there is none."""
    ahead, per_px = rows[v, 0], rows[v, 1]
    towards = 1 if last >= u else -1
    while (last - u) * towards >= 0:
        tangent = left_of(shape, u, per_px) / ahead
        k = int((tangent - fans[0]) / fans[1])
        if 0 <= k < FANS and ahead >= limit[k]:  # on to the next fan
            border = fans[0] + (k + (0 if towards > 0 else 1)) * fans[1]
            u_border = column_of(shape, border * ahead, per_px)
            reached = math.floor(u_border) if towards > 0 else math.ceil(u_border)
            u = reached if (reached - u) * towards > 0 else u + towards
            continue
        if (
            not footprint_blocked(integral, boxes, u, v)
            and value(blocked, integral, rows, boxes, shape, penalty, u, v, penalty) < penalty
        ):
            return u
        u += towards * stride
    return -1


@njit(cache=True)
def search(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
) -> tuple[int, int, float]:
    """The pixel (u, v) of least O without penalty, and O; (-1, -1, inf) if there is none."""
    height, width = blocked.shape
    low = max(shape[8] - shape[23], -WIDEST)
    high = min(shape[9] - shape[23], WIDEST)
    if low >= high:
        return -1, -1, np.inf
    fans = np.empty(2)
    fans[0] = math.tan(low) - 1e-9
    fans[1] = (math.tan(high) - math.tan(low) + 2e-9) / FANS
    limit = sweep(blocked, rows, shape, fans[0], fans[1])
    best_u, best_v, best = -1, -1, np.inf
    top = max(math.ceil(shape[21]), 0)
    while top < height and rows[top, 0] <= 0.0:
        top += 1
    goal_row = height - 1
    while goal_row > top and rows[goal_row, 0] < shape[16]:
        goal_row -= 1
    for stride in (16, 1):  # a coarse pass for a bound, then all
        up, down = goal_row, goal_row + stride
        while up >= top or down < height:
            gap_up = abs(rows[up, 0] - shape[16]) if up >= top else np.inf
            gap_down = abs(rows[down, 0] - shape[16]) if down < height else np.inf
            if min(gap_up, gap_down) >= best:
                break
            if gap_up <= gap_down:
                v, gap = up, gap_up
                up -= stride
            else:
                v, gap = down, gap_down
                down += stride
            ahead, per_px = rows[v, 0], rows[v, 1]
            first = max(shape[18], float(boxes[v, 2]))
            end = min(shape[19], float(width - boxes[v, 2])) - 1.0
            middle = column_of(shape, shape[17], per_px)
            first = max(first, column_of(shape, math.tan(high) * ahead, per_px))
            end = min(end, column_of(shape, math.tan(low) * ahead, per_px))
            if best < np.inf:
                reach = math.sqrt(max(best * best - gap * gap, 0.0)) / per_px
                first, end = max(first, middle - reach), min(end, middle + reach)
            left, right = math.ceil(first - 1e-6), math.floor(end + 1e-6)
            if left > right:
                continue
            start = min(max(math.floor(middle + 0.5), left), right)
            for last in (right, left):
                u = first_feasible(
                    blocked,
                    integral,
                    rows,
                    boxes,
                    shape,
                    penalty,
                    limit,
                    fans,
                    v,
                    start,
                    last,
                    stride,
                )
                if u >= 0:
                    found = value(blocked, integral, rows, boxes, shape, penalty, u, v, penalty)
                    if found < best:
                        best_u, best_v, best = u, v, found
    return best_u, best_v, best


@njit(cache=True)
def search_all(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
) -> tuple[int, int, float]:
    """The pixel (u, v) of least O by looking at every one, and O; penalties are counted, not refused."""
    best_u, best_v, best = -1, -1, np.inf
    for v in range(blocked.shape[0]):
        for u in range(blocked.shape[1]):
            found = value(blocked, integral, rows, boxes, shape, penalty, u, v, np.inf)
            if found < best:
                best_u, best_v, best = u, v, found
    return best_u, best_v, best
