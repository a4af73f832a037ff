"""Compiled value of pixels: cost and penalties of seed 000, eq. (3) to (9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

WIDEST = math.radians(80.0)  # ours: largest direction from the robot's heading that is searched


class Geometry(NamedTuple):
    """Numbers of one picture, robot and goal; "ahead" and "left" are in the frame of `floor_rows`, m.

    Args:
        fx, fy, cx, cy: Pinhole of the upright camera, px.
        eye_ahead, eye_left, eye_up: Position of the camera.
        tilt_sin, tilt_cos: Of its tilt.
        p0, p1, q0, q1: Lines of `FloorRows.lines`.
        half_m: Half width of the corridor.
        least_rad, greatest_rad: Window of directions seen from the robot.
        goal_ahead, goal_left: Goal.
        first_column, end_column: Columns that are open.
        farthest_m: Longest range.
        first_row: First row that is searched.
        heading_rad: Offset of the angle, which only the printed form gets wrong.
        literal: Whether the corridor is as printed.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    eye_ahead: float
    eye_left: float
    eye_up: float
    tilt_sin: float
    tilt_cos: float
    p0: float
    p1: float
    q0: float
    q1: float
    half_m: float
    least_rad: float
    greatest_rad: float
    goal_ahead: float
    goal_left: float
    first_column: float
    end_column: float
    farthest_m: float
    first_row: float
    heading_rad: float
    literal: bool


class Arrays(NamedTuple):
    """The objective over one picture.

    Args:
        blocked: (h, w) uint8, pixels that cannot be walked on.
        integral: (h + 1, w + 1) their number above and left of each corner.
        rows: (h, 2) distance ahead, m, and metres per column of each row; -1 ahead without floor.
        boxes: (h, 4) of the footprint at each row: its first row and the row after its last, and the first and last
            column with all its corners in the picture, px.
        geometry: Numbers of the picture, robot and goal.
        penalty: Of each violated condition, m.
    """

    blocked: np.ndarray
    integral: np.ndarray
    rows: np.ndarray
    boxes: np.ndarray
    geometry: Geometry
    penalty: float


@njit(cache=True, inline="always")
def left_of(view: Geometry, u: float, per_px: float) -> float:
    """Lateral position of the floor in a column, left positive, m; per_px in metres per column."""
    return view.eye_left - (u - view.cx) * per_px


@njit(cache=True, inline="always")
def column_of(view: Geometry, left: float, per_px: float) -> float:
    """The inverse of `left_of`: the column, with a fraction, of a lateral position."""
    return view.cx + (view.eye_left - left) / per_px


@njit(cache=True, inline="always")
def line_blocked(blocked: np.ndarray, a: float, b: float, first_row: float) -> bool:
    """Whether the image line u = a + b v touches a blocked pixel between a row and the lowest one."""
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
    """Whether a pixel between the lines u = a + b v and u = c + d v is blocked, from a row to the lowest one."""
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
def edge_line(view: Geometry, tangent: float, secant: float, side: float) -> tuple[float, float]:
    """(a, b) of the left (+1) or right (-1) edge of the corridor in a direction."""
    k = side * view.half_m * secant - view.eye_left
    a = view.cx - view.fx * (view.p0 * tangent + view.q0 * k)
    b = -view.fx * (view.p1 * tangent + view.q1 * k)
    return a, b


@njit(cache=True, inline="always")
def row_of(view: Geometry, ahead: float) -> float:
    """Row of the floor at a distance ahead."""
    away = ahead - view.eye_ahead
    depth = max(away * view.tilt_cos + view.eye_up * view.tilt_sin, 1e-9)
    return view.cy + view.fy * (view.eye_up * view.tilt_cos - away * view.tilt_sin) / depth


@njit(cache=True, inline="always")
def footprint_blocked(objective: Arrays, u: int, v: int) -> bool:
    """p1: whether a corner of the footprint at a pixel leaves the picture, or the footprint covers a blocked pixel.

    On the floor the footprint is a rectangle across the camera's heading; in the picture its near side is wider.
    """
    integral, rows, view = objective.integral, objective.rows, objective.geometry
    top, end, first, last = objective.boxes[v]
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    if top < 0 or end > height or u < first or u > last:
        return True
    left = left_of(view, u, rows[v, 1])
    begin = math.floor(column_of(view, left + view.half_m, rows[end - 1, 1]) + 0.5)
    close = math.floor(column_of(view, left - view.half_m, rows[end - 1, 1]) + 0.5)
    least = min(begin, math.floor(column_of(view, left + view.half_m, rows[top, 1]) + 0.5))
    most = max(close, math.floor(column_of(view, left - view.half_m, rows[top, 1]) + 0.5))
    if least >= 0 and most < width:
        count = integral[end, most + 1] - integral[top, most + 1]
        if count == integral[end, least] - integral[top, least]:
            return False  # nothing in the box around it
    for y in range(top, end):
        begin = max(math.floor(column_of(view, left + view.half_m, rows[y, 1]) + 0.5), 0)
        close = min(math.floor(column_of(view, left - view.half_m, rows[y, 1]) + 0.5), width - 1)
        if (
            integral[y + 1, close + 1] - integral[y + 1, begin]
            > integral[y, close + 1] - integral[y, begin]
        ):
            return True
    return False


@njit(cache=True, inline="always")
def corridor_blocked(
    objective: Arrays,
    u: int,
    v: int,
    ahead: float,
    left: float,
) -> bool:
    """p2: whether the corridor from the robot to a pixel covers a blocked pixel."""
    blocked, integral, view = objective.blocked, objective.integral, objective.geometry
    if view.literal:
        return printed_corridor_blocked(blocked, view, u, v)
    reach = math.hypot(ahead, left)
    if ahead < reach * math.cos(WIDEST):
        return True
    tangent, secant, sine = left / ahead, reach / ahead, left / reach
    for side in (1.0, -1.0):
        a, b = edge_line(view, tangent, secant, side)
        if line_blocked(blocked, a, b, row_of(view, ahead - side * view.half_m * sine)):
            return True
    a, b = edge_line(view, tangent, secant, 1.0)
    c, d = edge_line(view, tangent, secant, -1.0)
    nearer = row_of(view, ahead - view.half_m * abs(sine))  # of the two corners at the end
    return between_blocked(integral, a, b, c, d, nearer)


@njit(cache=True, inline="always")
def printed_corridor_blocked(blocked: np.ndarray, view: Geometry, u: int, v: int) -> bool:
    """p2 as printed: a corridor that narrows to the pixel."""
    last = blocked.shape[0] - 1
    if v >= last:
        return False
    depth = 1.0 / (view.q0 + view.q1 * last)
    for side in (1.0, -1.0):
        near = view.cx - view.fx * (side * view.half_m - view.eye_left) / depth
        b = (near - u) / (last - v)
        if line_blocked(blocked, u - b * v, b, float(v)):
            return True
    return False


@njit(cache=True)
def value(
    objective: Arrays,
    u: int,
    v: int,
    bound: float,
) -> float:
    """O of one pixel: distance to the goal, m, plus a penalty for each of the four violated conditions.

    From the bound on the value is not exact; it is then any number not below the bound.
    """
    rows, view, penalty = objective.rows, objective.geometry, objective.penalty
    ahead = rows[v, 0]
    if not (v >= view.first_row and ahead > 0.0):
        return 5.0 * penalty + 1e-3 * penalty * (rows.shape[0] - v)
    left = left_of(view, u, rows[v, 1])
    cost = math.hypot(ahead - view.goal_ahead, left - view.goal_left)
    if cost >= bound:
        return cost
    count = 0
    if footprint_blocked(objective, u, v):
        count += 1
    if u < view.first_column or u >= view.end_column:
        count += 1
    angle = math.atan2(left, ahead) + view.heading_rad
    if angle > math.pi:
        angle -= 2.0 * math.pi
    inside = (
        view.least_rad <= angle <= view.greatest_rad and math.hypot(ahead, left) <= view.farthest_m
    )
    if not inside:
        count += 1
    if cost + penalty * count >= bound:
        return cost + penalty * count
    if count == 0 or view.literal:
        if corridor_blocked(objective, u, v, ahead, left):
            count += 1
    else:
        count += 1  # a forbidden pixel needs no test of its corridor
    return cost + penalty * count


@njit(cache=True)
def values(
    objective: Arrays,
    pixels: np.ndarray,
    out: np.ndarray,
) -> None:
    """O of many pixels (n, 2), rounded and clipped to the picture."""
    height, width = objective.blocked.shape
    for i in range(pixels.shape[0]):
        u = min(max(math.floor(pixels[i, 0] + 0.5), 0), width - 1)
        v = min(max(math.floor(pixels[i, 1] + 0.5), 0), height - 1)
        out[i] = value(objective, u, v, np.inf)
