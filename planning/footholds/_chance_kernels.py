"""Compiled loops of a foothold: the chance that a sole misses an edge, and where a line meets the sides of a surface.

Surfaces are packed: their sides in one table, `SIDE` columns each.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit

SIDE = 6  # of a side: start x, y, end x, y, standard deviation, border
UNSEEN = 0  # `Border.UNSEEN`
SQRT2 = math.sqrt(2.0)
CARRIED = 0.8  # ours: part of a sole, about its middle, below which ground must have been seen
FARTHEST = 6.0  # deviations beyond which a chance counts as none
SAFE = 2.6  # deviations: a chance of 0.005


@njit(cache=True)
def inside(sides: np.ndarray, first: int, last: int, x: float, y: float) -> bool:
    """Whether a point is within an outline."""
    odd = False
    for i in range(first, last):
        ax, ay, bx, by = sides[i, 0], sides[i, 1], sides[i, 2], sides[i, 3]
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


@njit(cache=True)
def beyond(side: np.ndarray, x: float, y: float, c: float, s: float, half: np.ndarray) -> float:
    """By how much a sole reaches beyond a side, negative before it; -inf where no part of the sole faces the side."""
    dx, dy = side[2] - side[0], side[3] - side[1]
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return -np.inf
    dx, dy = dx / length, dy / length
    rx, ry = x - side[0], y - side[1]
    middle, away = dx * rx + dy * ry, dy * rx - dx * ry
    ahead, across = dx * c + dy * s, -dx * s + dy * c  # the sole's axes along the side
    out_x, out_y = dy * c - dx * s, -dy * s - dx * c  # and out of it
    most, u0, v0 = -np.inf, 0.0, 0.0
    for k in range(5):
        i = 1.0 if k in (0, 1, 4) else -1.0
        j = 1.0 if k in (0, 3, 4) else -1.0
        u1 = middle + i * half[0] * ahead + j * half[1] * across
        v1 = away + i * half[0] * out_x + j * half[1] * out_y
        if 0.0 <= u1 <= length:
            most = max(most, v1)
        if k > 0 and u0 != u1:
            for bound in (0.0, length):
                share = (bound - u0) / (u1 - u0)
                if 0.0 < share < 1.0:
                    most = max(most, v0 + share * (v1 - v0))
        u0, v0 = u1, v1
    return most


@njit(cache=True)
def chances(
    sides: np.ndarray,
    first: int,
    last: int,
    x: float,
    y: float,
    yaw: float,
    half: np.ndarray,
    noise: np.ndarray,
    enough: float,
) -> tuple[float, float]:
    """Chances that a sole reaches beyond an edge, and its inner part beyond what was seen; 1 where its middle is not on it.

    The error of the heading by Gauss-Hermite quadrature of three points: a corner of either end may be the one that is beyond.

    Args:
        half: Half of its length and width.
        noise: Variances of its place ahead and across, m^2, and of its heading, rad^2.
        enough: A chance above which the rest is not computed.
    """
    if not inside(sides, first, last, x, y):
        return 1.0, 1.0
    reach = math.sqrt(half[0] * half[0] + half[1] * half[1])
    astray = FARTHEST * math.sqrt(noise[0])
    missed, unseen = 0.0, 0.0
    inner = CARRIED * half
    for k in (1, 0, 2):
        heading = yaw + (k - 1) * math.sqrt(3.0 * noise[2])
        c, s = math.cos(heading), math.sin(heading)
        held, known = 1.0, 1.0
        for i in range(first, last):
            side = sides[i]
            dx, dy = side[2] - side[0], side[3] - side[1]
            away = dy * (x - side[0]) - dx * (y - side[1])
            length = math.sqrt(dx * dx + dy * dy)
            if length == 0.0 or away < -(reach + FARTHEST * side[4] + astray) * length:
                continue  # far before it
            if away > reach * length:
                continue  # beyond it, all of the sole: a side of another part, as the far one of a thin wall
            along, square = dx * (x - side[0]) + dy * (y - side[1]), length * length
            if along < -reach * length or along > square + reach * length:
                continue  # beside it
            sole = inner if side[5] == UNSEEN else half
            ahead, across = (dy * c - dx * s) / length, (-dy * s - dx * c) / length
            variance = side[4] * side[4] + ahead * ahead * noise[0] + across * across * noise[1]
            sigma = math.sqrt(max(variance, 1e-18))
            if away / length + abs(ahead) * sole[0] + abs(across) * sole[1] < -FARTHEST * sigma:
                continue  # before it, all of the sole
            over = beyond(side, x, y, c, s, sole)
            if over == -np.inf:
                continue
            chance = 0.5 * math.erfc(-over / (SQRT2 * sigma))
            if side[5] == UNSEEN:
                known *= 1.0 - chance
            else:
                held *= 1.0 - chance
            if 2.0 * (1.0 - min(held, known)) > 3.0 * enough and k == 1:
                break
        weight = 2.0 / 3.0 if k == 1 else 1.0 / 6.0
        missed += weight * (1.0 - held)
        unseen += weight * (1.0 - known)
        if missed > enough or unseen > enough:
            break
    return missed, unseen


@njit(cache=True)
def spans(
    sides: np.ndarray, first: int, last: int, x: float, y: float, c: float, s: float
) -> tuple[float, float, int, int]:
    """The part of a line through a point that is on a surface: its start and end, and the sides there; infinite and -1 without one.

    Of several parts the one about the point, else the next one ahead; start > end where there is none.
    """
    start, end, near, far = -np.inf, np.inf, -1, -1
    on = inside(sides, first, last, x, y)
    if not on:
        start = np.inf
        for i in range(first, last):
            at = crossing(sides[i], x, y, c, s)
            if 0.0 < at < start:
                start, near = at, i
        if near < 0:
            return 1.0, 0.0, -1, -1
    for i in range(first, last):
        at = crossing(sides[i], x, y, c, s)
        if on and at <= 0.0 and at > start:
            start, near = at, i
        if at > max(0.0, start) and at < end:
            end, far = at, i
    return start, end, near, far


@njit(cache=True)
def crossing(side: np.ndarray, x: float, y: float, c: float, s: float) -> float:
    """Where a line crosses a side, along the line; NaN where it does not."""
    left_a = c * (side[1] - y) - s * (side[0] - x)
    left_b = c * (side[3] - y) - s * (side[2] - x)
    if (left_a > 0.0) == (left_b > 0.0):
        return np.nan
    share = left_a / (left_a - left_b)
    px = side[0] + share * (side[2] - side[0]) - x
    py = side[1] + share * (side[3] - side[1]) - y
    return c * px + s * py


@njit(cache=True)
def margin(
    side: np.ndarray, c: float, s: float, yaw: float, half: np.ndarray, noise: np.ndarray
) -> float:
    """Distance from a side, along a line, at which a sole is clear of it by `SAFE` deviations."""
    dx, dy = side[2] - side[0], side[3] - side[1]
    length = math.sqrt(dx * dx + dy * dy)
    nx, ny = dy / length, -dx / length
    ahead = abs(nx * math.cos(yaw) + ny * math.sin(yaw))
    across = abs(ny * math.cos(yaw) - nx * math.sin(yaw))
    sigma = math.sqrt(side[4] * side[4] + ahead * ahead * noise[0] + across * across * noise[1])
    clear = ahead * half[0] + across * half[1]
    clear = clear * (CARRIED if side[5] == UNSEEN else 1.0) + SAFE * sigma
    return clear / max(abs(nx * c + ny * s), 0.1)
