"""From what the panorama lists to what the decision of seed 004 takes: things, and how far aside ground is known.

Source: seed 004, sections 2.3 and 2.4; what is done with walls and with unseen ground is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.panorama.obstacles import PanoramaObstacle, Surroundings
from mapping.panorama.segments import observed_sector, outline_segments
from mapping.panorama.stitching import Panorama
from planning.avoidance.choice import Things

STOP_M = 1.05  # specification: where the robot stops before what blocks its way
REACH_M = STOP_M + 0.6  # ours: what is farther is met later
OPEN_M = 2.0  # ours: the decision asks no further aside
CLOSER_HEIGHT_M = 0.1  # ours: of what closed a passage nothing but its place is known


def things_of(
    panorama: Panorama,
    around: Surroundings,
    reach_m: float = REACH_M,
    closers: Sequence[Float[np.ndarray, "k 2"]] = (),
) -> Things:
    """What the panorama lists, as the decision wants it.

    Args:
        panorama: Finished.
        around: What it lists. What goes on above the counted height is a wall, or hangs together with one, and
            is cut to pieces where its outline leaps.
        reach_m: What is farther ahead is left out: what stands behind the goal blocks nothing.
        closers: Middles of the cells that closed former passages, base frame, m.
    """
    found = [o for o in around.obstacles if not o.cut_top]
    found = [
        o for o in found + outline_segments(panorama, found, REACH_M) if o.distance_m <= reach_m
    ]
    found += [_closer(points) for points in closers if np.all(points[:, 0] > 0.0)]
    ahead = [o.distance_m for o in found if o.left_edge_m[1] > -0.25 and o.right_edge_m[1] < 0.25]
    distance = min(ahead, default=STOP_M)
    left, right = (distance * math.tan(min(max(a, -1.4), 1.4)) for a in observed_sector(panorama))
    return Things(
        np.array([[o.left_rad, o.right_rad] for o in found]).reshape(-1, 2),
        np.array([[o.left_edge_m[1], o.right_edge_m[1]] for o in found]).reshape(-1, 2),
        np.array([o.distance_m for o in found], dtype=float),
        np.array([o.width_m for o in found], dtype=float),
        np.array([o.height_m for o in found], dtype=float),
        np.array([o.sigma_left_rad * o.distance_m for o in found], dtype=float),
        (min(left, OPEN_M), max(right, -OPEN_M)),
    )


def _closer(points: Float[np.ndarray, "k 2"]) -> PanoramaObstacle:
    """Cells as a face across the way."""
    return PanoramaObstacle.across(
        float(points[:, 1].max()),
        float(points[:, 1].min()),
        float(points[:, 0].min()),
        CLOSER_HEIGHT_M,
    )
