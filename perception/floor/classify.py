"""Classification of points by their height above the floor: floor, obstacle, hole or overhang.

The threshold tau grows with depth noise and with the uncertainty of the plane at the point, so low obstacles far
away are not separable from the floor. The foot of an obstacle lies within tau too; its front occludes the
floor behind, so points seen there belong to the foot.

Source: seed 003, section 3: floor |z| <= tau(Z) = 0.01 + 3 sigma_Z h / Z, obstacle up to the robot's height
plus 0.1 m; the term of the plane and the feet are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int8

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.settings import setting
from . import _fit_kernels as kernels

FLOOR, OBSTACLE, HOLE, OVERHANG = 0, 1, 2, 3
HEADROOM_M = 0.10  # seed 003: points above robot height + 0.1 m are overhang


@dataclass(frozen=True)
class ClassConfig:
    """Heights that separate the classes."""

    base_m: float = setting(0.01, "m", "constant part of the floor threshold tau", "seed 003")
    sigmas: float = setting(
        3.0, "", "standard deviations of height in the floor threshold tau", "seed 003"
    )
    robot_height_m: float = setting(
        0.46,
        "m",
        "height of the robot; what hangs more than 0.1 m above it is no obstacle",
        "DARwIn-OP, standing",
    )
    foot_m: float = 0.10  # ours: range of heights above 2 tau that make a front; 0: no feet

    def __post_init__(self) -> None:
        for name in ("base_m", "sigmas", "robot_height_m", "foot_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"classes: {name}={value} must not be negative, and finite")
        if not self.top_m > self.base_m:
            raise ConfigError(
                f"classes: robot_height_m={self.robot_height_m} plus {HEADROOM_M} must exceed "
                f"base_m={self.base_m}"
            )

    @property
    def top_m(self) -> float:
        """Height above the floor from which points are overhang."""
        return self.robot_height_m + HEADROOM_M


def classify(
    points: Points, plane: Plane, config: ClassConfig | None = None
) -> Int8[np.ndarray, "n"]:
    """FLOOR, OBSTACLE, HOLE or OVERHANG for each point.

    Args:
        points: Camera frame, m.
        plane: The floor in the camera frame, with covariance.
    """
    config = config or ClassConfig()
    ground = kernels.Ground(plane.normal, plane.offset_m, *plane.tangents)
    labels, tau = np.empty(len(points), dtype=np.int8), np.empty(len(points))
    kernels.classes(
        points.xyz,
        points.sigma,
        ground,
        plane.covariance,
        config.base_m,
        config.sigmas,
        config.top_m,
        labels,
        tau,
    )
    if config.foot_m > 0.0:
        kernels.feet(points.xyz, ground, tau, config.foot_m, labels)
    return labels


def band(points: Points, plane: Plane, config: ClassConfig | None = None) -> Float[np.ndarray, "n"]:
    """Threshold tau of each point, m: points within +-tau of the plane are floor."""
    config = config or ClassConfig()
    noise = points.sigma * plane.offset_m / points.xyz[:, 2]
    lever = np.column_stack([points.xyz @ plane.tangents.T, np.ones(len(points))])
    variance = ((lever @ plane.covariance) * lever).sum(axis=1)
    return np.asarray(config.base_m + config.sigmas * np.sqrt(noise**2 + variance))
