"""Heights: how high the surface on a cell is, and how sure we are of it.

A frame gives the mean height of the points of one cell and its variance. Into that go the depth noise of
the points and how uneven the cell is, which average out over points and frames; what the floor is unsure
of there; and how far the cell may be displaced by the error of the pose, times the slope of its surface.
The last two are shared by all points of a frame and last from frame to frame, so that many frames do not
make them smaller than the best of them said. What lies beyond the gate is a new surface.

Source: ours; the idea of a height with the variance of the pose in it after Fankhauser et al. 2014.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

from . import _terrain_kernels


@dataclass(frozen=True)
class HeightConfig:
    """What is unknown about heights, and when a surface is a new one."""

    sigma_m: float = 0.002  # ours: of a frame's heights, beyond noise, floor and pose
    gate_sigmas: float = 3.0  # ours: a mean farther off is that of another surface

    def __post_init__(self) -> None:
        for name in ("sigma_m", "gate_sigmas"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"heights: {name}={value} must be positive and finite")


def floor_form(floor: Plane | None) -> Float[np.ndarray, "3 3"]:
    """Variance of the floor's height as a form over (x, y, 1), m^2; zero where no floor is given.

    Args:
        floor: In the world frame, near to level: a place (x, y, 0) is higher by a t0.p + b t1.p + c for the
            error (a, b, c) that its covariance tells of.
    """
    if floor is None:
        return np.zeros((3, 3))
    covariance = np.ascontiguousarray(floor.covariance, np.float64)
    return np.asarray(_terrain_kernels.floor_form(np.ascontiguousarray(floor.tangents), covariance))


def pose_form(pose: Gaussian | None) -> Float[np.ndarray, "3 3"]:
    """Variance of a place along one axis, mean of both, as a form over (x, y, 1), m^2; zero without a pose.

    Args:
        pose: Over (x, y, yaw) of the body, world frame: a place is displaced by the error of its position
            and turned round it by that of its yaw.
    """
    if pose is None:
        return np.zeros((3, 3))
    x, y = float(pose.mean[0]), float(pose.mean[1])
    covariance = np.ascontiguousarray(pose.covariance, np.float64)
    return np.asarray(_terrain_kernels.pose_form(x, y, covariance))
