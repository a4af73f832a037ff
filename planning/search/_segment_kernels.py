"""Compiled loops of the shortcuts: the cost of straight segments, and those that replace parts of a path.

Points are (x, y) in cells, cell centres at integers.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit

BORDER = 1e-6  # cells: tolerance of rounding at the border of a cell


@njit(cache=True)
def inside_blocked(blocked: np.ndarray, x: float, y: float) -> bool:
    """Whether a point is in a blocked cell or outside the map; the border of a free cell is free."""
    rows, columns = blocked.shape
    left, right = math.floor(x + 0.5 - BORDER), math.floor(x + 0.5 + BORDER)
    low, high = math.floor(y + 0.5 - BORDER), math.floor(y + 0.5 + BORDER)
    if left < 0 or right >= columns or low < 0 or high >= rows:
        return True
    return (
        blocked[low, left] and blocked[low, right] and blocked[high, left] and blocked[high, right]
    )


@njit(cache=True)
def segment_cost(
    price: np.ndarray, blocked: np.ndarray, begin: np.ndarray, end: np.ndarray
) -> float:
    """Cost of a straight segment: its mean cost times its length.

    Sampled at least every half cell with bilinear interpolation; infinite if a sample lies in a blocked cell or outside
    the grid.
    """
    rows, columns = price.shape
    right, down = end[0] - begin[0], end[1] - begin[1]
    length = math.sqrt(right * right + down * down)
    pieces = max(1, math.ceil(2.0 * length))
    total = 0.0
    for i in range(pieces + 1):
        x = begin[0] + i / pieces * right
        y = begin[1] + i / pieces * down
        if inside_blocked(blocked, x, y):
            return np.inf
        c = min(max(int(x), 0), columns - 2)
        r = min(max(int(y), 0), rows - 2)
        u = min(max(x - c, 0.0), 1.0)
        v = min(max(y - r, 0.0), 1.0)
        value = (1.0 - v) * ((1.0 - u) * price[r, c] + u * price[r, c + 1]) + v * (
            (1.0 - u) * price[r + 1, c] + u * price[r + 1, c + 1]
        )
        total += value * (0.5 if i in (0, pieces) else 1.0)
    return total / pieces * length


@njit(cache=True)
def polyline_cost(price: np.ndarray, blocked: np.ndarray, points: np.ndarray) -> float:
    """Sum of `segment_cost` over a polyline of (n, 2) points."""
    total = 0.0
    for i in range(points.shape[0] - 1):
        total += segment_cost(price, blocked, points[i], points[i + 1])
    return total


@njit(cache=True)
def start_at(
    path: np.ndarray, given: np.ndarray, price: np.ndarray, blocked: np.ndarray
) -> np.ndarray:
    """The path with the given point before it, which replaces the first point if it lies in its cell or on its border.

    If the segment to the second point is blocked, the first point stays between them.
    """
    if max(abs(given[0] - path[0, 0]), abs(given[1] - path[0, 1])) > 0.5 + 1e-9:
        return path
    direct = len(path) > 1 and segment_cost(price, blocked, given, path[1]) < np.inf
    rest = path[1:] if direct else path
    moved = np.empty((1 + len(rest), 2))
    moved[0] = given
    moved[1:] = rest
    return moved


@njit(cache=True)
def shortcut(path: np.ndarray, price: np.ndarray, blocked: np.ndarray, slack: float) -> np.ndarray:
    """Which points remain after replacing parts of a path by straight segments; (n,) bool.

    A segment may cost at most `slack` more than the part that it replaces.
    """
    n = path.shape[0]
    along = np.zeros(n)
    for i in range(1, n):
        along[i] = along[i - 1] + segment_cost(price, blocked, path[i - 1], path[i])
    kept = np.zeros(n, np.bool_)
    kept[0] = True
    here = 0
    while here < n - 1:
        there = n - 1
        while there > here + 1:
            direct = segment_cost(price, blocked, path[here], path[there])
            if direct <= along[there] - along[here] + slack:
                break
            there -= 1
        kept[there] = True
        here = there
    return kept
