"""Compiled loops of the gaze map: points in view of each direction, cells in a sector, regions of a mask."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def count(
    points: np.ndarray,
    weights: np.ndarray,
    pans: np.ndarray,
    tilts: np.ndarray,
    half_across: float,
    half_down: float,
    result: np.ndarray,
) -> None:
    """Total weight of the points in view of every gaze.

    For one pan a point is in view over one interval of tilts: its angle from the optical axis must lie within half
    the vertical view, and its depth must suffice for the horizontal view. Each point therefore costs two entries of a
    difference instead of a test per tilt. Away from the sides of the view the interval follows from a lookup of the
    point's slope among those of the upper and lower edges; near the sides it is computed from an angle.

    Args:
        points: (n, 3) relative to the camera, body axes, m.
        weights: (n,).
        pans, tilts: Of the gazes, in even steps, rad; pan left, tilt down positive.
        half_across, half_down: Half the horizontal and vertical field of view, rad.
        result: (pans, tilts) output.
    """
    rows, steps = len(pans), len(tilts)
    first = tilts[0]
    per_rad = 1.0 / (tilts[1] - tilts[0]) if steps > 1 else 1.0
    slope, near = math.tan(half_across) ** 2, math.cos(half_down) ** 2
    over, under = _slopes(tilts - half_down), _slopes(tilts + half_down)
    change = np.empty(steps + 1)
    for row in range(rows):
        c, s = math.cos(pans[row]), math.sin(pans[row])
        change[:] = 0.0
        low, high = 0, -1
        for k in range(len(points)):
            x, y, z = points[k, 0], points[k, 1], points[k, 2]
            ahead, lateral = c * x + s * y, c * y - s * x
            across, reach = lateral * lateral, slope * (ahead * ahead + z * z)  # squares
            if ahead <= 0.0 or across > reach:
                continue
            if across > near * reach:
                half = math.acos(math.sqrt(across / reach))
                middle = math.atan2(-z, ahead) - first
                low = max(math.ceil((middle - half) * per_rad - 1e-9), 0)
                high = min(math.floor((middle + half) * per_rad + 1e-9), steps - 1)
            else:  # points in sequence are neighbours: start from the interval of the last one
                down = -z / ahead
                low = min(max(low, 0), steps)
                while low > 0 and under[low - 1] >= down:
                    low -= 1
                while low < steps and under[low] < down:
                    low += 1
                high = min(max(high, -1), steps - 1)
                while high < steps - 1 and over[high + 1] <= down:
                    high += 1
                while high >= 0 and over[high] > down:
                    high -= 1
            if low <= high:
                change[low] += weights[k]
                change[high + 1] -= weights[k]
        total = 0.0
        for column in range(steps):
            total += change[column]
            result[row, column] = total


@njit(cache=True)
def _slopes(angles: np.ndarray) -> np.ndarray:
    """Tangents of the angles, rad; infinite with the sign of the angle beyond straight up or down."""
    found = np.empty(len(angles))
    for k in range(len(angles)):
        if abs(angles[k]) < 0.5 * math.pi:
            found[k] = math.tan(angles[k])
        else:
            found[k] = math.copysign(math.inf, angles[k])
    return found


@njit(cache=True)
def sector(
    places: np.ndarray,
    x: float,
    y: float,
    cosine: float,
    sine: float,
    nearest: float,
    farthest: float,
    ahead: float,
) -> np.ndarray:
    """Indices of the points in a sector of an annulus.

    Args:
        places: (n, 2), m.
        x, y: Middle of the annulus.
        cosine, sine: Direction of the middle of the sector.
        nearest, farthest: Radii of the annulus.
        ahead: Cosine of half the angle of the sector.
    """
    found, count = np.empty(len(places), np.int64), 0
    for k in range(len(places)):
        right, up = places[k, 0] - x, places[k, 1] - y
        away = math.sqrt(right * right + up * up)
        if nearest <= away <= farthest and cosine * right + sine * up >= ahead * away - 1e-9:
            found[count] = k
            count += 1
    return found[:count]


@njit(cache=True)
def middles(top: np.ndarray) -> np.ndarray:
    """(k, 2) mean row and column of every region of 8-connected cells, in the order of their first cells.

    Args:
        top: (rows, columns) bool; cleared by this function.
    """
    rows, columns = top.shape
    found, count = np.empty((rows * columns, 2)), 0
    waiting = np.empty((rows * columns, 2), np.int64)
    for row in range(rows):
        for column in range(columns):
            if not top[row, column]:
                continue
            top[row, column] = False
            waiting[0, 0], waiting[0, 1] = row, column
            done, size = 0, 1
            while done < size:
                r, c = waiting[done]
                done += 1
                for i in range(max(r - 1, 0), min(r + 2, rows)):
                    for j in range(max(c - 1, 0), min(c + 2, columns)):
                        if top[i, j]:
                            top[i, j] = False
                            waiting[size, 0], waiting[size, 1] = i, j
                            size += 1
            found[count, 0] = waiting[:size, 0].sum() / size
            found[count, 1] = waiting[:size, 1].sum() / size
            count += 1
    return found[:count]
