"""Selection of the floor plane: propose a plane, refine it, and test it.

The floor is not the largest plane. It agrees with the prior, has points on it, and has no points below it. `ransac`
and `hough` propose planes by these criteria. The rest is common to both: a fit to all points, a test against
the prior with both covariances, and a test for points below. `printed` is the procedure of seed 003 without these
changes (`flow_chart`).

Source: seed 003, section 3, Fig. 4 steps 5 and 6; the choice among planes is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaincinv

from ..depth.distortion import DistortionConfig
from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.settings import setting
from . import flow_chart, hough, ransac
from .hough import HoughConfig
from .prior import HAND_HEIGHT_M, HAND_HEIGHT_SIGMA_M, gate, handheld_prior
from .refine import LEAST_POINTS, Fit, RefineConfig, core_without_bend, fuse, mixed, refine
from .sample import Sample, ScoreConfig, draw

METHODS = ("ransac", "hough", "printed")
MOST_POINTS = 40_000  # ours: more points do not improve the fit
GATE_SIGMAS = 4.0  # ours: planes farther from the prior are not searched
MOST_TILT_DEG = 60.0  # ours: steeper planes are walls, however weak the prior
LEAST_HEIGHT_M = 0.03  # ours: of a camera above the floor
LEAST_SHARE = (
    0.03  # ours: floors with 6 % of the points occur; planes with fewer than 3 % are ledges
)
LEAST_KNOWN_SHARE = 0.01  # ours: the same where the prior knows the height
MOST_BELOW = 0.02  # ours: points below per point on it; kitchen floors 0.001, tables 0.03
KNOWN_HEIGHT_M = 0.15  # ours: with a height prior this precise, points below are holes
KNOWN_TILT_DEG = 2.0  # ours: with a tilt prior as precise, nearby ramps are excluded from the fit
PLANES = 4  # ours: planes tried one after the other: ramp, landing, table, floor
LEAST_CORE = 0.45  # ours: of a plane's points; noise of thrice the model leaves .49, ramps through stairs .32-.41
FLANK = 0.5  # ours: what a point on the flanks costs once stairs are suspected; a ramp then scores below zero
LOWER_SIGMAS = 3.0  # ours: of the expected height, by which another floor is lower
HIGHEST_HAND_M = HAND_HEIGHT_M + HAND_HEIGHT_SIGMA_M  # ours: of a camera above the floor
CONFIDENCE = 0.999  # ours: of the chi-square test against the prior
DOUBT = 2.0
"""Ours: squared distance from the prior, in standard deviations, beyond which other planes are tried; one that is nearer by
as much, a factor e of likelihood, is the floor. A ramp ahead fills more of the image than the floor before it."""
OWN_SHARE = 0.1
"""Ours: share of the sample that is on the other plane alone. A tilted copy of the first has up to .06, a floor before a ramp .11
and more."""


@dataclass(frozen=True)
class FloorConfig:
    """How the floor is searched for."""

    method: str = setting(
        "ransac",
        "",
        "plane search: ransac, hough, or printed: seed 003's flow chart as published",
        "ours: fastest",
    )
    sample: ScoreConfig = field(default_factory=ScoreConfig)
    hough: HoughConfig = field(default_factory=HoughConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    distortion: DistortionConfig = field(default_factory=DistortionConfig)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"floor: method={self.method!r} is unknown; choose {', '.join(METHODS)}"
            )


@dataclass(frozen=True)
class Floor:
    """The floor measured in one depth image.

    Args:
        plane: Camera frame; normal up, offset the camera height in m, with covariance. A plane with few points may
            be a ledge; then it is the mean of the fit and the prior, weighted by its chance to be the floor.
        share: Share of all points that lie on it.
        below_share: Share of all points that lie clearly below it.
        among_points: The plane by the points alone, with its covariance relative to them: errors common to
            all points cancel in heights above it. Use this one to classify points.
    """

    plane: Plane
    share: float
    below_share: float
    among_points: Plane


def find(
    points: Points,
    prior: Plane,
    rng: np.random.Generator,
    config: FloorConfig | None = None,
    sensor: str | None = None,
) -> Floor | None:
    """Find the floor among points.

    Args:
        points: Camera frame, m, with sigma; in any order.
        prior: Predicted floor, camera frame, with covariance; see `prior`.
        rng: Draws the sample and the triples.
        config: Method.
        sensor: "tof", "stereo" or "depth", which sets the distortion of depth; None if unknown.

    Returns:
        The floor, fused with the prior (not by `printed`); None if no plane agrees with the prior, has enough
        points on it, and has no points below it.

    Source: seed 003, section 3, Fig. 4.
    """
    config = config or FloorConfig()
    if len(points) < LEAST_POINTS:
        return None
    points = thinned(points, MOST_POINTS)
    if config.method == "printed":
        printed = flow_chart.find(points, prior, rng, config.distortion.of(sensor))
        return None if printed is None else _floor(printed, printed.plane)
    searched = gate(prior, GATE_SIGMAS, math.radians(MOST_TILT_DEG), LEAST_HEIGHT_M)
    sample = draw(points, prior, searched, rng, config.sample)
    whole = sample
    best: Floor | None = None
    flank, nearest = 0.0, math.inf
    for _ in range(PLANES):
        if sample.size < (3 if best is None else OWN_SHARE * whole.size):
            break
        if config.method == "hough":
            start = hough.propose(sample, searched, rng, config.hough, config.sample, flank)
        else:
            start = ransac.propose(sample, searched, rng, config.sample, flank)
        if start is None:
            break
        fit = _fitted(points, start, prior, config, sensor, doubted=best is not None)
        explained = fit is not None and explains(points, fit, config)
        found = _verified(fit, prior) if fit is not None and explained else None
        if found is not None and (
            best is None
            or (found[1] < nearest - DOUBT and _is_other(found[0], best, whole, config.sample))
        ):
            best, nearest = found
        if nearest <= DOUBT:
            break
        folded = fit is not None and (
            not explained or (found is not None and fit.core_share < LEAST_CORE)
        )
        if folded and flank == 0.0:
            flank = FLANK  # stairs, or floor and ramp as one plane: again, for one of them
        else:
            sample = sample.without(start, config.sample)
    return best


def find_lower(
    points: Points,
    expected: Plane,
    rng: np.random.Generator,
    config: FloorConfig | None = None,
    sensor: str | None = None,
) -> Floor | None:
    """The floor of a hand-held camera if it is clearly lower than that of the images before: that was a table.

    An image that a table fills shows nothing below it. The lower plane must not be farther below the camera than a hand
    holds one: the foot of a flight of stairs, seen from its top, is.

    Args:
        points, rng, config, sensor: As for `find`.
        expected: By the images before, camera frame, with covariance.

    Returns:
        The lower floor; None if there is none, or the expected one is as weak as that of a first image.

    Source: ours.
    """
    if len(points) < LEAST_POINTS or not _is_height_known(expected):
        return None
    least_m = expected.offset_m + LOWER_SIGMAS * math.sqrt(float(expected.covariance[2, 2]))
    heights = points.xyz @ expected.normal
    if least_m > HIGHEST_HAND_M or np.mean(heights < -least_m) < LEAST_SHARE:
        return None
    found = find(points, handheld_prior(expected.normal), rng, config, sensor)
    if found is None or not least_m < found.plane.offset_m < HIGHEST_HAND_M:
        return None
    return found


def _is_other(floor: Floor, best: Floor, sample: Sample, config: ScoreConfig) -> bool:
    """Whether a plane, no ledge, is another one than the best before it: enough points are on it and not on that one."""
    if floor.share < LEAST_SHARE:
        return False
    rest = sample.without(best.among_points, config)
    own = rest.size - rest.without(floor.among_points, config).size
    return own >= OWN_SHARE * sample.size


def _fitted(
    points: Points,
    start: Plane,
    prior: Plane,
    config: FloorConfig,
    sensor: str | None,
    doubted: bool,
) -> Fit | None:
    """The plane fitted to all points; in narrow bands if the prior is precise, or doubts the plane found before."""
    tilt_sigma_rad = math.sqrt(float(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1]))
    precise = _is_height_known(prior) and tilt_sigma_rad <= math.radians(KNOWN_TILT_DEG)
    distortion = config.distortion.of(sensor)
    return refine(points, start, config.sample, config.refine, distortion, precise or doubted)


def explains(points: Points, fit: Fit, config: FloorConfig) -> bool:
    """Whether noise, and the bend of the sensor, explain the residuals of a plane; stairs are not explained."""
    if fit.core_share >= LEAST_CORE:
        return True
    return core_without_bend(points, fit.among_points, config.sample) >= LEAST_CORE


def _verified(fit: Fit, prior: Plane) -> tuple[Floor, float] | None:
    """The floor and its squared distance from the prior, if the fitted plane is one and agrees with it."""
    if not _is_floor(fit, prior):
        return None
    plane, distance = fuse(fit.plane, prior)
    if distance > 2.0 * float(gammaincinv(1.5, CONFIDENCE)):  # chi-square, 3
        return None
    doubted = mixed(plane, prior, min(1.0, fit.share / LEAST_SHARE))
    return _floor(fit, doubted), distance


def _floor(fit: Fit, plane: Plane) -> Floor:
    """A fit as the floor, with the plane that is believed."""
    return Floor(plane, fit.share, fit.below_share, fit.among_points)


def thinned(points: Points, most: int) -> Points:
    """Every k-th point, k odd so that every image column is used."""
    if len(points) <= most:
        return points
    k = -(-len(points) // most) | 1
    return Points(
        np.ascontiguousarray(points.xyz[::k]),
        np.ascontiguousarray(points.sigma[::k]),
        points.pixels[::k],
    )


def _is_height_known(prior: Plane) -> bool:
    """Whether the prior knows the height of the camera, from joints or an earlier frame."""
    return bool(prior.covariance[2, 2] <= KNOWN_HEIGHT_M**2)


def _is_floor(fit: Fit, prior: Plane) -> bool:
    """Enough points on it, not too steep, and no points below it unless the height is known."""
    height_known = _is_height_known(prior)
    if fit.share < (LEAST_KNOWN_SHARE if height_known else LEAST_SHARE):
        return False
    if float(fit.plane.normal @ prior.normal) < math.cos(math.radians(MOST_TILT_DEG)):
        return False
    return bool(height_known) or fit.below_share <= MOST_BELOW * fit.share
