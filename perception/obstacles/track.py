"""One tracked obstacle: a sigma-point filter of its position, its velocity, and the error of the viewpoint.

A detection gives the position relative to the body. The pose of the body in the world has an error that hardly
changes from frame to frame; treated as independent noise it would average out, and an obstacle seen a hundred times
from a wrong pose would get a far too small covariance. The filter therefore carries the error of the viewpoint in its
state, with the covariance of the robot pose, widened by the unknown part of a partly visible shape; it decays slowly.

The same filter decides whether the obstacle moves. "Static" is the hypothesis v = 0, and the evidence is the ratio of
its density at v = 0 after and before the detections (Savage-Dickey ratio). No second filter is needed, and a drift
that the viewpoint explains is no evidence.

An unseen obstacle may have reversed. The filter predicts constant velocity; the reported state is a mixture of that
and of a random telegraph signal, and the next detection weighs both. The same hypotheses give the density of a
detection for data association: a static track does not take the detection of a mover that passes by. A static
obstacle stays at its last position. Missing detections do not change the probability of moving.

Source: Yoo and Kim 2010 (seed 001), sections 2, 3 and 14 (one sigma-point filter per obstacle); viewpoint and
evidence ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import Innovation
from ..filtering.models import positive
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from ..primitives.settings import setting
from . import _track_kernels
from ._track_kernels import SIZE, Belief

PLACE, VELOCITY, VIEW = slice(0, 2), slice(2, 4), slice(4, 7)
"""Entries: x, y; vx, vy of the obstacle; error of the viewpoint in x, y, yaw; m, m/s, rad, world axes."""

VIEW_MEMORY_S = 5.0  # ours: time in which the error of the robot pose decays to 1/e
MEMORY_S = 20.0  # ours: decay of the evidence of having moved
START_PROBABILITY = 0.001  # ours: per frame, that a static obstacle starts to move
NOTICE_S = 1.0  # ours: delay after which a turn in view is noticed
SLOW_MPS = 0.03  # seed 001: the slowest obstacles
TRAVEL_SHARE = 0.7  # ours: travel, in radii, without which an obstacle is not moving
UNSURE = 0.5  # largest probability of moving without proof
PROOF = 3.0  # ours: about log(20), likelihood ratio that proves motion; noise often reaches a lower one for an instant
MOST_EVIDENCE = 5.0  # ours: log-odds of having moved that are kept, so that a stop is noticed
STRAY_PER_M2 = 1.0  # ours: density of stray detections
LAG = 0.7  # ours: decay per frame of the sum of innovations that shows a turn
FIRST_TURN_S = 30.0  # ours: time in motion that one turn is worth before any is seen


@dataclass(frozen=True)
class TrackConfig:
    """Motion of obstacles, and errors of their detections."""

    speed_sigma_mps: float = setting(
        0.06, "m/s", "standard deviation of an obstacle's speed per axis", "seed 001: 0.03 to 0.15"
    )
    moving_prior: float = setting(
        0.25, "", "prior probability that an obstacle moves", "seed 001: 4 of 16 obstacles"
    )
    acceleration_mps2: float = 0.008  # ours: random acceleration per frame
    shape_per_m: float = (
        0.4  # ours: error of a partly visible centre is this times radius squared, m
    )

    def __post_init__(self) -> None:
        for name in ("speed_sigma_mps", "acceleration_mps2"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"track: {name}={value} must be positive and finite")
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
    """

    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float = 0.0
    surface: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))


class Track:
    """The filter of one obstacle."""

    def __init__(self, seen: Detection, robot: Gaussian, config: TrackConfig) -> None:
        """Start at the first detection with an unknown velocity."""
        self.config = config
        self._turns, self._moved_s = 1.0, FIRST_TURN_S
        self.radius_m = seen.radius_m
        self.height_m = seen.height_m
        self._look_from(robot)
        self._evidence, self._proven = -MOST_EVIDENCE, False
        self._unseen_s = 0.0
        self._static = Belief(np.zeros(SIZE), np.zeros((SIZE, SIZE)))  # as last seen
        self._is_static = False  # whether `_static` is valid
        self._lag = 0.0, 0.0
        c, s = math.cos(self._robot[2]), math.sin(self._robot[2])
        R = np.array([[c, -s], [s, c]])
        arm = R @ seen.position
        by_view = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
        view = self._view.copy()
        view[[0, 1], [0, 1]] += self._wander_m2
        mean = np.zeros(SIZE)
        mean[PLACE] = self._robot[:2] + arm
        P = np.zeros((SIZE, SIZE))
        P[PLACE, PLACE] = by_view @ view @ by_view.T + R @ seen.covariance @ R.T
        P[PLACE, VIEW] = by_view @ view
        P[VIEW, PLACE] = P[PLACE, VIEW].T
        P[VELOCITY, VELOCITY] = np.eye(2) * config.speed_sigma_mps**2
        P[VIEW, VIEW] = view
        self._moving = Belief(mean, positive(P))
        self._first_x, self._first_y = float(mean[0]), float(mean[1])
        self._first_radius_m = seen.radius_m
        self._travelled = self._age_s = 0.0
        self._state: Gaussian | None = None
        self._expected: tuple[float, np.ndarray, np.ndarray] | None = None
        self._moves: float | None = None

    @property
    def moving(self) -> float:
        """Probability that it moves, in [0, 1).

        The centre of a partly visible obstacle shifts as the robot passes it, by part of its radius, and by
        as much as the visible part grows or shrinks: less that, the distance is how far both its leading and its
        trailing edge have moved. An obstacle that has not travelled farther than that may be
        static, however steadily its centre shifts. A slow mover needs time to travel that far; until then
        the probability is at most the prior. It exceeds `UNSURE` only after a likelihood ratio that noise hardly reaches.
        """
        may = self._may_move()
        far = TRAVEL_SHARE * self.radius_m
        left = min(1.0, self._travelled / max(min(far, SLOW_MPS * self._age_s), 1e-6))
        early = max(1.0 - SLOW_MPS * self._age_s / max(far, 1e-6), 0.0)
        found = may * left + early * min(may, self.config.moving_prior) * (1.0 - left)
        return found if self._proven else min(found, UNSURE)

    @property
    def state(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame: mixture of static, gone straight, and turned since last seen.

        A turn in view is noticed late, so the last `NOTICE_S` count as unseen.
        """
        if self._state is None:
            mean, covariance = np.empty(4), np.empty((4, 4))
            _track_kernels.mix(
                self._moving,
                self._static,
                self._is_static,
                self._may_move(),
                self._unseen_s + NOTICE_S,
                self._turn_every_s,
                mean,
                covariance,
            )
            self._state = Gaussian(mean, covariance)
        return self._state

    @property
    def _turn_every_s(self) -> float:
        """Mean time between turns, s: what this obstacle has shown, and the prior (gamma distribution of the rate)."""
        return self._moved_s / self._turns

    @property
    def straight(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame, if it moves and went straight since last seen."""
        return Gaussian(self._moving.x[:4].copy(), self._moving.P[:4, :4].copy())

    def predict(self, dt: float, robot: Gaussian) -> None:
        """Predict dt seconds at constant velocity, and take over the new pose of the robot.

        The motion is linear, so matrices give the same result as sigma points.
        """
        self._look_from(robot)
        self._age_s += dt
        stopping, push = int(self._is_static), 0.0  # unseen, the telegraph signal covers turns
        if self._unseen_s == 0.0:
            push = self.config.acceleration_mps2**2
            if dt > 0.0:
                stopping, self._is_static = 2, True
                self._evidence -= MOST_EVIDENCE * dt / MEMORY_S
        keep = math.exp(-dt / VIEW_MEMORY_S)
        _track_kernels.move_on(
            self._moving, self._static, stopping, dt, keep, push, self._view, self._wander_m2
        )
        self._unseen_s += dt
        self._forget_derived()

    def density(
        self, positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 2 2"]
    ) -> Float[np.ndarray, "n"]:
        """Probability density of each detection if it is of this obstacle, per square metre.

        Args:
            positions: Of the detections, body frame, m.
            covariances: Of those by the sensor alone, m^2.
        """
        straight, means, expected = self._expectations()
        moves = self._may_move()
        static = 1.0 - moves if self._is_static else 0.0
        weights = np.array([moves * straight, moves * (1.0 - straight), static])
        sigma = self.config.speed_sigma_mps * min(self._unseen_s, NOTICE_S)
        found: np.ndarray = _track_kernels.density(
            weights,
            means,
            expected,
            2.0 * sigma**2,
            _contiguous(positions),
            _contiguous(covariances),
        )
        return found

    def update(self, seen: Detection) -> Innovation:
        """Update with a detection; returns its innovation.

        After a gap, the detection first weighs whether the obstacle has turned. In view, innovations that add up in
        one direction show a turn or a stop: then the velocity is reset, the evidence of moving is kept.
        """
        if self._unseen_s > NOTICE_S:
            self._weigh_turn(seen)
        _, means, covariances = self._expectations()
        first, second = _whitened(seen, means[0], covariances[0])
        moving, gone_s = self.moving, self._unseen_s
        self._moved_s += moving * gone_s
        self._unseen_s, self._is_static = 0.0, False
        a, b = self._lag = LAG * self._lag[0] + first, LAG * self._lag[1] + second
        chance = START_PROBABILITY + moving * min(gone_s / self._turn_every_s, 0.5)
        if (1.0 - LAG**2) * (a * a + b * b) > -2.0 * math.log(chance):
            self._turns += moving
            self._reset_velocity()
        position, noise = _contiguous(seen.position), _contiguous(seen.covariance)
        self._learn(position, noise)
        self._forget_derived()
        now = self._evidence_now()
        self._proven |= max(now, self._evidence) > PROOF
        self._evidence = max(now, min(self._evidence, MOST_EVIDENCE))
        self._moves = None
        self.radius_m = max(seen.radius_m, 0.9 * self.radius_m + 0.1 * seen.radius_m)
        x, y = self._moving.x[:2]
        distance = math.hypot(x - self._first_x, y - self._first_y)
        resized = abs(self.radius_m - self._first_radius_m)
        self._travelled = max(self._travelled, distance - resized)
        self.height_m = max(seen.height_m, self.height_m)
        return Innovation(None, np.array([first, second]))

    def _learn(self, position: Float[np.ndarray, "2"], noise: Float[np.ndarray, "2 2"]) -> None:
        """Sigma-point update of the moving belief by a position in the body frame."""
        _track_kernels.learn(self._moving, self._robot, position, noise)

    def _expectations(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Probability of gone straight; predicted measurements (3, 2), (3, 2, 2): straight, turned, static."""
        if self._expected is None:
            means, covariances = np.empty((3, 2)), np.empty((3, 2, 2))
            straight = _track_kernels.expect(
                self._moving,
                self._static,
                self._is_static,
                self._robot,
                self._unseen_s,
                self._turn_every_s,
                means,
                covariances,
            )
            self._expected = straight, means, covariances
        return self._expected

    def _may_move(self) -> float:
        """Probability that it moves by its velocity alone, in (0, 1), without its travel."""
        if self._moves is None:
            evidence = max(self._evidence, self._evidence_now())
            self._moves = _probability(_log_odds(self.config.moving_prior) + evidence)
        return self._moves

    def _weigh_turn(self, seen: Detection) -> None:
        """Weigh gone straight, turned, and static by the first detection after a gap.

        The first two merge into one Gaussian by their weights; the last changes the evidence of moving.
        """
        straight, means, covariances = self._expectations()
        went = _log_density(seen, means[0], covariances[0]) + math.log(straight)
        came = _log_density(seen, means[1], covariances[1]) + math.log1p(-straight)
        moved = float(np.logaddexp(went, came))
        if self._is_static:
            stood = _log_density(seen, means[2], covariances[2])
            self._evidence = min(self._evidence, MOST_EVIDENCE) + moved - stood
        weight = math.exp(came - moved)
        turned = Belief(np.empty(SIZE), np.empty((SIZE, SIZE)))
        _track_kernels.turn(self._moving, self._unseen_s, self._turn_every_s, turned)
        self._turns += self.moving * weight
        x, P = self._moving
        apart = turned.x - x
        x += weight * apart
        spread = weight * (1.0 - weight) * np.outer(apart, apart)
        self._moving = Belief(x, positive((1.0 - weight) * P + weight * turned.P + spread))
        if weight > 0.5:
            self._lag = 0.0, 0.0
        self._forget_derived()

    def _reset_velocity(self) -> None:
        """After a turn within the last `NOTICE_S`: any velocity, and the positions that follow from it."""
        self._lag = 0.0, 0.0
        t = NOTICE_S
        fresh = 2.0 * self.config.speed_sigma_mps**2  # old and new velocity are both unknown
        grown = np.array([[t * t / 3.0, t / 2.0], [t / 2.0, 1.0]]) * fresh
        x, P = self._moving
        P[:4, :4] += np.kron(grown, np.eye(2))
        self._moving = Belief(x, positive(P))
        self._forget_derived()

    def _evidence_now(self) -> float:
        """Log-likelihood ratio of moving to static, given the detections (Savage-Dickey)."""
        vx, vy = self._moving.x[2:4].tolist()
        (a, b), (c, d) = self._moving.P[2:4, 2:4].tolist()
        det = a * d - b * c
        square = (d * vx * vx - (b + c) * vx * vy + a * vy * vy) / det
        at_rest_now = -0.5 * square - 0.5 * math.log(max(det, 1e-30))
        return -2.0 * math.log(self.config.speed_sigma_mps) - at_rest_now

    def _look_from(self, robot: Gaussian) -> None:
        """Set the viewpoint: the pose of the robot, and the shift of a partly visible centre.

        The shift grows with the size: a small obstacle is seen whole, of furniture another side each time.
        """
        self._robot, self._view = _contiguous(robot.mean), _contiguous(robot.covariance)
        self._wander_m2 = (self.config.shape_per_m * self.radius_m**2) ** 2

    def _forget_derived(self) -> None:
        """Discard everything computed from an older state."""
        self._state = self._expected = self._moves = None


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-12.0, min(12.0, log_odds))))


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


def _log_density(seen: Detection, mean: np.ndarray, covariance: np.ndarray) -> float:
    """Log density of a detection, of which 1 % are stray ones."""
    x, y = _whitened(seen, mean, covariance)
    (a, b), (_, d) = (covariance + seen.covariance).tolist()
    density = math.exp(-0.5 * (x * x + y * y)) / (2.0 * math.pi * math.sqrt(a * d - b * b))
    return math.log(0.99 * density + 0.01 * STRAY_PER_M2)
