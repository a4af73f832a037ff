"""Heights: the surface height of a cell and its variance.

A frame gives the mean height of the points in a cell and the variance of that mean. Depth noise and the
unevenness of the cell average out over points and frames. The error of the floor plane, and the error of the
pose times the slope of the surface, are common to all points of a frame and persist from frame to frame:
fusing more frames does not reduce the variance below theirs. A mean outside the gate is a new surface.

Source: ours; a height with the pose variance in it after Fankhauser et al. 2014.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

from . import _terrain_kernels

GATE_SIGMAS = 3.0  # ours: a mean further off belongs to another surface


def floor_form(floor: Plane | None) -> Float[np.ndarray, "3 3"]:
    """Variance of the floor's height as a quadratic form over (x, y, 1), m^2; zero without a floor.

    Args:
        floor: World frame, close to level. Its error (a, b, c) raises a place p = (x, y, 0) by
            a t0.p + b t1.p + c.
    """
    if floor is None:
        return np.zeros((3, 3))
    covariance = np.ascontiguousarray(floor.covariance, np.float64)
    return np.asarray(_terrain_kernels.floor_form(np.ascontiguousarray(floor.tangents), covariance))


def pose_form(pose: Gaussian | None) -> Float[np.ndarray, "3 3"]:
    """Positional variance of a place as a quadratic form over (x, y, 1), mean of both axes, m^2.

    Args:
        pose: (x, y, yaw) of the body, world frame. Its position error shifts a place and its yaw error
            rotates it about the body. None gives zero.
    """
    if pose is None:
        return np.zeros((3, 3))
    x, y = float(pose.mean[0]), float(pose.mean[1])
    covariance = np.ascontiguousarray(pose.covariance, np.float64)
    return np.asarray(_terrain_kernels.pose_form(x, y, covariance))
