"""Floor, obstacle, hole or overhang: each point by its height over the plane.

A floor point far away is noisy in height, so the band that counts as floor grows with depth noise, and
with what the plane itself is unsure of there. Low things far away are not separable from the floor, and
the band says so. The foot of a thing lies within the band as well; but a front that rises above it hides
the floor behind, so what is seen there is foot and not floor.

Source: seed 003, section 3: floor |z| <= tau(Z) = 0.01 + 3 sigma_Z h / Z, obstacle up to the robot's height
and 0.1 m; the plane's own part and the feet are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int8

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _fit_kernels as kernels

FLOOR, OBSTACLE, HOLE, OVERHANG = 0, 1, 2, 3


@dataclass(frozen=True)
class ClassConfig:
    """Borders between the classes."""

    base_m: float = 0.01  # seed 003
    sigmas: float = 3.0  # seed 003
    robot_height_m: float = 0.46  # DARwIn-OP, standing
    headroom_m: float = 0.10  # seed 003: ignored from robot height + 0.1 m up
    foot_m: float = 0.10  # ours: fronts are looked for so far above the band; 0: feet stay floor
    front_points: int = 3  # ours: points that make a front, half a degree wide

    def __post_init__(self) -> None:
        for name in ("base_m", "sigmas", "robot_height_m", "headroom_m", "foot_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"classes: {name}={value} must not be negative, and finite")
        if self.front_points < 1:
            raise ConfigError(f"classes: front_points={self.front_points} must be at least 1")
        if not self.robot_height_m + self.headroom_m > self.base_m:
            raise ConfigError(
                f"classes: robot_height_m={self.robot_height_m} and headroom_m={self.headroom_m} must "
                f"reach above base_m={self.base_m}"
            )


def classify(
    points: Points, plane: Plane, config: ClassConfig | None = None
) -> Int8[np.ndarray, "n"]:
    """FLOOR, OBSTACLE, HOLE or OVERHANG for each point.

    Args:
        points: Camera frame, m.
        plane: The floor in the camera frame, with covariance.
    """
    config = config or ClassConfig()
    first, second = plane.tangents
    labels, tau = np.empty(len(points), dtype=np.int8), np.empty(len(points))
    kernels.classes(
        points.xyz,
        points.sigma,
        plane.normal,
        plane.offset_m,
        first,
        second,
        plane.covariance,
        config.base_m,
        config.sigmas,
        config.robot_height_m + config.headroom_m,
        labels,
        tau,
    )
    if config.foot_m > 0.0:
        kernels.feet(
            points.xyz,
            plane.normal,
            plane.offset_m,
            first,
            second,
            tau,
            config.foot_m,
            config.front_points,
            labels,
        )
    return labels


def band(points: Points, plane: Plane, config: ClassConfig | None = None) -> Float[np.ndarray, "n"]:
    """tau of each point: half the height of the band that counts as floor there, m."""
    config = config or ClassConfig()
    noise = points.sigma * plane.offset_m / points.xyz[:, 2]
    lever = np.column_stack([points.xyz @ plane.tangents.T, np.ones(len(points))])
    variance = np.einsum("ni,ij,nj->n", lever, plane.covariance, lever)
    return np.asarray(config.base_m + config.sigmas * np.sqrt(noise**2 + variance))
