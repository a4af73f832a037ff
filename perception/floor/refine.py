"""Final fit of the floor: weighted least squares on all points, with its covariance.

The fit runs a few passes in inverse depth (see `_search_kernels`). Its covariance is

- the inverse of the normal matrix, for independent noise of the points;
- times a factor for correlated noise of neighbouring pixels, measured on the residuals: gradients summed over
  image cells of about 5 deg vary by that factor more than independent ones would;
- plus the effect of errors common to all points of a view, which turn the floor into another plane and leave
  no residuals: constant, or growing across the image. Their size depends on the sensor (`SharedError`).

Source: seed 003, section 3 (least squares, one repeat); covariance ours, its factor after White 1980.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..depth.points import Points
from ..primitives import plugins
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.settings import setting
from . import _fit_kernels as kernels
from .sample import ScoreConfig

PASSES = 3  # seed 003: least squares, one repeat; ours: one more, as the band narrows
TIGHT_WIDE_SIGMAS = (
    3.0  # ours: first and last band where the prior is precise: a ramp or a step that
)
TIGHT_SIGMAS = 1.5  # begins nearby must not take part
LEAST_POINTS = 100  # ours: fewer are no floor
MANY_CELLS = 30  # ours: from here on the factor of correlated noise may be below 1
LEAST_FACTOR = 0.05  # ours


class SharedError(NamedTuple):
    """Errors common to all points of one view, as standard deviations.

    Args:
        scale: Relative error of depth, everywhere the same: focal length or baseline.
        bend: Relative error of depth per unit of ray slope, to the right and downwards each: stray light,
            residual lens distortion.
        sigmas: In standard deviations of each point, for all three shapes: an offset of disparity.
    """

    scale: float = 0.0
    bend: float = 0.0
    sigmas: float = 0.0


@dataclass(frozen=True)
class RefineConfig:
    """Bands of the fit and common errors of each sensor."""

    tof_scale: float = (
        0.015  # ours: stray light, SR-4000 model; relative depth error common to a TOF view
    )
    tof_bend: float = 0.035  # ours: wiggling error, SR-4000 model; the same per unit of ray slope
    stereo_sigmas: float = (
        0.11  # ours: NEES of 003-E1, own matcher; depth error common to a stereo view
    )
    depth_share: float = setting(
        0.01,
        "",
        "relative depth error common to an RGB-D view, also per unit of ray slope",
        "ours: Kinects against motion capture",
    )
    unknown_share: float = 0.003  # ours: the same where the sensor is not known
    rough_m: float = 0.003  # ours: carpet, joints of tiles
    wide_sigmas: float = (
        5.0  # ours: band of the first pass, standard deviations of noise and roughness
    )
    narrow_sigmas: float = 2.5  # ours: band of the last pass; excludes the feet of walls and boxes
    foot_m: float = 0.25  # ours: points up to this height above the floor mark a foot below them

    def __post_init__(self) -> None:
        if not 0.0 < self.narrow_sigmas < self.wide_sigmas:
            raise ConfigError(
                f"floor: narrow_sigmas={self.narrow_sigmas} must be positive and below "
                f"wide_sigmas={self.wide_sigmas}"
            )
        for name in ("tof_scale", "tof_bend", "stereo_sigmas", "depth_share", "unknown_share",
                     "rough_m", "foot_m"):  # fmt: skip
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor: {name}={value} must not be negative, and finite")

    def shared(self, sensor: str | None) -> SharedError:
        """Common errors of a sensor; ConfigError for an unknown name."""
        errors = {
            "tof": SharedError(self.tof_scale, self.tof_bend),
            "stereo": SharedError(sigmas=self.stereo_sigmas),
            "depth": SharedError(self.depth_share, self.depth_share),
            None: SharedError(self.unknown_share, self.unknown_share),
        }
        if sensor is not None and plugins.is_reference(sensor):  # a depth source of the user's
            return errors[None]
        if sensor not in errors:
            raise ConfigError(f"floor: sensor={sensor!r} is unknown; choose tof, stereo, depth")
        return errors[sensor]


@dataclass(frozen=True)
class Fit:
    """A plane fitted to points.

    Args:
        plane: With its whole covariance.
        among_points: The same plane with its covariance relative to its own points, without their common
            errors: the reference for heights of points above the floor.
        share: Share of all points that lie on it.
        below_share: Share of all points that lie clearly below it.
    """

    plane: Plane
    among_points: Plane
    share: float
    below_share: float


def refine(
    points: Points,
    start: Plane,
    scoring: ScoreConfig,
    config: RefineConfig,
    sensor: str | None = None,
    settle: bool = False,
) -> Fit | None:
    """Fit the plane to all points near it.

    Args:
        points: Camera frame, m.
        start: Within a few centimetres of the result.
        scoring: Threshold tau.
        config: Bands and common errors.
        sensor: "tof", "stereo" or "depth"; None if unknown.
        settle: Narrow the band further and widen it once at the end. This excludes surfaces at a small angle
            to the floor, but needs a start close to the result.

    Returns:
        The plane, the camera on its positive side; None if too few points are near, or if they are collinear.
    """
    normal, rho = start.normal, start.offset_m
    A, B, C, D = np.zeros((4, 3, 3))
    g = np.zeros(3)
    is_open = np.ones(len(points), dtype=np.bool_)
    near = below = cells = 0
    bands = list(np.linspace(config.wide_sigmas, config.narrow_sigmas, PASSES))
    if settle:
        tight = np.linspace(TIGHT_WIDE_SIGMAS, TIGHT_SIGMAS, PASSES + 1)
        bands = [*tight, config.narrow_sigmas]
    for number, wide in enumerate(bands):
        if number == 1:
            kernels.open_ground(
                points.xyz,
                points.sigma,
                kernels.Ground(normal, rho, *Plane(normal, rho).tangents),
                scoring.base_m,
                scoring.sigmas,
                config.foot_m,
                is_open,
            )
        common = (points.xyz, points.sigma, is_open, normal, rho)
        if number < len(bands) - 1:
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
                D,
            )
        if not _is_regular(A):
            return None
        slope = -normal / rho + np.linalg.solve(A, g)
        rho = 1.0 / float(np.linalg.norm(slope))
        normal = -slope * rho
    if near < LEAST_POINTS:
        return None
    inverse = np.linalg.inv(A)
    factor = float(np.trace(inverse @ B)) / 3.0 * cells / max(cells - 3, 1)
    factor = max(factor, 1.0 if cells < MANY_CELLS else LEAST_FACTOR)
    shared = config.shared(sensor)
    M = inverse @ C @ np.diag([shared.bend, shared.bend, shared.scale])
    N = shared.sigmas * inverse @ D
    J = _jacobian(Plane(normal, rho))
    own = J @ (factor * inverse) @ J.T
    common = J @ (M @ M.T + N @ N.T) @ J.T
    plane = Plane(normal, rho, own + common)
    return Fit(plane, Plane(normal, rho, own), near / len(points), below / len(points))


def fuse(measured: Plane, prior: Plane) -> tuple[Plane, float]:
    """Fuse a measured plane with its prior.

    Returns:
        The fused plane, the prior being one more measurement (information form), and the squared Mahalanobis
        distance of the two under the sum of their covariances.
    """
    tangents = measured.tangents
    W_measured = np.linalg.inv(measured.covariance)
    P_prior = turned(prior.covariance, prior.tangents, tangents)
    W_prior = np.linalg.inv(P_prior)
    tilt = tangents @ prior.normal / max(float(measured.normal @ prior.normal), 1e-9)
    e = np.array([tilt[0], tilt[1], prior.offset_m - measured.offset_m])
    P = np.linalg.inv(W_measured + W_prior)
    a, b, c = P @ W_prior @ e
    normal = measured.normal + a * tangents[0] + b * tangents[1]
    normal /= np.linalg.norm(normal)
    fused = Plane(normal, measured.offset_m + float(c))
    P = turned(P, tangents, fused.tangents)
    distance = float(e @ np.linalg.solve(measured.covariance + P_prior, e))
    return Plane(normal, fused.offset_m, P), distance


def turned(
    P: Float[np.ndarray, "3 3"],
    source: Float[np.ndarray, "2 3"],
    target: Float[np.ndarray, "2 3"],
) -> Float[np.ndarray, "3 3"]:
    """Covariance of a plane with respect to the tangents of a nearly parallel one."""
    T = np.eye(3)
    u, _, vt = np.linalg.svd(target @ source.T)  # the nearest rotation
    T[:2, :2] = u @ vt
    return np.asarray(T @ P @ T.T)


def _jacobian(plane: Plane) -> Float[np.ndarray, "3 3"]:
    """Jacobian of (tilt, tilt, offset) with respect to the slope a = -n / rho."""
    n, rho = plane.normal, plane.offset_m
    first, second = plane.tangents  # dn = -rho (I - n n^T) da, drho = rho^2 n.da
    return np.stack([-rho * first, -rho * second, rho * rho * n])


def _is_regular(A: Float[np.ndarray, "3 3"]) -> bool:
    """Whether the points span a plane."""
    scale = np.sqrt(np.diag(A))
    if not np.all(scale > 0.0):
        return False
    return float(np.linalg.eigvalsh(A / np.outer(scale, scale))[0]) > 1e-9
