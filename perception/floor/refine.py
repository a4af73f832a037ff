"""The last word on a plane: weighted least squares on all points, and how sure it is.

Two passes in inverse depth (see `_search_kernels`). The covariance has three parts:

- what independent noise of the points leaves: the inverse of the normal matrix;
- times the factor by which the noise of neighbouring pixels hangs together, measured on the residuals:
  gradients summed over image cells of about 5 deg vary that much more than independent ones would;
- plus what residuals cannot show, because it bends the floor into another plane: an error of depth scale,
  constant and growing across the image to the right and downwards, each of deviation `scale_share`.

Source: seed 003, section 3 (least squares, one repeat); covariance ours, its factor after White 1980.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _fit_kernels as kernels
from .sample import ScoreConfig


@dataclass(frozen=True)
class RefineConfig:
    """Passes and the parts of the covariance."""

    passes: int = 3  # seed 003: least squares, one repeat; ours: one more, as the band narrows
    rough_m: float = 0.003  # ours: carpet, joints of tiles
    wide_sigmas: float = 5.0  # ours: band of the first pass, deviations of noise and roughness
    narrow_sigmas: float = 2.5  # ours: feet of walls and boxes lie within tau, but not within this
    foot_m: float = 0.25  # ours: points up to here above the floor make what is below them a foot
    foot_cell_m: float = 0.05  # ours: as far from a wall as its foot reaches through noise
    scale_share: float = 0.003  # ours: depth scale left by calibration, part of depth
    least_points: int = 100  # ours: fewer are no floor

    def __post_init__(self) -> None:
        if self.passes < 2:
            raise ConfigError(f"floor: passes={self.passes} must be at least 2")
        if not 0.0 < self.narrow_sigmas < self.wide_sigmas:
            raise ConfigError(
                f"floor: narrow_sigmas={self.narrow_sigmas} must be positive and below "
                f"wide_sigmas={self.wide_sigmas}"
            )
        for name in ("rough_m", "scale_share", "foot_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor: {name}={value} must not be negative, and finite")
        if not self.foot_cell_m > 0.0:
            raise ConfigError(f"floor: foot_cell_m={self.foot_cell_m} must be positive")
        if self.least_points < 3:
            raise ConfigError(f"floor: least_points={self.least_points} must be at least 3")


@dataclass(frozen=True)
class Fit:
    """A plane with covariance; shares of the points on it, and clearly below it."""

    plane: Plane
    share: float
    below_share: float


def refine(points: Points, start: Plane, scoring: ScoreConfig, config: RefineConfig) -> Fit | None:
    """Fit the plane to all points near it.

    Args:
        points: Camera frame, m.
        start: Within a few centimetres of the answer.

    Returns:
        The plane, the camera on its positive side; None if too few points are near or they lie on a line.
    """
    normal, rho = start.normal, start.offset_m
    A, B, C = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    g = np.zeros(3)
    is_open = np.ones(len(points), dtype=np.bool_)
    near = below = cells = 0
    bands = np.linspace(config.wide_sigmas, config.narrow_sigmas, config.passes)
    for number, wide in enumerate(bands):
        if number == 1:
            first, second = Plane(normal, rho).tangents
            kernels.open_ground(
                points.xyz,
                points.sigma,
                normal,
                rho,
                first,
                second,
                scoring.base_m,
                scoring.sigmas,
                config.foot_m,
                config.foot_cell_m,
                is_open,
            )
        common = (points.xyz, points.sigma, is_open, normal, rho)
        if wide > config.narrow_sigmas:
            kernels.moments(*common, wide, config.rough_m, A, g)
        else:
            near, below, cells = kernels.statistics(
                *common,
                scoring.base_m,
                scoring.sigmas,
                config.narrow_sigmas,
                config.rough_m,
                A,
                g,
                B,
                C,
            )
        if not _is_regular(A):
            return None
        slope = -normal / rho + np.linalg.solve(A, g)
        rho = 1.0 / float(np.linalg.norm(slope))
        normal = -slope * rho
    if near < config.least_points:
        return None
    inverse = np.linalg.inv(A)
    factor = float(np.trace(inverse @ B)) / 3.0 * cells / max(cells - 3, 1)
    M = config.scale_share * inverse @ C
    P = max(factor, 1.0) * inverse + M @ M.T
    plane = Plane(normal, rho)
    J = _jacobian(plane)
    return Fit(Plane(normal, rho, J @ P @ J.T), near / len(points), below / len(points))


def fuse(measured: Plane, prior: Plane) -> tuple[Plane, float]:
    """Join a measured plane and a prior.

    Returns:
        The plane, the prior taken as one more measurement (information form); and the squared Mahalanobis
        distance of the two, both covariances taken together.
    """
    tangents = measured.tangents
    W_measured = np.linalg.inv(measured.covariance)
    P_prior = _turned(prior.covariance, prior.tangents, tangents)
    W_prior = np.linalg.inv(P_prior)
    tilt = tangents @ prior.normal / max(float(measured.normal @ prior.normal), 1e-9)
    e = np.array([tilt[0], tilt[1], prior.offset_m - measured.offset_m])
    P = np.linalg.inv(W_measured + W_prior)
    a, b, c = P @ W_prior @ e
    normal = measured.normal + a * tangents[0] + b * tangents[1]
    normal /= np.linalg.norm(normal)
    fused = Plane(normal, measured.offset_m + float(c))
    turned = _turned(P, tangents, fused.tangents)
    distance = float(e @ np.linalg.solve(measured.covariance + P_prior, e))
    return Plane(normal, fused.offset_m, turned), distance


def _turned(
    P: Float[np.ndarray, "3 3"],
    source: Float[np.ndarray, "2 3"],
    target: Float[np.ndarray, "2 3"],
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a plane in the tangents of another that is nearly parallel."""
    T = np.eye(3)
    u, _, vt = np.linalg.svd(target @ source.T)  # the nearest rotation
    T[:2, :2] = u @ vt
    return np.asarray(T @ P @ T.T)


def _jacobian(plane: Plane) -> Float[np.ndarray, "3 3"]:
    """Of (tilt, tilt, offset) by the slope a = -n / rho."""
    n, rho = plane.normal, plane.offset_m
    first, second = plane.tangents  # dn = -rho (I - n n^T) da, drho = rho^2 n.da
    return np.stack([-rho * first, -rho * second, rho * rho * n])


def _is_regular(A: Float[np.ndarray, "3 3"]) -> bool:
    """Whether the points span a plane."""
    scale = np.sqrt(np.diag(A))
    if not np.all(scale > 0.0):
        return False
    return float(np.linalg.eigvalsh(A / np.outer(scale, scale))[0]) > 1e-9
