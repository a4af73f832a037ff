"""One tracked obstacle: an interacting-multiple-model filter of its position, its velocity, and the viewpoint's error.

A detection gives the position relative to the body. The pose of the body in the world has an error that hardly
changes from frame to frame; treated as independent noise it would average out, and an obstacle seen a hundred times
from a wrong pose would get a far too small covariance. The filter therefore carries the error of the viewpoint in its
state, with the covariance of the robot pose, widened by the unknown part of a partly visible shape. It drifts as odometry
does and is corrected as far as the covariance of the pose tells.

What moves obeys no law that we know. Five modes, each with a sigma-point filter, change into each other at random:

- still: it has not moved, as furniture; what pauses for long counts as still again,
- pausing: it stands, and will go on,
- straight: constant velocity,
- curving: its velocity wanders, by much if it is used to go fast,
- turned: it has taken a new velocity, in any direction; soon straight or curving.

How often it turns and stops, how long it pauses and how fast it goes are learnt from it (`habits`). Unseen, the
modes go on changing into each other, so that the covariance of the state grows as fast as that obstacle's habits ask.

Source: Yoo and Kim 2010 (seed 001), sections 2, 3 and 14 (one sigma-point filter per obstacle); Blom and Bar-Shalom
1988 (interacting multiple models); modes and viewpoint ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import Innovation
from ..filtering.models import positive
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian, deviation
from ..primitives.motion import Motion
from ..primitives.settings import setting
from . import _track_kernels
from ._track_kernels import (
    MODES,
    REST,
    SIZE,
    STILL,
    STRAIGHT,
    Belief,
)
from .habits import LONGEST_S, STRAIGHT_M2PS3, Habits, pushes

PLACE, VELOCITY, VIEW = slice(0, 2), slice(2, 4), slice(4, 7)
"""Entries: x, y; vx, vy of the obstacle; error of the viewpoint in x, y, yaw; m, m/s, rad, world axes."""

FORGOTTEN = 30.0  # memories after which a float keeps nothing of a shift: e^-30 is 1e-13
SHAPE_MEMORY_S = 5.0  # ours: time in which the shift of a partly visible centre decays to 1/e
DRIFT_M2PS, DRIFT_RAD2PS = 0.003**2, math.radians(0.15) ** 2
"""Ours: growth of the variances of a pose by odometry, per axis and of the heading, per second; wide for a walk."""

STAYS_S = 30.0  # ours: what stays in its place for so long, while it is watched, moves with the prior probability
SLOW_MPS = 0.03  # seed 001: the slowest obstacles
TRAVEL_SHARE = 0.7  # ours: travel, in radii, without which an obstacle is not moving
UNSURE = 0.5  # largest probability of moving without proof
PROOF = 3.0  # ours: about log(20), likelihood ratio that proves motion; noise often reaches a lower one for an instant
STRAY_PER_M2 = 1.0  # ours: density of stray detections
NEW_PER_M2 = 0.02  # ours: density of new obstacles per frame
RADIUS_SIGMA_M = 0.012  # ours: of the radius between two complete views of an obstacle by depth
UNLIKE_SHARE = 0.0001  # ours: share of the likelihood left to a detection of another size


@dataclass(frozen=True)
class TrackConfig:
    """Motion of obstacles, and errors of their detections."""

    speed_sigma_mps: float = setting(
        0.075,
        "m/s",
        "standard deviation of an obstacle's speed per axis, before it has been seen to move",
        "ours: wide; seed 001 has 0.03 to 0.15",
    )
    moving_prior: float = setting(
        0.25, "", "prior probability that an obstacle moves", "seed 001: 4 of 16 obstacles"
    )
    shape_per_m: float = (
        0.4  # ours: error of a partly visible centre is this times radius squared, m
    )

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed_sigma_mps) and self.speed_sigma_mps > 0.0):
            raise ConfigError(
                f"track: speed_sigma_mps={self.speed_sigma_mps} must be positive and finite"
            )
        if not 0.0 < self.moving_prior < 1.0:
            raise ConfigError(f"track: moving_prior={self.moving_prior} must lie between 0 and 1")
        if not self.shape_per_m >= 0.0:
            raise ConfigError(f"track: shape_per_m={self.shape_per_m} must not be negative")


@dataclass(frozen=True)
class Detection:
    """An obstacle detected in one frame.

    Args:
        position: Of its centre on the floor, body frame, m.
        covariance: Of that position by the sensor alone, m^2.
        radius_m: Of its covering disc.
        height_m: Height of its top above the floor.
        surface: Points on its front, horizontally in the body frame, z in the map, m; none if not known.
        radius_sigma_m: Standard deviation of the radius between two detections of one obstacle, m.
    """

    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float = 0.0
    surface: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))
    radius_sigma_m: float = RADIUS_SIGMA_M


class Track:
    """The filter of one obstacle."""

    def __init__(self, seen: Detection, robot: Gaussian, config: TrackConfig) -> None:
        """Start at the first detection with an unknown velocity."""
        self.config = config
        self.radius_m = seen.radius_m
        self.height_m = seen.height_m
        self._look_from(robot)
        c, s = math.cos(self._robot[2]), math.sin(self._robot[2])
        R = np.array([[c, -s], [s, c]])
        arm = R @ seen.position
        by_view = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
        view = self._view
        x, P = np.zeros((MODES, SIZE)), np.zeros((MODES, SIZE, SIZE))
        x[:, PLACE] = self._robot[:2] + arm
        P[:, PLACE, PLACE] = by_view @ view @ by_view.T + R @ seen.covariance @ R.T
        P[:, PLACE, VIEW] = by_view @ view
        P[:, VIEW, PLACE] = (by_view @ view).T
        P[:, VIEW, VIEW] = view
        P[:STRAIGHT, VELOCITY, VELOCITY] = np.eye(2) * REST
        P[STRAIGHT:, VELOCITY, VELOCITY] = np.eye(2) * config.speed_sigma_mps**2
        p = config.moving_prior
        weights = np.array([1.0 - p, 0.3 * p, 0.3 * p, 0.3 * p, 0.1 * p])
        self._belief = Belief(weights, x, np.array([positive(one) for one in P]))
        self._unseen_s = 0.0
        self._habits, self._mover = Habits(config.speed_sigma_mps), 0.0
        self._begin_anew(x[0], seen.radius_m)
        self._gone = self._going()
        self._state: Gaussian | None = None
        self._motion: Motion | None = None
        self._expected: tuple[np.ndarray, np.ndarray] | None = None

    def _begin_anew(self, x: Float[np.ndarray, "7"], radius_m: float) -> None:
        """Measure travel from a place, without proof of motion."""
        self._first_x, self._first_y = x[:2].tolist()
        self._first_radius_m = radius_m
        self._travelled = self._watched_s = self._stays_s = 0.0
        self._here = self._first_x, self._first_y
        self._proven = False
        self._prior_odds = _log_odds(1.0 - float(self._belief.w[STILL]))

    @property
    def moving(self) -> float:
        """Probability that it is one that moves, in [0, 1), whether it pauses at present or not.

        The centre of a partly visible obstacle shifts as the robot passes it, by part of its radius, and by
        as much as the visible part grows or shrinks: less that, the distance is how far both its leading and its
        trailing edge have moved. An obstacle that has not travelled farther than that may be
        static, however steadily its centre shifts. A slow mover needs time to travel that far; until then
        the probability is at most the prior. A mover that was lost has to prove its motion again. It exceeds `UNSURE` only after a likelihood ratio that noise hardly reaches.
        """
        may = 1.0 - float(self._belief.w[STILL])
        far = TRAVEL_SHARE * self.radius_m
        left = min(1.0, self._travelled / max(min(far, SLOW_MPS * self._watched_s), 1e-6))
        early = max(1.0 - SLOW_MPS * self._watched_s / max(far, 1e-6), 0.0)
        found = may * left + early * min(may, self.config.moving_prior) * (1.0 - left)
        return found if self._proven else min(found, UNSURE)

    @property
    def state(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame: mixture of all modes."""
        if self._state is None:
            mean, covariance = np.empty(4), np.empty((4, 4))
            _track_kernels.merge(*self._belief, mean, covariance)
            self._state = Gaussian(mean, covariance)
        return self._state

    @property
    def motion(self) -> Motion:
        """Its modes, and how it changes between them."""
        if self._motion is None:
            w, x, P = self._belief
            means, covariances = x[:, :4].copy(), P[:, :4, :4].copy()
            self._motion = Motion(
                w.copy(), means, covariances, self._rates(), self._habits.fresh, self._straight()
            )
        return self._motion

    def _straight(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame, if it moves and has gone straight on since it was seen."""
        mean, covariance = (part.copy() for part in self._gone)
        ahead = Belief(np.ones(1), mean[None], covariance[None])
        _track_kernels.drift(ahead, self._unseen_s, np.array([STRAIGHT_M2PS3]))
        return Gaussian(mean, covariance)

    def predict(self, dt: float, robot: Gaussian) -> None:
        """Predict dt seconds in every mode, and take over the new pose of the robot.

        The motion is linear, so matrices give the same result as sigma points.
        """
        before = self._view
        self._look_from(robot)
        belief = self._belief
        if dt > 0.0:
            rates, fresh = self._rates(), self._habits.fresh
            self._habits.pass_time(belief.w, rates, dt)
            chances = _track_kernels.changes(rates, 0.5 * dt)
            _track_kernels.go_on(belief, chances, fresh, dt, pushes(fresh))
        shifts = self._wander_m2 * math.expm1(min(dt / SHAPE_MEMORY_S, FORGOTTEN))
        drift = np.full(3, shifts + DRIFT_M2PS * dt)
        drift[2] = DRIFT_RAD2PS * dt
        _track_kernels.look_from(belief, *_track_kernels.renewal(before, drift, self._view))
        self._unseen_s += dt
        self._state = self._motion = self._expected = None

    def density(
        self, positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 2 2"]
    ) -> Float[np.ndarray, "n"]:
        """Probability density of each detection if it is of this obstacle, per square metre.

        Args:
            positions: Of the detections, body frame, m.
            covariances: Of those by the sensor alone, m^2.
        """
        means, expected = self._expectations()
        found: np.ndarray = _track_kernels.density(
            self._belief.w, means, expected, _contiguous(positions), _contiguous(covariances)
        )
        return found

    def update(self, seen: Detection) -> Innovation:
        """Update every mode with a detection, and weigh the modes; returns the innovation of their mixture."""
        if self._lost():
            self._doubt_motion(self._same(seen))
        means, covariances = self._expectations()
        w, x, P = self._belief
        mean, covariance = np.empty(2), np.empty((2, 2))
        _track_kernels.merge(w, means, covariances, mean, covariance)
        innovation = _whitened(seen, mean, covariance)
        position, noise = _contiguous(seen.position), _contiguous(seen.covariance)
        _track_kernels.weigh(w, means, covariances, position, noise, STRAY_PER_M2)
        for m in range(MODES):
            _track_kernels.learn(x[m], P[m], self._robot, position, noise)
        self._habits.learn(w, self._gone[0][VELOCITY], self._unseen_s, self._mover)
        self._watched_s += self._unseen_s
        self._stays_s += min(self._unseen_s, LONGEST_S)
        self._unseen_s = 0.0
        self._gone = self._going()
        self._state = self._motion = self._expected = None
        still = float(w[STILL])
        self._proven |= _log_odds(1.0 - still) - self._prior_odds > PROOF
        self._mover = 1.0 if self._proven else self._mover
        self.radius_m = max(seen.radius_m, 0.9 * self.radius_m + 0.1 * seen.radius_m)
        x0, y0 = self.state.mean[:2].tolist()
        distance = math.hypot(x0 - self._first_x, y0 - self._first_y)
        resized = abs(self.radius_m - self._first_radius_m)
        self._travelled = max(self._travelled, distance - resized)
        self.height_m = max(seen.height_m, self.height_m)
        if math.dist((x0, y0), self._here) > self.radius_m:
            self._here, self._stays_s = (x0, y0), 0.0
        elif self._stays_s > STAYS_S and still < 1.0 - self.config.moving_prior:
            self._doubt_motion(0.0)
        return Innovation(None, np.array(innovation))

    def _lost(self) -> bool:
        """Whether a known mover may be outside its own disc: what is detected then may be another obstacle.

        As seen from the robot: an error of its pose moves all that it expects alike.
        """
        if not self._proven:
            return False
        mean, covariance = np.empty(2), np.empty((2, 2))
        _track_kernels.merge(self._belief.w, *self._expectations(), mean, covariance)
        return deviation(covariance) > self.radius_m

    def _same(self, seen: Detection) -> float:
        """Probability that a detection associated with this obstacle is of it, and not of a new one."""
        own = self.density(seen.position[None], seen.covariance[None])[0]
        own *= alike(np.array(seen.radius_m - self.radius_m), seen.radius_sigma_m)
        return float(own / (own + NEW_PER_M2))

    def _doubt_motion(self, same: float) -> None:
        """Mix with an obstacle anywhere in the mixture that moves with the prior probability; ask for a new proof.

        Args:
            same: Probability that it is this obstacle.
        """
        w, x, P = self._belief
        mean, covariance = np.empty(SIZE), np.empty((SIZE, SIZE))
        _track_kernels.merge(w, x, P, mean, covariance)
        mean[VELOCITY] = 0.0
        covariance[VELOCITY] = 0.0
        covariance[:, VELOCITY] = 0.0
        covariance[VELOCITY, VELOCITY] = np.eye(2) * REST
        x[STILL], P[STILL] = mean, covariance
        still = same * w[STILL] + (1.0 - same) * (1.0 - self.config.moving_prior)
        w[STILL] = 0.0
        w *= (1.0 - still) / w.sum()
        w[STILL], self._mover = still, same
        self._begin_anew(mean, self.radius_m)
        self._state = self._motion = self._expected = None

    def _rates(self) -> Float[np.ndarray, "5 5"]:
        return self._habits.rates(self._mover)

    def _going(self) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "4 4"]]:
        """Mean and covariance over (x, y, vx, vy) if it does not stand."""
        w, x, P = self._belief
        mean, covariance = np.empty(4), np.empty((4, 4))
        weights = w[STRAIGHT:] / w[STRAIGHT:].sum()
        _track_kernels.merge(weights, x[STRAIGHT:], P[STRAIGHT:], mean, covariance)
        return mean, covariance

    def _expectations(self) -> tuple[np.ndarray, np.ndarray]:
        """Predicted measurements of the modes, (m, 2) and (m, 2, 2)."""
        if self._expected is None:
            means, covariances = np.empty((MODES, 2)), np.empty((MODES, 2, 2))
            _track_kernels.expect(self._belief, self._robot, means, covariances)
            self._expected = means, covariances
        return self._expected

    def _look_from(self, robot: Gaussian) -> None:
        """Set the viewpoint: the pose of the robot, and the shift of a partly visible centre.

        The shift grows with the size: a small obstacle is seen whole, of furniture another side each time.
        """
        self._robot, self._view = _contiguous(robot.mean), _contiguous(robot.covariance)
        self._wander_m2 = (self.config.shape_per_m * self.radius_m**2) ** 2
        self._view[[0, 1], [0, 1]] += self._wander_m2


def alike(
    difference_m: Float[np.ndarray, "..."], sigma_m: Float[np.ndarray, "n"] | float
) -> Float[np.ndarray, "..."]:
    """Likelihood of a difference between the radii of a detection and a track, m, against that of a new obstacle."""
    return np.asarray(np.maximum(np.exp(-0.5 * (difference_m / sigma_m) ** 2), UNLIKE_SHARE))


def _log_odds(probability: float) -> float:
    p = min(max(probability, 1e-12), 1.0 - 1e-12)
    return math.log(p / (1.0 - p))


def _contiguous(array: np.ndarray) -> np.ndarray:
    """A writable C-ordered copy of doubles, as compiled code needs it."""
    return np.array(array, np.float64, order="C")


def _whitened(seen: Detection, mean: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """The innovation divided by the Cholesky root of its covariance, as in `Innovation.of`."""
    (a, _), (b, d) = (covariance + seen.covariance).tolist()
    x, y = (seen.position - mean).tolist()
    first = math.sqrt(a)
    low = b / first
    x /= first
    return x, (y - low * x) / math.sqrt(d - low * low)
