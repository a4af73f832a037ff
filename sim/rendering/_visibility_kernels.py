"""Compiled loops of the geometric sensor: occlusion of discs, and ray casting among discs in a room."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def find_occluded(
    away: np.ndarray, bearing: np.ndarray, half: np.ndarray, apart: float, result: np.ndarray
) -> None:
    """Whether a nearer disc covers any part of each disc, or is closer than `apart` in angle.

    Args:
        away, bearing, half: (n,) distance, direction and angular half width of each disc.
        apart: rad.
        result: (n,) output.
    """
    for i in range(len(away)):
        result[i] = False
        for j in range(len(away)):
            if j != i and away[j] < away[i]:
                between = (bearing[j] - bearing[i] + math.pi) % (2.0 * math.pi) - math.pi
                if abs(between) < half[i] + half[j] + apart:
                    result[i] = True
                    break


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
