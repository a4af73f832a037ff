"""Which plane is the floor: propose, refine, and make sure before believing.

The floor is not the largest plane. It is the one that agrees with the prior, has points on it and has
nothing below it. Both ways to propose a plane (`ransac`, `hough`) look for that; what follows is common:
a fit to all points, a test against the prior with both covariances, and a look at what lies below.

Source: seed 003, section 3, Fig. 4 steps 5 and 6; the choice is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaincinv

from ..depth.points import Points
from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import hough, ransac
from .hough import HoughConfig
from .prior import gate
from .ransac import RansacConfig
from .refine import Fit, RefineConfig, fuse, refine
from .sample import ScoreConfig, draw

METHODS = ("ransac", "hough")


@dataclass(frozen=True)
class FloorConfig:
    """How the floor is looked for, and when it is believed."""

    method: str = "ransac"  # or "hough", as in seed 003
    sample: ScoreConfig = field(default_factory=ScoreConfig)
    ransac: RansacConfig = field(default_factory=RansacConfig)
    hough: HoughConfig = field(default_factory=HoughConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)
    most_points: int = 40_000  # ours: more do not help: what is left is not noise
    gate_sigmas: float = 4.0  # ours: planes farther from the prior are not thought of
    most_tilt_deg: float = 60.0  # ours: however weak the prior, steeper is a wall
    least_height_m: float = 0.03  # ours: a camera lies no lower
    least_share: float = 0.03  # ours: floors of 6 % of the points occur; fewer than 3 % are ledges
    least_known_share: float = 0.01  # ours: the same where the height was known before
    most_below: float = (
        0.02  # ours: points below, per point on it; kitchen floors 0.001, tables 0.03
    )
    known_height_m: float = 0.15  # ours: a prior this sure of height may have holes below it
    planes: int = 4  # ours: so many are tried, one after the other: ramp, landing, table, floor
    known_tilt_deg: float = 2.0  # ours: one this sure of tilt too lets a ramp be left aside
    confidence: float = 0.999  # ours: of the test against the prior

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"floor: method={self.method!r} is unknown; choose {' or '.join(METHODS)}"
            )
        if self.most_points < 1000:
            raise ConfigError(f"floor: most_points={self.most_points} must be at least 1000")
        for name in ("gate_sigmas", "least_height_m", "known_height_m", "known_tilt_deg"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"floor: {name}={value} must be positive and finite")
        if not 0.0 < self.most_tilt_deg < 90.0:
            raise ConfigError(
                f"floor: most_tilt_deg={self.most_tilt_deg} must lie between 0 and 90"
            )
        if self.planes < 1:
            raise ConfigError(f"floor: planes={self.planes} must be at least 1")
        for name in ("least_share", "least_known_share", "most_below"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"floor: {name}={getattr(self, name)} must lie in [0, 1]")
        if not 0.0 < self.confidence < 1.0:
            raise ConfigError(f"floor: confidence={self.confidence} must lie between 0 and 1")


@dataclass(frozen=True)
class Floor:
    """The floor as seen.

    Args:
        plane: Camera frame; normal up, offset the camera's height in m, with covariance.
        share: Of all points that lie on it.
        below_share: Of all points that lie clearly below it.
        among_points: The plane as the points alone have it, and as sure as it is relative to them: an
            error that they all share lifts no point off the floor. Classes are told by this one.
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
    """The floor among the points, or None if it cannot be told.

    Args:
        points: Camera frame, m, with sigma; in image order, or in any.
        prior: Where the floor should be, camera frame, with covariance; see `prior`.
        rng: Chooses the sample and the triples.
        config: Method and thresholds.
        sensor: "tof", "stereo" or "depth"; says what error all points may share. None if nobody says.

    Returns:
        The floor, the prior taken in as one more measurement; None if no plane agrees with the prior, has
        enough points on it, and has nothing below it. Then the caller keeps the prior.

    Source: seed 003, section 3, Fig. 4.
    """
    config = config or FloorConfig()
    if len(points) < config.refine.least_points:
        return None
    points = _thinned(points, config.most_points)
    thought_of = gate(
        prior, config.gate_sigmas, math.radians(config.most_tilt_deg), config.least_height_m
    )
    sample = draw(points, prior, thought_of, rng, config.sample)
    for _ in range(config.planes):
        if len(sample) < 3:
            return None
        if config.method == "hough":
            start = hough.propose(sample, thought_of, rng, config.hough, config.sample)
        else:
            start = ransac.propose(sample, thought_of, rng, config.ransac, config.sample)
        if start is None:
            return None
        found = _believed(points, start, prior, config, sensor)
        if found is not None:
            return found
        sample = sample.without(start, config.sample)
    return None


def _believed(
    points: Points, start: Plane, prior: Plane, config: FloorConfig, sensor: str | None
) -> Floor | None:
    """The plane fitted to all points, if it is a floor and agrees with the prior."""
    sure_rad = math.sqrt(float(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1]))
    settle = _is_height_known(prior, config) and sure_rad <= math.radians(config.known_tilt_deg)
    fit = refine(points, start, config.sample, config.refine, sensor, settle)
    if fit is None or not _is_floor(fit, prior, config):
        return None
    plane, distance = fuse(fit.plane, prior)
    if distance > 2.0 * float(gammaincinv(1.5, config.confidence)):  # chi-square, 3
        return None
    return Floor(plane, fit.share, fit.below_share, fit.among_points)


def _thinned(points: Points, most: int) -> Points:
    """Every k-th point, k odd so that no column of the image is left out for good."""
    if len(points) <= most:
        return points
    k = -(-len(points) // most) | 1
    return Points(
        np.ascontiguousarray(points.xyz[::k]),
        np.ascontiguousarray(points.sigma[::k]),
        points.pixels[::k],
    )


def _is_height_known(prior: Plane, config: FloorConfig) -> bool:
    """Whether joints or an earlier frame say how high the camera is."""
    return bool(prior.covariance[2, 2] <= config.known_height_m**2)


def _is_floor(fit: Fit, prior: Plane, config: FloorConfig) -> bool:
    """Enough points on it, not too steep, and nothing below it where that is the only sign."""
    height_known = _is_height_known(prior, config)
    if fit.share < (config.least_known_share if height_known else config.least_share):
        return False
    if float(fit.plane.normal @ prior.normal) < math.cos(math.radians(config.most_tilt_deg)):
        return False
    return bool(height_known) or fit.below_share <= config.most_below * fit.share
