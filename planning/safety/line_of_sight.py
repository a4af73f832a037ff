"""Straight ways among what stands: whether one is barred, and how far along a path one leads.

A plan among movers is judged by where it leads to. The next way point is bent round whoever is in the way just
now, and to go there is to go along with it: what is judged by must lie beyond.

Source: ours, from walks among movers.
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
    """Whether any of the places that stand lies so near to the straight way from here to there, m."""
    way, apart = there - here, standing - here
    length = max(float(np.hypot(*way)), 1e-9)
    along = apart @ way / length
    aside = np.abs(apart[:, 0] * way[1] - apart[:, 1] * way[0]) / length
    return bool(((along > 0.0) & (along < length) & (aside < distance_m)).any())


def farthest_visible(
    here: Float[np.ndarray, "2"],
    points: Float[np.ndarray, "k 2"],
    standing: Float[np.ndarray, "n 2"],
    distance_m: float,
) -> Float[np.ndarray, "2"]:
    """The last point of a path with a straight way to it; the first where all others are barred.

    Args:
        here: World frame, m.
        points: Of the path ahead, k >= 1, the next one first.
        standing: Places of what stands; what moves is not among them.
        distance_m: How near to the way a place bars it.
    """
    for point in points[:0:-1]:
        if not is_blocked(here, point, standing, distance_m):
            return np.asarray(point)
    return np.asarray(points[0])
