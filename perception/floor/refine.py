"""Final fit of the floor: weighted least squares on all points, with its covariance.

The fit runs a few passes in inverse depth (see `_search_kernels`). Its covariance is

- the inverse of the normal matrix, for independent noise of the points;
- times a factor for correlated noise of neighbouring pixels, measured on the residuals: gradients summed over
  image cells of about 5 deg vary by that factor more than independent ones would;
- plus the effect of distortion, an error common to all points of a view, which turns the floor into another plane
  (`common_error`).

Source: seed 003, section 3 (least squares, one repeat); covariance ours, its factor after White 1980.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..depth.distortion import Distortion, quadric
from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _fit_kernels as kernels
from .common_error import common_covariance
from .sample import SHARP, ScoreConfig

PASSES = 3  # seed 003: least squares, one repeat; ours: one more, as the band narrows
TIGHT_WIDE_SIGMAS = (
    3.0  # ours: first and last band where the prior is precise: a ramp or a step that
)
TIGHT_SIGMAS = 1.5  # begins nearby must not take part
LEAST_POINTS = 100  # ours: fewer are no floor
MANY_CELLS = 30  # ours: from here on the factor of correlated noise may be below 1
LEAST_FACTOR = 0.05  # ours
LEAST_EDGE = (
    0.3  # ours: ray slope of the edge of a narrow camera, where few of its pixels have depth
)
BENT_BAND = 3.0  # ours: in tau; a floor that bends reaches this far from its plane
NONE = Distortion()


@dataclass(frozen=True)
class RefineConfig:
    """Bands of the fit."""

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
        for name in ("rough_m", "foot_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"floor: {name}={value} must not be negative, and finite")


@dataclass(frozen=True)
class Scatter:
    """Covariance of a plane by the noise of its points, in parts.

    Args:
        independent: (3, 3), covariance as in `Plane.covariance` if the noise of pixels were independent.
        correlation: By how much the scatter of image cells exceeds that.
        cells: Number of these cells.
    """

    independent: Float[np.ndarray, "3 3"]
    correlation: float
    cells: int


@dataclass(frozen=True)
class Fit:
    """A plane fitted to points.

    Args:
        plane: With its whole covariance.
        among_points: The same plane with its covariance relative to its own points, without their common
            errors: the reference for heights of points above the floor.
        share: Share of all points that lie on it.
        below_share: Share of all points that lie clearly below it.
        core_share: Share of its points that lie within a third of their band. Noise puts two thirds there and more,
            a ramp through stairs one third.
        scatter: How the covariance of `among_points` came about; None by `flow_chart`.
    """

    plane: Plane
    among_points: Plane
    share: float
    below_share: float
    core_share: float
    scatter: Scatter | None = None


def refine(
    points: Points,
    start: Plane,
    scoring: ScoreConfig,
    config: RefineConfig,
    distortion: Distortion = NONE,
    settle: bool = False,
) -> Fit | None:
    """Fit the plane to all points near it.

    Args:
        points: Camera frame, m.
        start: Within a few centimetres of the result.
        scoring: Threshold tau.
        config: Bands.
        distortion: Error of depth common to all points.
        settle: Narrow the band further and widen it once at the end. This excludes surfaces at a small angle
            to the floor, but needs a start close to the result.

    Returns:
        The plane, the camera on its positive side; None if too few points are near, or if they are collinear.
    """
    normal, rho = start.normal, start.offset_m
    bend = distortion.size(points.xyz[:, 2], points.sigma)
    A, B = np.zeros((2, 3, 3))
    g = np.zeros(3)
    sums = np.zeros((kernels.CELLS**2, 9))
    is_open = np.ones(len(points), dtype=np.bool_)
    near = core = below = cells = 0
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
            kernels.moments(*common, bend, wide, config.rough_m, A, g)
        else:
            near, core, below, cells = kernels.statistics(
                *common,
                bend,
                scoring.base_m,
                scoring.sigmas,
                config.narrow_sigmas,
                SHARP,
                config.rough_m,
                A,
                g,
                B,
                sums,
            )
        if not _is_regular(A):
            return None
        before, change = rho, np.linalg.solve(A, g)
        slope = -normal / rho + change
        rho = 1.0 / float(np.linalg.norm(slope))
        normal = -slope * rho
    if near < LEAST_POINTS:
        return None
    inverse = np.linalg.inv(A)
    factor = float(np.trace(inverse @ B)) / 3.0 * cells / max(cells - 3, 1)
    measured, factor = factor, max(factor, 1.0 if cells < MANY_CELLS else LEAST_FACTOR)
    J = slope_jacobian(Plane(normal, rho))
    own = J @ (factor * inverse) @ J.T
    edge = max(kernels.widest_slope(points.xyz), LEAST_EDGE)
    common = J @ common_covariance(sums, inverse, change, before, slope, distortion, edge) @ J.T
    plane = Plane(normal, rho, own + common)
    among_points = Plane(normal, rho, own)
    shares = (near / len(points), below / len(points), core / near)
    scatter = Scatter(J @ inverse @ J.T, measured, cells)
    return Fit(plane, among_points, *shares, scatter)


def core_without_bend(points: Points, plane: Plane, scoring: ScoreConfig) -> float:
    """Share of a plane's points in the core of their band once a smooth bend of the sensor is taken off.

    The bend is a least-squares quadric of the ray slopes. It straightens a floor that a sensor bends, and leaves
    stairs as they are.
    """
    z = points.xyz[:, 2]
    tau = scoring.base_m + scoring.sigmas * points.sigma * plane.offset_m / z
    units = plane.distance(points.xyz) / tau
    near = np.abs(units) < BENT_BAND
    u, v = points.xyz[near, 0] / z[near], points.xyz[near, 1] / z[near]
    shapes = quadric(u, v, 1.0) / tau[near, None]
    rest = units[near] - shapes @ np.linalg.lstsq(shapes, units[near], rcond=None)[0]
    on = np.abs(rest) < 1.0
    return float(np.sum(SHARP * np.abs(rest) < 1.0) / max(np.sum(on), 1))


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


def mixed(measured: Plane, prior: Plane, chance: float) -> Plane:
    """Mean and covariance of a plane that is the measured one with a probability, and else as the prior expects."""
    if chance >= 1.0:
        return measured
    tangents = measured.tangents
    P_prior = turned(prior.covariance, prior.tangents, tangents)
    tilt = tangents @ prior.normal / max(float(measured.normal @ prior.normal), 1e-9)
    apart = np.array([tilt[0], tilt[1], prior.offset_m - measured.offset_m])
    a, b, c = (1.0 - chance) * apart
    normal = measured.normal + a * tangents[0] + b * tangents[1]
    mean = Plane(normal / np.linalg.norm(normal), measured.offset_m + float(c))
    P = chance * measured.covariance + (1.0 - chance) * P_prior
    P = P + chance * (1.0 - chance) * np.outer(apart, apart)
    return Plane(mean.normal, mean.offset_m, turned(P, tangents, mean.tangents))


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


def slope_jacobian(plane: Plane) -> Float[np.ndarray, "3 3"]:
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
