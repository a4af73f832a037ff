"""Floor, obstacle, hole, overhang: what each point means for a foot.

The bound between floor and obstacle grows with depth noise: at 3 m a stereo camera of 4 cm baseline cannot
tell a 5 cm step from floor, and must not pretend to. It also grows with what is not known of the plane.

Source: seed 003, section 3 (classification, tau).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int8

from ..points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane

FLOOR, OBSTACLE, HOLE, OVERHANG = 0, 1, 2, 3


@dataclass(frozen=True)
class ClassConfig:
    """Heights that matter."""

    tau_m: float = 0.01  # seed 003: tau = 0.01 + 3 sigma_Z h / Z
    sigmas: float = 3.0  # seed 003
    robot_height_m: float = 0.455  # seed 000
    headroom_m: float = 0.10  # seed 003: obstacles up to the robot's height and 0.1 m
    hole_m: float = 0.02  # ours: deeper than -tau by this, since stray returns lie below floors

    def __post_init__(self) -> None:
        if not (self.tau_m > 0.0 and self.robot_height_m > self.tau_m):
            raise ConfigError(
                f"classes: tau_m={self.tau_m} must be positive and below "
                f"robot_height_m={self.robot_height_m}"
            )


def floor_bound(
    points: Points, plane: Plane, config: ClassConfig | None = None
) -> Float[np.ndarray, "n"]:
    """tau of every point: how far from the plane it may be and still be floor, m."""
    config = config or ClassConfig()
    t0, t1 = plane.tangents
    lever = np.column_stack([points.xyz @ t0, points.xyz @ t1, np.ones(len(points.xyz))])
    plane_variance = np.einsum("ni,ij,nj->n", lever, plane.covariance, lever)
    height_share = (points.xyz @ plane.normal) / points.xyz[:, 2]
    variance = (points.sigma * height_share) ** 2 + plane_variance
    return config.tau_m + config.sigmas * np.sqrt(np.maximum(variance, 0.0))


def classify(
    points: Points, plane: Plane, config: ClassConfig | None = None
) -> Int8[np.ndarray, "n"]:
    """FLOOR, OBSTACLE, HOLE or OVERHANG for every point.

    Args:
        points: Camera frame.
        plane: The floor, camera frame, with covariance.
        config: Heights.
    """
    config = config or ClassConfig()
    height = plane.distance(points.xyz)
    tau = floor_bound(points, plane, config)
    classes = np.full(len(height), FLOOR, np.int8)
    classes[height > tau] = OBSTACLE
    classes[height > config.robot_height_m + config.headroom_m] = OVERHANG
    classes[height < -(tau + config.hole_m)] = HOLE
    return classes
