"""Errors of the plane of a region by the distortion of the view, coefficient by coefficient.

`floor.common_error` does this for a floor, with sums over image cells. A tread is thinner than such a cell, and what tilts it
is the change of the distortion within the cell; so the sums here are over points.

Source: ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..depth.distortion import Distortion
from ..depth.points import Points
from ..floor.choose import thinned
from ..floor.common_error import LOCAL_SHARE
from ..floor.refine import slope_jacobian
from ..primitives.plane import Plane

ENOUGH = 300  # ours: points
RIPPLE_SLOPE = 1.0 / 6.0  # ours: ray slopes that share a ripple, 10 deg


def by_distortion(
    points: Points, plane: Plane, distortion: Distortion, edge: float, common_sigmas: float = 0.0
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 k"]]:
    """Errors (a, b, c), as in `Plane.covariance`, of a plane fitted to points in inverse depth.

    Args:
        points: Camera frame, m.
        plane: Fitted to them.
        distortion: Of the sensor.
        edge: Ray slope of the image's left and right edge.
        common_sigmas: Error that the points at the rim share, in standard deviations of a point.

    Returns:
        Covariance by local ripples and by what points at the rim share, and the errors by one standard deviation of each coefficient of the smooth
        field, which are those of every plane of the view.
    """
    few = thinned(points, ENOUGH)
    z = few.xyz[:, 2]
    rays = few.xyz / z[:, None]
    q = rays @ (-plane.normal / plane.offset_m)
    w = (z * z / few.sigma) ** 2
    gain = slope_jacobian(plane) @ np.linalg.solve(
        (rays * w[:, None]).T @ rays, (rays * w[:, None]).T
    )
    at_rim = _by_rim(few, plane, common_sigmas) if common_sigmas > 0.0 else np.zeros((3, 3))
    field = distortion.field(rays[:, 0], rays[:, 1], z, few.sigma, edge)
    ripple = gain * (LOCAL_SHARE * distortion.size(z, few.sigma) * q)
    column, row = np.floor(rays[:, :2] / RIPPLE_SLOPE).astype(int).T
    _, block = np.unique(row * 1000 + column, return_inverse=True)
    ripples = np.stack([np.bincount(block, one) for one in ripple])
    return ripples @ ripples.T + at_rim, gain @ (field * q[:, None])


def _by_rim(points: Points, plane: Plane, sigmas: float) -> Float[np.ndarray, "3 3"]:
    """Covariance by errors that points at a rim share: they tilt the plane, and shift it half as much as its rim."""
    off = sigmas * float(np.mean(points.sigma / points.xyz[:, 2])) * plane.offset_m
    at = points.xyz @ plane.tangents.T
    middle = at.mean(axis=0)
    P = np.zeros((3, 3))
    P[:2, :2] = off**2 * np.linalg.inv(3.0 * np.cov(at.T))
    P[2, 2] = (off / 2.0) ** 2
    to_camera = np.eye(3)
    to_camera[2, :2] = -middle
    return np.asarray(to_camera @ P @ to_camera.T)
