"""Lines of sight among static obstacles: whether one is blocked, and how far along a path one reaches.

The guard judges a plan by the target it leads to. The next way point of a path bends round moving obstacles, and
walking to it means walking along with them, so the target lies farther along the path.

Source: ours, from walks among moving obstacles.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def is_blocked(
    here: Float[np.ndarray, "2"],
    there: Float[np.ndarray, "2"],
    standing: Float[np.ndarray, "n 2"],
    distance_m: float,
) -> bool:
    """Whether a static point lies within a distance of the segment between two places, m."""
    way, apart = there - here, standing - here
    length = max(float(np.hypot(*way)), 1e-9)
    along = apart @ way / length
    lateral = np.abs(apart[:, 0] * way[1] - apart[:, 1] * way[0]) / length
    return bool(((along > 0.0) & (along < length) & (lateral < distance_m)).any())


def farthest_visible(
    here: Float[np.ndarray, "2"],
    points: Float[np.ndarray, "k 2"],
    standing: Float[np.ndarray, "n 2"],
    distance_m: float,
) -> Float[np.ndarray, "2"]:
    """The last point of a path with a free line of sight; the first point if no other has one.

    Args:
        here: World frame, m.
        points: Path ahead, k >= 1, nearest first.
        standing: Points of static obstacles.
        distance_m: Distance from the segment within which such a point blocks it.
    """
    for point in points[:0:-1]:
        if not is_blocked(here, point, standing, distance_m):
            return np.asarray(point)
    return np.asarray(points[0])
