"""Obstacles of a panorama as input of the motion choice of seed 004, with the lateral extent of known ground.

Source: seed 004, sections 2.3 and 2.4; the treatment of walls and of unseen ground is ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.panorama.obstacles import PanoramaObstacle, Surroundings
from mapping.panorama.segments import observed_sector, outline_segments
from mapping.panorama.stitching import Panorama

from ..avoidance.choice import ObstacleTable

STOP_M = 1.05  # specification: distance at which the robot stops before an obstacle
REACH_M = STOP_M + 0.6  # ours: farther obstacles are left for the next scan
OPEN_M = 2.0  # ours: lateral limit of known ground
CLOSER_HEIGHT_M = 0.1  # ours: assumed height of what blocked a passage


def obstacle_table(
    panorama: Panorama,
    around: Surroundings,
    reach_m: float = REACH_M,
    closers: Sequence[Float[np.ndarray, "k 2"]] = (),
) -> ObstacleTable:
    """The obstacles of a panorama as input of the motion choice.

    Args:
        panorama: Finished.
        around: Its obstacles. One that continues above the counted height is a wall or joined to one, and is
            cut where its outline jumps.
        reach_m: Obstacles farther ahead are left out, such as those behind the goal.
        closers: Centres of the cells that blocked earlier passages, base frame, m.
    """
    found = [o for o in around.obstacles if not o.cut_top]
    found = [
        o for o in found + outline_segments(panorama, found, REACH_M) if o.distance_m <= reach_m
    ]
    found += [_closer(points) for points in closers if np.all(points[:, 0] > 0.0)]
    ahead = [o.distance_m for o in found if o.left_edge_m[1] > -0.25 and o.right_edge_m[1] < 0.25]
    distance = min(ahead, default=STOP_M)
    ends = [(o.expected_edge(True), o.expected_edge(False)) for o in found]
    left, right = (distance * math.tan(min(max(a, -1.4), 1.4)) for a in observed_sector(panorama))
    return ObstacleTable(
        np.array([[o.left_rad, o.right_rad] for o in found]).reshape(-1, 2),
        np.array([[o.left_edge_m[1], o.right_edge_m[1]] for o in found]).reshape(-1, 2),
        np.array([[y for y, _ in both] for both in ends]).reshape(-1, 2),
        np.array([o.distance_m for o in found], dtype=float),
        np.array([o.width_m for o in found], dtype=float),
        np.array([o.height_m for o in found], dtype=float),
        np.array([[sigma for _, sigma in both] for both in ends]).reshape(-1, 2),
        (min(left, OPEN_M), max(right, -OPEN_M)),
    )


def _closer(points: Float[np.ndarray, "k 2"]) -> PanoramaObstacle:
    """Cells as a face across the path."""
    return PanoramaObstacle.across(
        float(points[:, 1].max()),
        float(points[:, 1].min()),
        float(points[:, 0].min()),
        CLOSER_HEIGHT_M,
    )
