"""Compiled forecast of an obstacle that goes back and forth on a line."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def back_and_forth(
    seen_at: np.ndarray,
    sense: float,
    speed: float,
    since_seen: np.ndarray,
    direction: np.ndarray,
    start: float,
    turns: tuple[float, float],
    places: np.ndarray,
    velocities: np.ndarray,
) -> None:
    """Positions and velocities at the given times, reversing at the known turning points.

    Args:
        seen_at: (2,) position of the last sighting, m; the obstacle stays on its parallel to the line.
        sense: +1 along the direction of the line, -1 against it.
        speed: m/s.
        since_seen: (n,) times since the sighting, s.
        direction: (2,) unit vector of the line.
        start: Coordinate of `seen_at` on the line, m.
        turns: Coordinates of the turning points, m; NaN if unknown.
        places, velocities: (n, 2) output, m and m/s.
    """
    low, high = turns
    both = math.isfinite(low) and math.isfinite(high) and high - low > 0.05
    length = high - low
    begin = min(max(start, low), high) - low if both else 0.0
    phase = begin if sense > 0.0 else 2.0 * length - begin
    end = high if sense > 0.0 else low
    if math.isfinite(end):
        end = max(end, start) if sense > 0.0 else min(end, start)
    for k in range(len(since_seen)):
        gone, now = speed * since_seen[k], sense
        if both:
            at = (phase + gone) % (2.0 * length)
            now = 1.0 if at <= length else -1.0
            at = low + (at if at <= length else 2.0 * length - at)
        else:
            at = start + sense * gone
            if math.isfinite(end) and sense * (at - end) > 0.0:
                at, now = 2.0 * end - at, -sense
        for axis in range(2):
            places[k, axis] = seen_at[axis] + (at - start) * direction[axis]
            velocities[k, axis] = speed * now * direction[axis]
