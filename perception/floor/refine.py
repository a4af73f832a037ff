"""The last word on a plane: weighted least squares on all points, and how sure it is.

A few passes in inverse depth (see `_search_kernels`). The covariance has three parts:

- what independent noise of the points leaves: the inverse of the normal matrix;
- times the factor by which the noise of neighbouring pixels hangs together, measured on the residuals:
  gradients summed over image cells of about 5 deg vary that much more than independent ones would;
- plus what residuals cannot show, because it bends the floor into another plane: an error that all points
  of the view share, constant and growing across the image to the right and downwards. How large it is
  depends on the sensor (`SharedError`).

Source: seed 003, section 3 (least squares, one repeat); covariance ours, its factor after White 1980.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _fit_kernels as kernels
from .sample import ScoreConfig

MANY_CELLS = 30  # so many tell that the noise is less than was said
LEAST_FACTOR = 0.05
SENSORS = ("tof", "stereo", "depth")


@dataclass(frozen=True)
class SharedError:
    """What all points of one view have wrong alike, as deviations.

    Args:
        scale: The same everywhere, part of depth: focal length or baseline are off.
        bend: Growing across the image, part of depth per unit of ray slope, to the right and downwards
            each: stray light, lens distortion left over.
        sigmas: In each point's own deviations, of all three shapes: a disparity off by part of a pixel.
    """

    scale: float = 0.0
    bend: float = 0.0
    sigmas: float = 0.0

    def __post_init__(self) -> None:
        for name in ("scale", "bend", "sigmas"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor: {name}={value} must not be negative, and finite")


@dataclass(frozen=True)
class RefineConfig:
    """Passes and the parts of the covariance."""

    passes: int = 3  # seed 003: least squares, one repeat; ours: one more, as the band narrows
    rough_m: float = 0.003  # ours: carpet, joints of tiles
    wide_sigmas: float = 5.0  # ours: band of the first pass, deviations of noise and roughness
    narrow_sigmas: float = 2.5  # ours: feet of walls and boxes lie within tau, but not within this
    tight_wide_sigmas: float = 3.0  # ours: the same where joints say where the floor is, and a
    tight_sigmas: float = 1.5  # ramp or a step that begins nearby must be left aside
    foot_m: float = 0.25  # ours: points up to here above the floor make what is below them a foot
    foot_cell_m: float = 0.05  # ours: as far from a wall as its foot reaches through noise
    scale_share: float = 0.003  # ours: scale and bend where the sensor is not said
    tof: SharedError = SharedError(
        0.015, 0.035
    )  # ours: stray light and wiggling of the SR-4000 model
    stereo: SharedError = SharedError(sigmas=0.11)  # ours: NEES of 003-E1 with the own matcher
    depth: SharedError = SharedError(0.01, 0.01)  # ours: Kinects against motion capture, mountings
    least_points: int = 100  # ours: fewer are no floor

    def __post_init__(self) -> None:
        if self.passes < 2:
            raise ConfigError(f"floor: passes={self.passes} must be at least 2")
        if not 0.0 < self.narrow_sigmas < self.wide_sigmas:
            raise ConfigError(
                f"floor: narrow_sigmas={self.narrow_sigmas} must be positive and below "
                f"wide_sigmas={self.wide_sigmas}"
            )
        if not 0.0 < self.tight_sigmas <= self.tight_wide_sigmas:
            raise ConfigError(
                f"floor: tight_sigmas={self.tight_sigmas} must be positive and not above "
                f"tight_wide_sigmas={self.tight_wide_sigmas}"
            )
        for name in ("rough_m", "scale_share", "foot_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor: {name}={value} must not be negative, and finite")
        if not self.foot_cell_m > 0.0:
            raise ConfigError(f"floor: foot_cell_m={self.foot_cell_m} must be positive")
        if self.least_points < 3:
            raise ConfigError(f"floor: least_points={self.least_points} must be at least 3")

    def shared(self, sensor: str | None) -> SharedError:
        """What points of that sensor share; an unknown name is a ConfigError."""
        if sensor is None:
            return SharedError(self.scale_share, self.scale_share)
        if sensor not in SENSORS:
            raise ConfigError(f"floor: sensor={sensor!r} is unknown; choose {', '.join(SENSORS)}")
        found: SharedError = getattr(self, sensor)
        return found


@dataclass(frozen=True)
class Fit:
    """A plane fitted to points.

    Args:
        plane: With all of its covariance.
        among_points: The same with the covariance that it has relative to its own points, which share
            the rest: what to measure heights over the floor from.
        share: Of the points that lie on it.
        below_share: Of those that lie clearly below.
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
        start: Within a few centimetres of the answer.
        sensor: "tof", "stereo" or "depth", which says what the points share; None if nobody says.
        settle: Narrow the band farther and widen it once at the end: what lies at a small angle to the
            floor has no say, but a start far off is not forgiven.

    Returns:
        The plane, the camera on its positive side; None if too few points are near or they lie on a line.
    """
    normal, rho = start.normal, start.offset_m
    A, B, C, D = np.zeros((4, 3, 3))
    g = np.zeros(3)
    is_open = np.ones(len(points), dtype=np.bool_)
    near = below = cells = 0
    bands = list(np.linspace(config.wide_sigmas, config.narrow_sigmas, config.passes))
    if settle:
        tight = np.linspace(config.tight_wide_sigmas, config.tight_sigmas, config.passes + 1)
        bands = [*tight, config.narrow_sigmas]
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
    if near < config.least_points:
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
