"""Where am I on the floor: odometry and sightings of known landmarks, with what spoils both as part of the state.

Wheels turn a little more or less than they tell; a camera that takes distance from the size of a tag errs the
same way for a while; its lens bends bearings at the rim; and a tag is never seen exactly where the map has it.
Taken for noise that is new every time, each of these would be averaged away by the hundred sightings of a
robot that stands, and the filter would be sure of a wrong place. They are states instead: the error of what
odometry tells, of depth, bearing and lens, and a displacement for each of the landmarks seen last.

A sighting is (depth, bearing): the distance along the optical axis, not along the ray, for that is what the
size of a tag tells. Its noise grows with the square of the depth.

Nothing here needs the truth to be tuned: `follow` gives the likelihood of all innovations, and
`planar_fit.fit` looks for the parameters that make it largest.

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


@dataclass(frozen=True)
class PlanarConfig:
    """Noise of odometry and sightings; order as in the kernels. First guesses: `fit` finds better ones."""

    along: float = 0.05  # ours: m per root of a metre travelled
    across: float = 0.03  # ours: likewise
    turn_per_path: float = 0.02  # ours: rad per root of a metre
    turn_per_turn: float = 0.1  # ours: rad per root of a radian turned
    turn_per_time: float = 0.002  # ours: rad per root of a second
    pace_walk: float = 1e-4  # ours: per root of a second; wheels hardly change
    turn_walk: float = 1e-4  # ours: likewise
    drift_walk: float = 1e-5  # ours: rad/s per root of a second
    lens_walk: float = 1e-5  # ours: rad per root of a second; a lens hardly changes
    offset: float = 0.04  # ours: m, depth told of a tag at the body's middle
    scale: float = 1.01  # ours: depth told per depth
    depth_near: float = 0.01  # ours: m, deviation of depth close by
    depth_far: float = 0.001  # ours: 1/m, its growth with the square of depth
    bearing_sigma: float = 0.004  # ours: rad, about two pixels
    bearing_turning: float = 0.04  # ours: s, bearing error by turning, exposure and stamps
    depth_shared: float = 1.0  # ours: error common to all depths, in their own deviations
    depth_memory: float = 10.0  # ours: s, how long it stays
    bearing_shared: float = 0.008  # ours: rad, error common to all bearings
    bearing_memory: float = 5.0  # ours: s
    place: float = 0.02  # ours: m, a tag against its place on the map, per axis
    place_memory: float = 30.0  # ours: s; from elsewhere it is another error
    outlier: float = 0.01  # ours: share of sightings that mean nothing
    outlier_density: float = 0.15  # 1 / (7 m by 1 rad): the view of a small camera
    gate: float = (
        25.0  # ours: normalised innovation squared that is still believed, five deviations
    )
    doubt_after: int = 6  # ours: sightings in a row, rejected, before doubting oneself
    doubt_m: float = 0.3  # ours: deviation added then, twice as much every next time
    doubt_rad: float = 0.3  # ours: likewise

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"planar: {name}={value} must be positive and finite")
        if self.outlier >= 1.0:
            raise ConfigError(f"planar: outlier={self.outlier} is a share and must lie below 1")

    @property
    def vector(self) -> Float[np.ndarray, "27"]:
        """All values in order."""
        return np.array(dataclasses.astuple(self), float)


@dataclass(frozen=True)
class PlanarPrior:
    """What is unknown at the start beside the pose, and how many displacements are kept in mind."""

    pace_sigma: float = 0.05  # ours: travel per travel told, around 1
    turn_sigma: float = 0.05  # ours: turn per turn told, around 1
    drift_sigma: float = 0.005  # ours: rad/s
    lens_sigma: float = 0.02  # ours: rad at half a radian off the axis, about 1 deg
    slots: int = 4  # ours: landmarks in view at a time; more cost cubically and told little

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"planar: {name}={value} must not be negative")

    def state(self, pose: Gaussian, config: PlanarConfig) -> Gaussian:
        """The whole state at the start, from a pose (x, y, yaw)."""
        if pose.mean.shape != (3,) or not np.all(np.isfinite(pose.mean)):
            raise ConfigError(f"planar: start {pose.mean} must be a finite (x, y, yaw)")
        size = kernels.SIZE + 2 * self.slots
        mean, sigma = np.zeros(size), np.full(size, config.place)
        mean[:3], mean[kernels.PACE], mean[kernels.TURN] = pose.mean, 1.0, 1.0
        sigma[3 : kernels.SIZE] = (
            self.pace_sigma,
            self.turn_sigma,
            self.drift_sigma,
            config.depth_shared,
            config.bearing_shared,
            self.lens_sigma,
            self.lens_sigma,
        )
        covariance = np.diag(sigma**2)
        covariance[:3, :3] = pose.covariance
        return Gaussian(mean, positive(covariance))


@dataclass(frozen=True)
class Journey:
    """What odometry and a camera told, instant by instant.

    Args:
        start: Pose (x, y, yaw) before the first instant, m and rad, world frame.
        steps: (n, 3) time passed, s, path, m, and turn, rad, since the instant before.
        first_row: (n + 1,) the sightings of instant i are rows first_row[i] to first_row[i + 1].
        marks: (r,) index of the landmark into `places`.
        seen: (r, 2) depth along the optical axis, m, and bearing, rad, left positive.
        places: (l, 2) of the landmarks, m, world frame.
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
class Followed:
    """What the filter made of a journey.

    Args:
        means: (n, 3) x, y, yaw at each instant, after its sightings.
        covariances: Of these.
        status: Of each sighting: 1 used, 0 outside the gate, -1 not finite.
        whitened: Innovation of each sighting; zero where not finite.
        log_likelihood: Of all sightings, by their innovations; outliers count as such.
        final: Mean of the whole state at the end, entries as in the kernels.
    """

    means: Float[np.ndarray, "n 3"]
    covariances: Float[np.ndarray, "n 3 3"]
    status: Int8[np.ndarray, "r"]
    whitened: Float[np.ndarray, "r 2"]
    log_likelihood: float
    final: Float[np.ndarray, "s"]


def weights(size: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Sigma points as the kernels take them; all weights positive for any size (cubature points)."""
    points = SigmaPoints.scaled(size, alpha=1.0, beta=0.0)
    return points.reach, points.mean, points.covariance


def follow(
    journey: Journey, config: PlanarConfig | None = None, prior: PlanarPrior | None = None
) -> Followed:
    """Filter a whole journey in one compiled call."""
    config, prior = config or PlanarConfig(), prior or PlanarPrior()
    state = prior.state(journey.start, config)
    root = np.linalg.cholesky(state.covariance)
    means, covariances, status, whitened, likelihood = kernels.follow(
        state.mean,
        root,
        journey.steps,
        journey.first_row,
        journey.marks,
        journey.seen,
        journey.places,
        config.vector,
        weights(len(state.mean)),
    )
    return Followed(means, covariances, status, whitened, float(likelihood), state.mean)


class PlanarFilter:
    """The same from instant to instant: `predict` moves it, `update` learns from a landmark."""

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
            places: Where each landmark is, m, world frame, by its number.
            config: Noise; the defaults if None.
            prior: What is unknown beside the pose.
        """
        self.config, self.prior = config or PlanarConfig(), prior or PlanarPrior()
        state = self.prior.state(start, self.config)
        self._mean, self._root = state.mean, np.linalg.cholesky(state.covariance)
        self._places = {number: np.array(place, float) for number, place in places.items()}
        self._p, self._weights = self.config.vector, weights(len(state.mean))
        self._scratch = kernels.scratch_space(len(state.mean))
        self._held, self._used = np.full(self.prior.slots, -1), np.zeros(self.prior.slots)
        self._trust = np.zeros(2, np.int64)
        self._clock = self._rate = 0.0

    @property
    def pose(self) -> Gaussian:
        """Over (x, y, yaw), m and rad, world frame; yaw in [-pi, pi)."""
        return Gaussian(self._mean[:3].copy(), self._root[:3, :3] @ self._root[:3, :3].T)

    def predict(self, dt: float, path: float, turn: float) -> bool:
        """Advance; False, and nothing has changed, if an argument is not finite or time runs back.

        Args:
            dt: Time passed, s.
            path: Way driven since, m, forwards positive, by odometry.
            turn: Turn since, rad, by odometry.
        """
        if not (math.isfinite(dt + path + turn) and dt >= 0.0):
            return False
        self._clock += dt
        self._rate = turn / dt if dt > 1e-3 else 0.0
        return bool(
            kernels.move(
                self._mean, self._root, dt, path, turn, self._p, self._weights, self._scratch
            )
        )

    def update(self, mark: int, measured: Float[np.ndarray, "2"]) -> bool:
        """Learn from a landmark; returns whether it was believed.

        When several in a row are not, the filter doubts its pose, each time more, until some are again.

        Args:
            mark: Its number; an unknown one is not believed.
            measured: Depth, m, and bearing, rad, left positive.
        """
        place = self._places.get(mark)
        if place is None:
            return False
        status, _ = kernels.learn(
            self._mean, self._root, mark, place, np.asarray(measured, float), self._rate, self._clock,
            self._held, self._used, self._trust, self._p, self._weights, self._scratch,
        )  # fmt: skip
        return bool(status == 1)
