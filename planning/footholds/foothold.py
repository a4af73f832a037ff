"""A foothold: a sole on a surface, and the chance that it misses an edge.

The sides of a surface are known to a standard deviation, and a foot lands beside its mark by the slip of a step. Both are
Gaussian. A side is missed if any part of the sole that faces it reaches beyond; sides count as independent, so where the
same shift moves opposite sides the chance is a little too large. Beyond a side where nothing was seen there may be ground or
not: that chance is stated by itself, for the inner four fifths of the sole, which carry it.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mapping.ground.surface import Surface
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import RobotModel

from . import _chance_kernels as kernels
from ._way_kernels import PLANE


@dataclass(frozen=True)
class FootNoise:
    """Standard deviations of the place at which a foot lands, about its mark, as the localiser claims the slip of a step."""

    ahead_m: float
    across_m: float
    yaw_rad: float

    @property
    def variances(self) -> Float[np.ndarray, "3"]:
        """Of ahead, across and heading."""
        return np.array([self.ahead_m, self.across_m, self.yaw_rad]) ** 2


@dataclass(frozen=True)
class Foothold:
    """Where a foot is to stand, body frame of the plan.

    Args:
        foot: 1 the left, -1 the right.
        pose: Middle and heading of the sole.
        height_m: Of its ground.
        surface: Index of the surface.
        missed: Chance that a part of the sole is beyond an edge.
        unseen: Chance that its inner part is beyond what was seen.
    """

    foot: int
    pose: Pose2
    height_m: float
    surface: int
    missed: float
    unseen: float


def chances(
    surface: Surface, pose: Pose2, robot: RobotModel, noise: FootNoise
) -> tuple[float, float]:
    """The chances that a sole there reaches beyond an edge (drop or rise), and beyond what was seen.

    Args:
        surface: That it is to stand on; both chances are 1 if the middle of the sole is not on it.
        pose: Of the sole, in the frame of the surface.
        robot: Size of the sole.
        noise: Of the foot's place.
    """
    sides, _ = packed([surface])
    variances = noise.variances
    half = np.array(robot.foot_m) / 2
    missed, unseen = kernels.chances(
        sides, 0, len(sides), pose.x, pose.y, pose.yaw, half, variances, 1.0
    )
    return float(missed), float(unseen)


def packed(
    surfaces: Sequence[Surface],
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "m 7"]]:
    """Sides and planes of surfaces as the kernels read them."""
    rows, planes, first = [np.zeros((0, kernels.SIDE))], np.empty((len(surfaces), PLANE)), 0
    for k, one in enumerate(surfaces):
        ends = np.roll(one.outline, -1, axis=0)
        rows.append(np.column_stack([one.outline, ends, one.sigma_m, one.borders]))
        planes[k] = first, first + len(ends), *one.origin, *one.height
        first += len(ends)
    return np.concatenate(rows), planes
