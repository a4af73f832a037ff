"""Compiled value of pixels: cost and penalties. Arrays and scalars only.

`shape` packs what does not depend on the picture, see `objective.Objective.packed`: 0 fx, 1 cx, 2 left of
the eye, 3 to 6 the lines, 7 half width of the corridor, 8 least and 9 greatest angle of the window as seen
from the robot, 10 tilt sine, 11 tilt cosine, 12 ahead of the eye, 13 height of the eye, 14 fy, 15 cy,
16 goal ahead, 17 goal left, 18 first column, 19 end of the columns, 20 farthest range, 21 first row,
22 whether as printed, 23 heading by which the printed angle is wrong, 24 whether the corridor's inside counts.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

WIDEST = math.radians(80.0)


@njit(cache=True, inline="always")
def left_of(shape: np.ndarray, u: float, per_px: float) -> float:
    """How far left of the robot a column shows the floor, in a row of so many metres to a column."""
    return shape[2] - (u - shape[1]) * per_px


@njit(cache=True, inline="always")
def column_of(shape: np.ndarray, left: float, per_px: float) -> float:
    """The column, in fractions, that shows the floor so far left of the robot: the reverse of `left_of`."""
    return shape[1] + (shape[2] - left) / per_px


@njit(cache=True, inline="always")
def line_blocked(blocked: np.ndarray, a: float, b: float, first_row: float) -> bool:
    """Whether the image line u = a + b v touches a blocked pixel from a row down to the lowest."""
    height, width = blocked.shape
    start = max(math.ceil(first_row), 0)
    half = 0.5 * abs(b)
    for y in range(height - 1, start - 1, -1):
        u = a + b * y
        left = max(math.floor(u - half + 0.5), 0)
        right = min(math.floor(u + half + 0.5), width - 1)
        for x in range(left, right + 1):
            if blocked[y, x]:
                return True
    return False


@njit(cache=True, inline="always")
def between_blocked(
    integral: np.ndarray, a: float, b: float, c: float, d: float, first_row: float
) -> bool:
    """Whether a pixel is blocked between the lines u = a + b v and u = c + d v, from a row down to the lowest."""
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    for y in range(height - 1, max(math.ceil(first_row), 0) - 1, -1):
        left = max(math.floor(a + b * y + 0.5), 0)
        end = min(math.floor(c + d * y + 0.5), width - 1) + 1
        if left >= end:
            continue
        lower, upper = integral[y + 1], integral[y]
        if lower[end] - lower[left] > upper[end] - upper[left]:
            return True
    return False


@njit(cache=True, inline="always")
def edge_line(shape: np.ndarray, tangent: float, secant: float, side: float) -> tuple[float, float]:
    """(a, b) of the corridor's left (+1) or right (-1) edge towards a direction."""
    k = side * shape[7] * secant - shape[2]
    a = shape[1] - shape[0] * (shape[3] * tangent + shape[5] * k)
    b = -shape[0] * (shape[4] * tangent + shape[6] * k)
    return a, b


@njit(cache=True, inline="always")
def row_of(shape: np.ndarray, ahead: float) -> float:
    """Row in which the floor so far ahead appears."""
    away = ahead - shape[12]
    depth = max(away * shape[11] + shape[13] * shape[10], 1e-9)
    return shape[15] + shape[14] * (shape[13] * shape[11] - away * shape[10]) / depth


@njit(cache=True, inline="always")
def footprint_blocked(integral: np.ndarray, boxes: np.ndarray, u: int, v: int) -> bool:
    """p1: whether the robot's footprint there leaves the picture or covers a blocked pixel."""
    top, bottom, half = boxes[v, 0], boxes[v, 1], boxes[v, 2]
    left, right = u - half, u + half + 1
    if top < 0 or bottom > integral.shape[0] - 1 or left < 0 or right > integral.shape[1] - 1:
        return True
    count = (
        integral[bottom, right]
        - integral[top, right]
        - integral[bottom, left]
        + integral[top, left]
    )
    return count > 0


@njit(cache=True, inline="always")
def way_blocked(
    blocked: np.ndarray,
    integral: np.ndarray,
    shape: np.ndarray,
    u: int,
    v: int,
    ahead: float,
    left: float,
) -> bool:
    """p2: whether the corridor from the robot to the pixel covers a blocked pixel."""
    if shape[22] > 0.0:
        return printed_way_blocked(blocked, shape, u, v)
    reach = math.hypot(ahead, left)
    if ahead < reach * math.cos(WIDEST):
        return True
    tangent, secant, sine = left / ahead, reach / ahead, left / reach
    for side in (1.0, -1.0):
        a, b = edge_line(shape, tangent, secant, side)
        if line_blocked(blocked, a, b, row_of(shape, ahead - side * shape[7] * sine)):
            return True
    if shape[24] == 0.0:
        return False
    a, b = edge_line(shape, tangent, secant, 1.0)
    c, d = edge_line(shape, tangent, secant, -1.0)
    nearer = row_of(shape, ahead - shape[7] * abs(sine))  # of the two corners at its end
    return between_blocked(integral, a, b, c, d, nearer)


@njit(cache=True, inline="always")
def printed_way_blocked(blocked: np.ndarray, shape: np.ndarray, u: int, v: int) -> bool:
    """p2 as printed: lines from the pixel to both nearest pixels, a corridor that ends in a point."""
    last = blocked.shape[0] - 1
    if v >= last:
        return False
    depth = 1.0 / (shape[5] + shape[6] * last)
    for side in (1.0, -1.0):
        near = shape[1] - shape[0] * (side * shape[7] - shape[2]) / depth
        b = (near - u) / (last - v)
        if line_blocked(blocked, u - b * v, b, float(v)):
            return True
    return False


@njit(cache=True)
def value(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
    u: int,
    v: int,
    bound: float,
) -> float:
    """O of one pixel: metres to the goal, and a penalty for each of the four that is violated.

    What reaches the bound is of no interest: the result is then some number not below it.
    """
    ahead = rows[v, 0]
    if not (v >= shape[21] and ahead > 0.0):
        return 5.0 * penalty + 1e-3 * penalty * (rows.shape[0] - v)
    left = left_of(shape, u, rows[v, 1])
    cost = math.hypot(ahead - shape[16], left - shape[17])
    if cost >= bound:
        return cost
    count = 0
    if footprint_blocked(integral, boxes, u, v):
        count += 1
    if u < shape[18] or u >= shape[19]:
        count += 1
    angle = math.atan2(left, ahead) + shape[23]
    if angle > math.pi:
        angle -= 2.0 * math.pi
    inside = shape[8] <= angle <= shape[9] and math.hypot(ahead, left) <= shape[20]
    if not inside:
        count += 1
    if cost + penalty * count >= bound:
        return cost + penalty * count
    if count == 0 or shape[22] > 0.0:
        if way_blocked(blocked, integral, shape, u, v, ahead, left):
            count += 1
    else:
        count += 1  # a pixel that is forbidden anyhow has no way: its lines need not be followed
    return cost + penalty * count


@njit(cache=True)
def values(
    blocked: np.ndarray,
    integral: np.ndarray,
    rows: np.ndarray,
    boxes: np.ndarray,
    shape: np.ndarray,
    penalty: float,
    pixels: np.ndarray,
    out: np.ndarray,
) -> None:
    """O of many pixels (n, 2), rounded to whole ones; those outside the picture are taken at its rim."""
    height, width = blocked.shape
    for i in range(pixels.shape[0]):
        u = min(max(math.floor(pixels[i, 0] + 0.5), 0), width - 1)
        v = min(max(math.floor(pixels[i, 1] + 0.5), 0), height - 1)
        out[i] = value(blocked, integral, rows, boxes, shape, penalty, u, v, np.inf)
