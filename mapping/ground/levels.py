"""Ground of several levels as it is known after one frame: what footstep planners read of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Depth
from perception.primitives.pose import Pose2, Pose3

from .obstacles import Voxels
from .surface import Surface


@dataclass(frozen=True, eq=False)
class LevelView:
    """A depth image that was entered into the map.

    Args:
        sensor: Its name.
        depth: The image.
        T_map_camera: The camera; heights count from the ground of the start.
    """

    sensor: str
    depth: Depth
    T_map_camera: Pose3


@dataclass(frozen=True, eq=False)
class Levels:
    """Surfaces and obstacles in the frame of the foot that stands, whose ground has height 0; renewed once a step.

    Args:
        surfaces: On which a foot may stand.
        voxels: What stands round the robot.
        foot: That stands: 1 the left, -1 the right.
        landings: Feet that have landed since the start.
        stands: The standing foot, map frame.
        ground_m: Height of its ground above that of the start.
        body_m: Height of the body frame above the ground of the start, and its standard deviation.
        step_sigma: Standard deviations of the place at which a foot lands: ahead and across, m, heading, rad.
        slip_m: By which a step usually goes farther than it was commanded.
        views: Depth images of this frame.
    """

    surfaces: tuple[Surface, ...]
    voxels: Voxels
    foot: int
    landings: int
    stands: Pose2
    ground_m: float
    body_m: tuple[float, float]
    step_sigma: Float[np.ndarray, "3"]
    slip_m: float = 0.0
    views: tuple[LevelView, ...] = ()
