"""One obstacle followed: a sigma-point filter on its position, its velocity, and our own error.

A detection tells where a thing is relative to the body, and where the body is in the world is known only
with a covariance that hardly changes from frame to frame. Taken for fresh noise each time, it would be
averaged away, and a thing seen a hundred times from a wrong place would seem sure to be where it is not.
So the filter carries the error of the viewpoint as part of its state: it has the covariance of the robot's
pose, widened by what is unknown of a half-seen shape, and forgets slowly.

Whether the thing moves at all is asked of the same filter: "it stands" is the hypothesis v = 0 inside it, and
the weight of evidence is the ratio of its density at v = 0 after and before the sightings (Dickey's
ratio). No second filter is needed, and a drift that the viewpoint explains is no evidence.

While it is out of sight it may have turned back, once or several times. The filter goes straight on; the
state that is told is a mixture of that and of a random telegraph signal, and when the thing is seen again
both are weighed by where it is. The same hypotheses, each by its weight, say how likely a detection is of
this thing: what is known to stand takes no mover that passes by for itself. What stands is believed to stand where it was seen last. Whether it moves
is not learnt from not seeing it, but from where it is when it is seen again.

Source: seed 001, sections 2, 3 and 14 (one sigma-point filter per obstacle); viewpoint and evidence ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..filtering.consistency import Innovation
from ..filtering.models import positive
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from . import _track_kernels

SIZE = _track_kernels.SIZE
"""x, y, vx, vy of the thing, then the error of the viewpoint in x, y, yaw; m, m/s, rad, world axes."""

PLACE, VELOCITY, VIEW = slice(0, 2), slice(2, 4), slice(4, 7)


@dataclass(frozen=True)
class TrackConfig:
    """How obstacles move, and how we see them."""

    speed_sigma_mps: float = 0.06  # seed 001: movers of 0.03 to 0.15 m/s; deviation per axis
    acceleration_mps2: float = 0.008  # ours: random acceleration per frame, nothing unusual
    view_memory_s: float = 5.0  # ours: the robot's error at this distance is a new one (1/e)
    shape_per_m: float = 0.4  # ours: wander of a half-seen middle is this times radius squared, m
    moving_prior: float = 0.25  # seed 001: 4 of 16 obstacles move
    memory_s: float = 20.0  # ours: once seen moving, believed able to, for about this long
    start_probability: float = 0.001  # ours: per frame, that something standing starts
    turn_probability: float = 0.02  # navigation trials: movers turn every 15 to 25 s, 50 frames
    turn_every_s: float = 35.0  # ours: unseen; movers turn at the ends of ways, not at random
    notice_s: float = 1.0  # ours: how long ago a turn may have been when it is noticed
    unnoticed_s: float = 0.3  # ours: the same, when it need not have been noticed yet
    slow_mps: float = 0.03  # navigation trials: the slowest movers
    travel_share: float = 0.7  # ours: nothing moves that has not left its place by so many radii

    def __post_init__(self) -> None:
        for name in (
            "speed_sigma_mps",
            "acceleration_mps2",
            "view_memory_s",
            "memory_s",
            "notice_s",
            "unnoticed_s",
            "turn_every_s",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"track: {name}={value} must be positive and finite")
        for name in ("moving_prior", "start_probability", "turn_probability"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ConfigError(f"track: {name}={value} must lie between 0 and 1")
        for name in ("shape_per_m", "travel_share"):
            if not getattr(self, name) >= 0.0:
                raise ConfigError(f"track: {name}={getattr(self, name)} must not be negative")


@dataclass(frozen=True)
class Detection:
    """Something that rises from the floor, seen in one frame.

    Args:
        position: Of its middle on the floor, body frame, m.
        covariance: Of that position by the sensor alone, m^2.
        radius_m: Of the disc that covers it.
        height_m: Its top above the floor.
    """

    position: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]
    radius_m: float
    height_m: float = 0.0


class Track:
    """The filter of one obstacle."""

    def __init__(self, seen: Detection, robot: Gaussian, config: TrackConfig) -> None:
        """Begin where it is first seen, at an unknown velocity."""
        self.config = config
        self.radius_m = seen.radius_m
        self.height_m = seen.height_m
        self._look_from(robot)
        self._evidence = -_REMEMBERED
        self._unseen_s = 0.0
        self._still = np.zeros(SIZE), np.zeros((SIZE, SIZE))  # if it stands: as it was seen last
        self._stands = False  # whether that is known
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
        self._x, self._P = mean, positive(P)
        self._first_x, self._first_y = float(mean[0]), float(mean[1])
        self._first_radius_m = seen.radius_m
        self._travelled = self._age_s = 0.0
        self._state: Gaussian | None = None
        self._seen: tuple[float, np.ndarray, np.ndarray] | None = None
        self._moves: float | None = None

    @property
    def moving(self) -> float:
        """Probability that it moves, in [0, 1).

        The middle of a half-seen thing wanders as we pass it, by part of its radius and no further, and by
        as much as the thing grows while more of it is seen; what has not left its first place yet may be
        such a thing, however steadily it goes. But a slow one needs time for that, and gets it: until then what
        nothing is known of moves as often as others do.
        """
        config, may = self.config, self._may_move()
        far = config.travel_share * self.radius_m
        left = min(1.0, self._travelled / max(min(far, config.slow_mps * self._age_s), 1e-6))
        early = max(1.0 - config.slow_mps * self._age_s / max(far, 1e-6), 0.0)
        return may * left + early * min(may, config.moving_prior) * (1.0 - left)

    @property
    def state(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame: both hypotheses, standing and moving, by their weight.

        That is: standing, gone straight on, turned since it was seen, with their spread. A turn in view is
        noticed late, so that the last moments count as unseen.
        """
        if self._state is None:
            mean, covariance = np.empty(4), np.empty((4, 4))
            _track_kernels.mix(
                self._x,
                self._P,
                *self._still,
                self._stands,
                self._may_move(),
                self._unseen_s + self.config.unnoticed_s,
                self.config.turn_every_s,
                mean,
                covariance,
            )
            self._state = Gaussian(mean, covariance)
        return self._state

    @property
    def straight(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame, if it moves and went straight on since it was seen."""
        return Gaussian(self._x[:4].copy(), self._P[:4, :4].copy())

    @property
    def whole(self) -> Gaussian:
        """Over all that the filter carries, gone straight on: `straight`, then the viewpoint's error."""
        return Gaussian(self._x.copy(), self._P.copy())

    def predict(self, dt: float, robot: Gaussian) -> None:
        """Advance by dt seconds, straight on; the robot's pose is now this one.

        The motion is linear, so that matrices give what sigma points would.
        """
        self._look_from(robot)
        self._age_s += dt
        stopping, push = int(self._stands), 0.0  # out of sight what it may do is told by `turning`
        if self._unseen_s == 0.0:
            push = self.config.acceleration_mps2**2
            if dt > 0.0:
                stopping, self._stands = 2, True
                self._evidence -= _REMEMBERED * dt / self.config.memory_s
        keep = math.exp(-dt / self.config.view_memory_s)
        _track_kernels.move_on(
            self._x,
            self._P,
            *self._still,
            stopping,
            dt,
            keep,
            push,
            self._view,
            self._wander_m2,
        )
        self._unseen_s += dt
        self._forget_derived()

    def expected(self) -> Gaussian:
        """Where it should be seen if it went straight on: over the position in the body frame, m, noiseless."""
        _, means, covariances = self._expectations()
        return Gaussian(means[0].copy(), covariances[0].copy())

    def density(
        self, positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 2 2"]
    ) -> Float[np.ndarray, "n"]:
        """How likely each detection is of this thing, per square metre: standing, going straight, turned.

        Args:
            positions: Of the detections, body frame, m.
            covariances: Of those by the sensor alone, m^2.
        """
        straight, means, expected = self._expectations()
        moves = self._may_move()
        stands = 1.0 - moves if self._stands else 0.0
        weights = np.array([moves * straight, moves * (1.0 - straight), stands])
        way = self.config.speed_sigma_mps * min(self._unseen_s, self.config.notice_s)
        found: np.ndarray = _track_kernels.density(
            weights, means, expected, 2.0 * way**2, _plain(positions), _plain(covariances)
        )
        return found

    def _expectations(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Probability of straight on; (3, 2) and (3, 2, 2) where it should be seen: straight, turned, standing."""
        if self._seen is None:
            means, covariances = np.empty((3, 2)), np.empty((3, 2, 2))
            straight = _track_kernels.expect(
                self._x,
                self._P,
                *self._still,
                self._stands,
                self._robot,
                self._unseen_s,
                self.config.turn_every_s,
                means,
                covariances,
            )
            self._seen = straight, means, covariances
        return self._seen

    def _may_move(self) -> float:
        """Probability that it moves as far as its velocity tells, in (0, 1): before it has left its place."""
        if self._moves is None:
            evidence = max(self._evidence, self._weigh())
            self._moves = _probability(_log_odds(self.config.moving_prior) + evidence)
        return self._moves

    def update(self, seen: Detection) -> Innovation:
        """Learn from a detection; returns how it surprised.

        What was out of sight is asked first whether it turned meanwhile. Innovations that add up in one
        direction say that the thing turned or stopped in view: what is known of its velocity is forgotten,
        that it moves is not.
        """
        if self._unseen_s > self.config.notice_s:
            self._settle_turn(seen)
        _, means, covariances = self._expectations()
        first, second = _whitened(seen, means[0], covariances[0])
        self._unseen_s, self._stands = 0.0, False
        a, b = self._lag = _LAG * self._lag[0] + first, _LAG * self._lag[1] + second
        chance = self.config.start_probability + self.moving * self.config.turn_probability
        if (1.0 - _LAG**2) * (a * a + b * b) > -2.0 * math.log(chance):
            self._forget_velocity()
        position, noise = _plain(seen.position), _plain(seen.covariance)
        _track_kernels.learn(self._x, self._P, self._robot, position, noise)
        self._forget_derived()
        self._evidence = max(self._weigh(), min(self._evidence, _REMEMBERED))
        self._moves = None
        self.radius_m = max(seen.radius_m, 0.9 * self.radius_m + 0.1 * seen.radius_m)
        away = math.hypot(self._x[0] - self._first_x, self._x[1] - self._first_y)
        grown = max(self.radius_m - self._first_radius_m, 0.0)
        self._travelled = max(self._travelled, away - grown)
        self.height_m = max(seen.height_m, self.height_m)
        return Innovation(None, np.array([first, second]))

    def _settle_turn(self, seen: Detection) -> None:
        """Seen again: weigh having gone straight on, having turned, and standing.

        The first two become one Gaussian by their weights, with their spread; the last goes into the
        evidence of moving.
        """
        straight, means, covariances = self._expectations()
        went = _log_density(seen, means[0], covariances[0]) + math.log(straight)
        came = _log_density(seen, means[1], covariances[1]) + math.log1p(-straight)
        moved = float(np.logaddexp(went, came))
        if self._stands:
            stood = _log_density(seen, means[2], covariances[2])
            self._evidence = min(self._evidence, _REMEMBERED) + moved - stood
        weight = math.exp(came - moved)
        x, P = np.empty(SIZE), np.empty((SIZE, SIZE))
        _track_kernels.turn(self._x, self._P, self._unseen_s, self.config.turn_every_s, x, P)
        apart = x - self._x
        self._x += weight * apart
        self._P = positive(
            (1.0 - weight) * self._P + weight * P + weight * (1.0 - weight) * np.outer(apart, apart)
        )
        if weight > 0.5:
            self._lag = 0.0, 0.0
        self._forget_derived()

    def _forget_velocity(self) -> None:
        """It turned within the last moments: any velocity again, and any place that follows from it."""
        self._lag = 0.0, 0.0
        t = self.config.notice_s
        fresh = 2.0 * self.config.speed_sigma_mps**2  # old and new velocity are both unknown
        grown = np.array([[t * t / 3.0, t / 2.0], [t / 2.0, 1.0]]) * fresh
        self._P[:4, :4] += np.kron(grown, np.eye(2))
        self._P = positive(self._P)
        self._forget_derived()

    def _weigh(self) -> float:
        """Log of how much likelier the sightings are of something moving than of something standing."""
        vx, vy = self._x[2:4].tolist()
        (a, b), (c, d) = self._P[2:4, 2:4].tolist()
        det = a * d - b * c
        square = (d * vx * vx - (b + c) * vx * vy + a * vy * vy) / det
        at_rest_now = -0.5 * square - 0.5 * math.log(max(det, 1e-30))
        return -2.0 * math.log(self.config.speed_sigma_mps) - at_rest_now

    def _look_from(self, robot: Gaussian) -> None:
        """The viewpoint: the robot's pose, and the wander of a half-seen middle.

        A small thing is seen whole, of furniture now this side and now that: the middle of the one stays.
        """
        self._robot, self._view = _plain(robot.mean), _plain(robot.covariance)
        self._wander_m2 = (self.config.shape_per_m * self.radius_m**2) ** 2

    def _forget_derived(self) -> None:
        """What was derived from an older state is void."""
        self._state = self._seen = self._moves = None


_REMEMBERED = 5.0
"""Log-odds of having moved that are carried on, at most, so that a thing that stops is believed to."""

_ANYWHERE = 1.0
"""Density of a stray detection, per square metre."""

_LAG = 0.7
"""What is kept from frame to frame of the sum of innovations that shows a turn."""


def relative_position(state: np.ndarray, robot: np.ndarray) -> tuple[Any, Any]:
    """Where the thing is seen from the body: measurement model of a track.

    Args:
        state: (7,) or (7, k), k states side by side, entries as above; the true viewpoint is the robot's
            pose plus the error.
        robot: (3,), x, y, yaw as believed, m and rad, world frame.

    Returns:
        x and y in the body frame, m.
    """
    x, y = state[0] - robot[0] - state[4], state[1] - robot[1] - state[5]
    yaw = robot[2] + state[6]
    c, s = np.cos(yaw), np.sin(yaw)
    return c * x + s * y, c * y - s * x


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-12.0, min(12.0, log_odds))))


def _plain(array: np.ndarray) -> np.ndarray:
    """As compiled code takes it: a writable copy in order, of doubles."""
    return np.array(array, np.float64, order="C")


def _whitened(seen: Detection, mean: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """The innovation divided by the Cholesky root of its covariance, as `Innovation.of` has it."""
    (a, _), (b, d) = (covariance + seen.covariance).tolist()
    x, y = (seen.position - mean).tolist()
    first = math.sqrt(a)
    low = b / first
    x /= first
    return x, (y - low * x) / math.sqrt(d - low * low)


def _log_density(seen: Detection, mean: np.ndarray, covariance: np.ndarray) -> float:
    """Of a detection, broadened by the chance of one (1 %) that has nothing to do with the thing."""
    x, y = _whitened(seen, mean, covariance)
    (a, b), (_, d) = (covariance + seen.covariance).tolist()
    density = math.exp(-0.5 * (x * x + y * y)) / (2.0 * math.pi * math.sqrt(a * d - b * b))
    return math.log(0.99 * density + 0.01 * _ANYWHERE)
