"""Compiled loops of the geometric sensor: visible parts of discs, and ray casting among discs in a room."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def find_visible(
    away: np.ndarray,
    bearing: np.ndarray,
    half: np.ndarray,
    view: np.ndarray,
    apart: float,
    result: np.ndarray,
) -> None:
    """The largest visible part of each disc, as offsets from its direction; empty if the first exceeds the second.

    Args:
        away, bearing, half: (n,) distance, direction and angular half width of each disc.
        view: Direction of the view's middle, and half its width, rad.
        apart: Angle beside a nearer disc that is not visible either, rad.
        result: (n, 2) output, rad.
    """
    for i in range(len(away)):
        middle = (view[0] - bearing[i] + math.pi) % (2.0 * math.pi) - math.pi
        low, high = max(-half[i], middle - view[1]), min(half[i], middle + view[1])
        for j in range(len(away)):
            if j == i or away[j] >= away[i]:
                continue
            between = (bearing[j] - bearing[i] + math.pi) % (2.0 * math.pi) - math.pi
            left, right = between + half[j] + apart, between - half[j] - apart
            if left <= low or right >= high:
                continue
            if right - low > high - left:
                high = right
            else:
                low = left
        result[i, 0], result[i, 1] = low, high


@njit(cache=True)
def cast_rays(
    rays: np.ndarray, discs: np.ndarray, walls: np.ndarray, distance: np.ndarray, what: np.ndarray
) -> None:
    """Where each ray ends: at a disc (its index) or at the walls (-1).

    Args:
        rays: (m, 3) of x, y, direction.
        discs: (n, 3) of x, y, radius.
        walls: x_min, y_min, x_max, y_max.
        distance, what: (m,) output.
    """
    for i in range(len(rays)):
        x, y = rays[i, 0], rays[i, 1]
        c, s = math.cos(rays[i, 2]), math.sin(rays[i, 2])
        best, which = 1e9, -1
        if abs(c) > 1e-12:
            best = min(best, ((walls[2] if c > 0.0 else walls[0]) - x) / c)
        if abs(s) > 1e-12:
            best = min(best, ((walls[3] if s > 0.0 else walls[1]) - y) / s)
        for j in range(len(discs)):
            dx, dy = discs[j, 0] - x, discs[j, 1] - y
            along, across = dx * c + dy * s, dy * c - dx * s
            if along > 0.0 and abs(across) < discs[j, 2]:
                reach = along - math.sqrt(discs[j, 2] ** 2 - across * across)
                if reach < best:
                    best, which = reach, j
        distance[i], what[i] = best, which
