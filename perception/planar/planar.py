"""Planar localisation by odometry and sightings of known landmarks, with their systematic errors as states.

Wheel odometry has scale errors; a camera that measures distance by the size of a tag has a slowly varying
bias; its lens distorts bearings at the rim; and the map position of a tag is inaccurate. If these errors were
modelled as white noise, the hundred sightings of a standing robot would average them out and the filter would
be overconfident. So they are states: the errors of odometry, depth, bearing and lens, and a displacement for
each of the landmarks seen last.

A sighting is (depth, bearing): the distance along the optical axis, not along the ray, because the size of a
tag depends on it. Its noise grows with the square of the depth. A radio beacon gives a range without a bearing:
(range, NaN).

Tuning needs no ground truth: `filter_journey` returns the likelihood of all innovations, and `planar_fit.fit`
maximises it.

Source: seed 001, sections 2, 3 (sigma-point filter); maximum likelihood by innovations after Schweppe (1965);
the states are ours.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Int8

from ..filtering.models import positive
from ..filtering.square_root import SigmaPoints
from ..primitives.errors import ConfigError, InputError
from ..primitives.gaussian import Gaussian
from . import _planar_kernels as kernels
from .config import PlanarConfig


@dataclass(frozen=True)
class PlanarPrior:
    """Uncertainty of the initial state beside the pose, and the number of landmark displacements estimated."""

    odometry_scale_sigma: float = 0.05  # ours: true distance per odometry distance, around 1
    turn_scale_sigma: float = 0.05  # ours: true turn per odometry turn, around 1
    drift_sigma: float = 0.005  # ours: rad/s
    gain_sigma: float = 0.0  # of the scale of depths, around that of the configuration
    offset_sigma: float = 0.0  # m, likewise of their offset
    lens_sigma: float = 0.02  # ours: rad at half a radian from the axis, about 1 deg
    slots: int = 4  # ours: landmarks in view at a time; the cost is cubic and more hardly help

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"planar: {name}={value} must not be negative")

    def state(self, pose: Gaussian, config: PlanarConfig) -> Gaussian:
        """The initial state, from a pose (x, y, yaw), or from the first entries of a state, up to `OFFSET`."""
        known = len(pose.mean)
        if known not in (3, kernels.OFFSET + 1) or not np.all(np.isfinite(pose.mean)):
            raise ConfigError(f"planar: start {pose.mean} must be a finite (x, y, yaw)")
        size = kernels.SIZE + 2 * self.slots
        mean, sigma = np.zeros(size), np.full(size, config.place)
        mean[kernels.ODOMETRY_SCALE], mean[kernels.TURN_SCALE] = 1.0, 1.0
        mean[:known] = pose.mean
        sigma[3 : kernels.SIZE] = (
            self.odometry_scale_sigma,
            self.turn_scale_sigma,
            self.drift_sigma,
            self.gain_sigma,
            self.offset_sigma,
            config.depth_shared,
            config.bearing_shared,
            self.lens_sigma,
            self.lens_sigma,
        )
        covariance = np.diag(sigma**2)
        covariance[:known, :known] = pose.covariance
        return Gaussian(mean, positive(covariance))


@dataclass(frozen=True)
class Journey:
    """Odometry and sightings of a run, instant by instant.

    Args:
        start: Pose (x, y, yaw) before the first instant, m and rad, world frame.
        steps: (n, 3) time, s, path length, m, and turn, rad, since the previous instant.
        first_row: (n + 1,) the sightings of instant i are rows first_row[i] to first_row[i + 1].
        marks: (r,) index of the landmark into `places`.
        seen: (r, 2) depth along the optical axis, m, and bearing, rad, left positive; or range, m, and NaN.
        places: (l, 2) positions of the landmarks, m, world frame.
    """

    start: Gaussian
    steps: Float[np.ndarray, "n 3"]
    first_row: Int[np.ndarray, "n_plus_1"]
    marks: Int[np.ndarray, "r"]
    seen: Float[np.ndarray, "r 2"]
    places: Float[np.ndarray, "l 2"]

    def __post_init__(self) -> None:
        if len(self.first_row) != len(self.steps) + 1 or len(self.marks) != len(self.seen):
            raise InputError(
                f"journey: {len(self.steps)} steps need {len(self.steps) + 1} first rows and as many "
                f"marks as sightings; got {len(self.first_row)}, {len(self.marks)}, {len(self.seen)}"
            )
        if len(self.marks) and (self.marks.min() < 0 or self.marks.max() >= len(self.places)):
            raise InputError(
                f"journey: marks {self.marks.min()} to {self.marks.max()} must index "
                f"{len(self.places)} places"
            )


@dataclass(frozen=True)
class FilteredJourney:
    """Result of the filter on a run.

    Args:
        means: (n, 3) x, y, yaw at each instant, after its sightings.
        covariances: Of these.
        status: Of each sighting: 1 used, 0 outside the gate, -1 not finite.
        whitened: Innovation of each sighting; zero where not finite.
        log_densities: (r,) of each sighting by its innovation, outliers included; zero where not finite.
        final: Mean of the whole state at the end, entries as in the kernels.
    """

    means: Float[np.ndarray, "n 3"]
    covariances: Float[np.ndarray, "n 3 3"]
    status: Int8[np.ndarray, "r"]
    whitened: Float[np.ndarray, "r 2"]
    log_densities: Float[np.ndarray, "r"]
    final: Float[np.ndarray, "s"]

    @property
    def log_likelihood(self) -> float:
        """Of all sightings."""
        return float(np.sum(self.log_densities))


def sigma_weights(size: int) -> kernels.Weights:
    """Sigma points for the kernels, with positive weights for any size (cubature points)."""
    points = SigmaPoints.scaled(size, alpha=1.0, beta=0.0)
    return kernels.Weights(points.reach, points.mean, points.covariance)


def filter_journey(
    journey: Journey, config: PlanarConfig | None = None, prior: PlanarPrior | None = None
) -> FilteredJourney:
    """Filter a whole run in one compiled call."""
    config, prior = config or PlanarConfig(), prior or PlanarPrior()
    state = prior.state(journey.start, config)
    root = np.linalg.cholesky(state.covariance)
    means, covariances, status, whitened, densities = kernels.filter_journey(
        state.mean,
        root,
        journey.steps,
        journey.first_row,
        journey.marks,
        journey.seen,
        np.ascontiguousarray(journey.places),
        config.parameters,
        sigma_weights(len(state.mean)),
    )
    return FilteredJourney(means, covariances, status, whitened, densities, state.mean)


class PlanarFilter:
    """The same filter, instant by instant."""

    def __init__(
        self,
        start: Gaussian,
        places: Mapping[int, tuple[float, float]],
        config: PlanarConfig | None = None,
        prior: PlanarPrior | None = None,
    ) -> None:
        """Begin at a pose.

        Args:
            start: Over (x, y, yaw), m and rad, world frame.
            places: Position of each landmark, m, world frame, by its number.
            config: Noise; the defaults if None.
            prior: Uncertainty of the other states.
        """
        self.config, self.prior = config or PlanarConfig(), prior or PlanarPrior()
        state = self.prior.state(start, self.config)
        self._mean, self._root = state.mean, np.linalg.cholesky(state.covariance)
        self._places = {number: np.array(place, float) for number, place in places.items()}
        self._p, self._weights = self.config.parameters, sigma_weights(len(state.mean))
        self._scratch = kernels.scratch_space(len(state.mean))
        self._held, self._used = np.full(self.prior.slots, -1), np.zeros(self.prior.slots)
        self._trust = np.zeros(2, np.int64)
        self._time_s = self._rate = 0.0

    @property
    def pose(self) -> Gaussian:
        """Over (x, y, yaw), m and rad, world frame; yaw in [-pi, pi)."""
        return Gaussian(self._mean[:3].copy(), self._root[:3, :3] @ self._root[:3, :3].T)

    @property
    def state(self) -> Float[np.ndarray, "s"]:
        """Mean of the whole state, entries as in the kernels; a copy."""
        return self._mean.copy()

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the last finite sighting, used or not."""
        return float(self._scratch.innovation @ self._scratch.innovation)

    def predict(self, dt: float, path: float, turn: float) -> bool:
        """Advance; False without any change if an argument is not finite or time runs backwards.

        Args:
            dt: Time passed, s.
            path: Path length since, m, forwards positive, by odometry.
            turn: Turn since, rad, by odometry.
        """
        if not (math.isfinite(dt + path + turn) and dt >= 0.0):
            return False
        self._time_s += dt
        self._rate = turn / dt if dt > 1e-3 else 0.0
        return bool(
            kernels.move(
                self._mean, self._root, dt, path, turn, self._p, self._weights, self._scratch
            )
        )

    def update(self, mark: int, measured: Float[np.ndarray, "2"]) -> bool:
        """Update with a landmark; returns whether the sighting was used.

        After several rejected sightings in a row the pose covariance is inflated, more each time, until some are used.

        Args:
            mark: Number of the landmark; unknown ones are rejected.
            measured: Depth, m, and bearing, rad, left positive; or range, m, and NaN.
        """
        place = self._places.get(mark)
        if place is None:
            return False
        status, _ = kernels.update(
            self._mean, self._root, mark, place, np.asarray(measured, float), self._rate, self._time_s,
            self._held, self._used, self._trust, self._p, self._weights, self._scratch,
        )  # fmt: skip
        return bool(status == 1)
