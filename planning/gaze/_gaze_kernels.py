"""Compiled inner loop of the gaze map: how many points each direction of the head would show."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


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
    """Weight of the points in view of every gaze.

    For one pan a point is in view over one interval of tilts: its angle below the optical axis must lie
    within half the view down, and its depth must be enough for the view across. So each point costs two
    entries of a difference, not one test per tilt.

    Args:
        points: (n, 3) from the camera, body axes, m.
        weights: (n,).
        pans, tilts: Of the gazes, even steps, rad; pan left, tilt down positive.
        half_across, half_down: Of the view, rad.
        result: (pans, tilts), written.
    """
    rows, steps = len(pans), len(tilts)
    first = tilts[0]
    per_rad = 1.0 / (tilts[1] - tilts[0]) if steps > 1 else 1.0
    slope = math.tan(half_across)
    near = math.cos(half_down)
    change = np.empty(steps + 1)
    for row in range(rows):
        c, s = math.cos(pans[row]), math.sin(pans[row])
        change[:] = 0.0
        for k in range(len(points)):
            x, y, z = points[k, 0], points[k, 1], points[k, 2]
            ahead, aside = c * x + s * y, abs(c * y - s * x)
            reach = slope * math.sqrt(ahead * ahead + z * z)
            if aside > reach or ahead <= 0.0:
                continue
            half = half_down
            if aside > near * reach:
                half = math.acos(aside / reach)
            middle = math.atan2(-z, ahead) - first
            low = max(math.ceil((middle - half) * per_rad - 1e-9), 0)
            high = min(math.floor((middle + half) * per_rad + 1e-9), steps - 1)
            if low <= high:
                change[low] += weights[k]
                change[high + 1] -= weights[k]
        total = 0.0
        for column in range(steps):
            total += change[column]
            result[row, column] = total
