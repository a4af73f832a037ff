"""Directions from which something could have come near since the last look.

Nothing is known of what is out of view. But something as fast as the fastest obstacle of this run may have come from
the edge of the terrain map towards the robot. The uncertainty of a direction grows with the distance that an obstacle had time for;
the robot's own walk adds to that ahead, and takes from it behind, where only something faster can catch up.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from .priority import SEEK_MAX

# all ours
DIRECTIONS = 12  # round the robot; a view shows one or two
RING_M = 1.0  # range at which a look at a direction is aimed
EDGE_M = 1.75  # where something unseen may be at any time: beyond the terrain map
SURE = 0.9  # probability of moving, and ...
SURE_SHARE = 0.2  # ... deviation of the speed, as a share of it, from which an obstacle teaches how fast they are

RING = RING_M * np.stack(
    [f(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS) for f in (np.cos, np.sin)], axis=1
)
"""(DIRECTIONS, 2) the places to look at, body frame, m."""


def fastest(before_mps: float, obstacles: Sequence[Obstacle]) -> float:
    """Speed of the fastest obstacle of the run, m/s.

    Args:
        before_mps: So far.
        obstacles: Tracks of this frame.
    """
    for one in obstacles:
        speed = math.hypot(*one.velocity.tolist())
        sigma = math.sqrt(float(np.trace(one.state.covariance[2:, 2:])) / 2.0)
        if one.moving >= SURE and sigma <= SURE_SHARE * speed:
            before_mps = max(before_mps, speed)
    return before_mps


def doubts(
    pose: Gaussian,
    grid: EgocentricGrid,
    confidence: ConfidenceLayer,
    fastest_mps: float,
    walks_mps: float,
) -> Float[np.ndarray, "directions"]:
    """Doubt about the direction of each place of `RING`: 1 when something could have arrived since the last look.

    Args:
        pose: Over (x, y, yaw), world frame.
        grid: The terrain map.
        confidence: Of its cells; it tells when they were in view.
        fastest_mps: Speed that unseen obstacles may have.
        walks_mps: Speed of the robot.
    """
    x, y, yaw = pose.mean.tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    places = np.array([x, y]) + RING @ np.array([[c, s], [-s, c]])
    values = confidence.values
    cells = np.rint((places - grid.centres()[0, 0]) / grid.cell_m).astype(int)
    column, row = np.clip(cells, 0, len(values) - 1).T
    unseen_s = (1.0 - values[row, column]) / max(confidence.config.loss_per_s, 1e-9)
    if fastest_mps == 0.0:
        return np.zeros(DIRECTIONS)
    closing = np.maximum(fastest_mps + walks_mps * RING[:, 0] / RING_M, 0.0)
    return np.minimum((closing * unseen_s / EDGE_M) ** 2, SEEK_MAX)
