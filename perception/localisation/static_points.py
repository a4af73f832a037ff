"""Static points above the floor: the input of scan registration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..floor.segmented_view import SegmentedView, near_moving_obstacles
from ..primitives.obstacle import Obstacle
from ..primitives.pose import Pose3


@dataclass(frozen=True)
class StaticPoints:
    """Points above the floor that do not belong to moving obstacles, from one depth sensor.

    Args:
        points: Upright map frame as estimated when the camera was placed, z above the floor, m.
        sigma: Standard deviation of each along its ray, m.
        T_map_camera: The camera in the same frame.
    """

    points: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "n"]
    T_map_camera: Pose3


def static_points(view: SegmentedView, obstacles: Sequence[Obstacle]) -> StaticPoints:
    """The points of a view above the floor, without those near moving obstacles."""
    rising = view.rising
    points, sigma = view.upright.take(rising, axis=0), view.points.sigma.take(rising)
    still = ~near_moving_obstacles(points[:, :2], obstacles)
    return StaticPoints(points[still], sigma[still], view.T_map_camera)
