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

from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from .consistency import Innovation
from .models import positive, spread, square_root
from .turning import Turning, turning

SIZE = 7
"""x, y, vx, vy of the thing, then the error of the viewpoint in x, y, yaw; m, m/s, rad, world axes."""

PLACE, VELOCITY, VIEW = slice(0, 2), slice(2, 4), slice(4, 7)


@dataclass(frozen=True)
class TrackConfig:
    """How obstacles move, and how we see them."""

    speed_sigma_mps: float = 0.06  # seed 001: movers of 0.03 to 0.15 m/s; deviation per axis
    acceleration_mps2: float = 0.008  # ours: random acceleration per frame, nothing unusual
    view_memory_s: float = 5.0  # ours: the robot's error at this distance is a new one (1/e)
    shape_share: float = 0.07  # ours: wander of a half-seen thing's centre, in radii
    moving_prior: float = 0.25  # seed 001: 4 of 16 obstacles move
    memory_s: float = 20.0  # ours: once seen moving, believed able to, for about this long
    start_probability: float = 0.001  # ours: per frame, that something standing starts
    turn_probability: float = 0.02  # navigation trials: movers turn every 15 to 25 s, 50 frames
    turn_every_s: float = 20.0  # navigation trials: the same, for what is out of sight
    notice_s: float = 1.0  # ours: how long ago a turn may have been when it is noticed
    unnoticed_s: float = 0.3  # ours: the same, when it need not have been noticed yet
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
        for name in ("shape_share", "travel_share"):
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
        self._robot = robot
        self._evidence = -_REMEMBERED
        self._unseen_s = 0.0
        self._still: Gaussian | None = None  # if it stands: as it was seen last
        self._state: Gaussian | None = None
        self._expected: Gaussian | None = None
        self._expected_all: list[tuple[float, Gaussian]] | None = None
        self._lag = np.zeros(2)
        x, y, yaw = robot.mean
        c, s = math.cos(yaw), math.sin(yaw)
        R = np.array([[c, -s], [s, c]])
        arm = R @ seen.position
        by_view = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
        view = self._view_covariance()
        mean = np.zeros(SIZE)
        mean[PLACE] = np.array([x, y]) + arm
        P = np.zeros((SIZE, SIZE))
        P[PLACE, PLACE] = by_view @ view @ by_view.T + R @ seen.covariance @ R.T
        P[PLACE, VIEW] = by_view @ view
        P[VIEW, PLACE] = P[PLACE, VIEW].T
        P[VELOCITY, VELOCITY] = np.eye(2) * config.speed_sigma_mps**2
        P[VIEW, VIEW] = view
        self._filter = _sigma_point_filter(mean, positive(P))
        self._first_place, self._first_radius_m = mean[PLACE].copy(), seen.radius_m
        self._travelled = 0.0

    @property
    def moving(self) -> float:
        """Probability that it moves, in [0, 1).

        The middle of a half-seen thing wanders as we pass it, by part of its radius and no further, and by
        as much as the thing grows while more of it is seen; what has not left its first place yet may be
        such a thing, however steadily it goes.
        """
        odds = _log_odds(self.config.moving_prior) + self._evidence
        by_velocity = 1.0 / (1.0 + math.exp(-max(-12.0, min(12.0, odds))))
        out_of_place = self._travelled / max(self.config.travel_share * self.radius_m, 1e-6)
        return by_velocity * min(1.0, out_of_place)

    @property
    def state(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame: both hypotheses, standing and moving, by their weight."""
        if self._state is None:
            self._state = self._mixed()
        return self._state

    @property
    def straight(self) -> Gaussian:
        """Over (x, y, vx, vy), world frame, if it moves and went straight on since it was seen."""
        return Gaussian(self._filter.x[:4].copy(), self._filter.P[:4, :4].copy())

    def _mixed(self) -> Gaussian:
        """Standing, gone straight on, turned since it was seen: by their weights, with their spread.

        A turn in view is noticed late, so that the last moments count as unseen.
        """
        straight = Gaussian(self._filter.x, self._filter.P)
        since = turning(self._unseen_s + self.config.unnoticed_s, self.config.turn_every_s)
        moves = self._may_move()
        parts = (
            (1.0 - moves, self._still or _stopped(straight)),
            (moves * since.straight, straight),
            (moves * (1.0 - since.straight), _turned(straight, since)),
        )
        mean = np.sum([weight * part.mean[:4] for weight, part in parts], axis=0)
        covariance = np.zeros((4, 4))
        for weight, part in parts:
            away = part.mean[:4] - mean
            covariance += weight * (part.covariance[:4, :4] + np.outer(away, away))
        covariance[2:, 2:] += np.eye(2) * 1e-8  # nothing stands quite still
        return Gaussian(mean, positive(covariance))

    def predict(self, dt: float, robot: Gaussian) -> None:
        """Advance by dt seconds, straight on; the robot's pose is now this one.

        The motion is linear, so that matrices give what sigma points would.
        """
        self._robot = robot
        if self._unseen_s == 0.0 and dt > 0.0:
            self._still = _stopped(Gaussian(self._filter.x, self._filter.P))
            self._evidence -= _REMEMBERED * dt / self.config.memory_s
        keep = math.exp(-dt / self.config.view_memory_s)
        F = np.eye(SIZE)
        F[0, 2] = F[1, 3] = dt
        F[4, 4] = F[5, 5] = F[6, 6] = keep
        Q = np.zeros((SIZE, SIZE))
        if self._unseen_s == 0.0:  # out of sight what it may do is told by `turning`
            pushed = np.array([[dt * dt / 2, 0], [0, dt * dt / 2], [dt, 0], [0, dt]])
            Q[:4, :4] = pushed @ pushed.T * self.config.acceleration_mps2**2
        Q[VIEW, VIEW] = (1.0 - keep**2) * self._view_covariance()
        self._filter.x = F @ self._filter.x
        self._filter.P = positive(F @ self._filter.P @ F.T + Q)
        if self._still is not None:
            F[0, 2] = F[1, 3] = 0.0
            Q[:4, :4] = 0.0
            self._still = Gaussian(F @ self._still.mean, F @ self._still.covariance @ F.T + Q)
        self._unseen_s += dt
        self._draw()

    def expected(self) -> Gaussian:
        """Where it should be seen if it went straight on: over the position in the body frame, m, noiseless."""
        if self._expected is None:
            self._expected = self._seen_from_body(self._filter.sigmas_f)
        return self._expected

    def density(
        self, positions: Float[np.ndarray, "n 2"], covariances: Float[np.ndarray, "n 2 2"]
    ) -> Float[np.ndarray, "n"]:
        """How likely each detection is of this thing, per square metre: standing, going straight, turned.

        Args:
            positions: Of the detections, body frame, m.
            covariances: Of those by the sensor alone, m^2.
        """
        found = np.zeros(len(positions))
        for weight, expected in self._expectations():
            S = covariances + expected.covariance
            away = positions - expected.mean
            square = np.einsum("ni,ni->n", away, np.linalg.solve(S, away[..., None])[..., 0])
            found += weight * np.exp(-0.5 * square) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))
        return found

    def _expectations(self) -> list[tuple[float, Gaussian]]:
        """Every hypothesis with its weight: where it should be seen."""
        if self._expected_all is None:
            since = turning(self._unseen_s, self.config.turn_every_s)
            moves = self._may_move()
            turned = self._seen_from_body(self._sigma_points(self._if_turned()))
            fresh = (
                2.0 * (self.config.speed_sigma_mps * min(self._unseen_s, self.config.notice_s)) ** 2
            )
            turned = Gaussian(turned.mean, turned.covariance + fresh * np.eye(2))
            self._expected_all = [
                (moves * since.straight, self.expected()),
                (moves * (1.0 - since.straight), turned),
            ]
            if self._still is not None:
                still = self._seen_from_body(self._sigma_points(self._still))
                self._expected_all.append((1.0 - moves, still))
        return self._expected_all

    def _may_move(self) -> float:
        """Probability that it moves as far as its velocity tells, in (0, 1): before it has left its place."""
        odds = _log_odds(self.config.moving_prior) + max(self._evidence, self._weigh())
        return 1.0 / (1.0 + math.exp(-max(-12.0, min(12.0, odds))))

    def _seen_from_body(self, points: np.ndarray) -> Gaussian:
        places = np.stack(relative_position(points.T, self._robot.mean), axis=-1)
        mean = self._filter.Wm @ places
        spread = places - mean
        return Gaussian(mean, spread.T @ (self._filter.Wc[:, None] * spread))

    def _if_turned(self) -> Gaussian:
        """The filter's state if it turned since it was seen."""
        since = turning(self._unseen_s, self.config.turn_every_s)
        return _turned(Gaussian(self._filter.x, self._filter.P), since)

    def update(self, seen: Detection) -> Innovation:
        """Learn from a detection; returns how it surprised.

        What was out of sight is asked first whether it turned meanwhile. Innovations that add up in one
        direction say that the thing turned or stopped in view: what is known of its velocity is forgotten,
        that it moves is not.
        """
        if self._unseen_s > self.config.notice_s:
            self._settle_turn(seen)
        expected = self.expected()
        innovation = Innovation.of(
            None, seen.position - expected.mean, expected.covariance + seen.covariance
        )
        self._unseen_s, self._still = 0.0, None
        self._lag = _LAG * self._lag + innovation.whitened
        chance = self.config.start_probability + self.moving * self.config.turn_probability
        if (1.0 - _LAG**2) * float(self._lag @ self._lag) > -2.0 * math.log(chance):
            self._forget_velocity()
        self._filter.update(seen.position, R=positive(seen.covariance), robot=self._robot.mean)
        self._filter.P = positive(self._filter.P)
        self._draw()
        self._evidence = max(self._weigh(), min(self._evidence, _REMEMBERED))
        self.radius_m = max(seen.radius_m, 0.9 * self.radius_m + 0.1 * seen.radius_m)
        away = float(np.linalg.norm(self._filter.x[PLACE] - self._first_place))
        grown = max(self.radius_m - self._first_radius_m, 0.0)
        self._travelled = max(self._travelled, away - grown)
        self.height_m = max(seen.height_m, self.height_m)
        return innovation

    def _settle_turn(self, seen: Detection) -> None:
        """Seen again: weigh having gone straight on, having turned, and standing.

        The first two become one Gaussian by their weights, with their spread; the last goes into the
        evidence of moving.
        """
        since = turning(self._unseen_s, self.config.turn_every_s)
        straight, turned = Gaussian(self._filter.x, self._filter.P), self._if_turned()
        went = self._log_density(seen, self.expected()) + math.log(since.straight)
        came = self._log_density(seen, self._seen_from_body(self._sigma_points(turned)))
        came += math.log1p(-since.straight)
        moved = float(np.logaddexp(went, came))
        if self._still is not None:
            stood = self._log_density(seen, self._seen_from_body(self._sigma_points(self._still)))
            self._evidence = min(self._evidence, _REMEMBERED) + moved - stood
        weight = math.exp(came - moved)
        apart = turned.mean - straight.mean
        self._filter.x = straight.mean + weight * apart
        self._filter.P = positive(
            (1.0 - weight) * straight.covariance
            + weight * turned.covariance
            + weight * (1.0 - weight) * np.outer(apart, apart)
        )
        if weight > 0.5:
            self._lag = np.zeros(2)
        self._draw()

    def _log_density(self, seen: Detection, expected: Gaussian) -> float:
        """Of a detection, broadened by the chance of one (1 %) that has nothing to do with the thing."""
        S = expected.covariance + seen.covariance
        away = seen.position - expected.mean
        density = math.exp(-0.5 * float(away @ np.linalg.solve(S, away)))
        density /= 2.0 * math.pi * math.sqrt(float(np.linalg.det(S)))
        return math.log(0.99 * density + 0.01 * _ANYWHERE)

    def _forget_velocity(self) -> None:
        """It turned within the last moments: any velocity again, and any place that follows from it."""
        self._lag = np.zeros(2)
        t = self.config.notice_s
        fresh = 2.0 * self.config.speed_sigma_mps**2  # old and new velocity are both unknown
        grown = np.array([[t * t / 3.0, t / 2.0], [t / 2.0, 1.0]]) * fresh
        self._filter.P[:4, :4] += np.kron(grown, np.eye(2))
        self._filter.P = positive(self._filter.P)
        self._draw()

    def _weigh(self) -> float:
        """Log of how much likelier the sightings are of something moving than of something standing."""
        velocity = self._filter.x[VELOCITY]
        P = self._filter.P[VELOCITY, VELOCITY]
        at_rest_now = -0.5 * float(velocity @ np.linalg.solve(P, velocity)) - 0.5 * math.log(
            max(float(np.linalg.det(P)), 1e-30)
        )
        at_rest_before = -2.0 * math.log(self.config.speed_sigma_mps)
        return at_rest_before - at_rest_now

    def _view_covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of the viewpoint: the robot's pose, and the wander of a half-seen middle."""
        view = np.array(self._robot.covariance)
        view[[0, 1], [0, 1]] += (self.config.shape_share * self.radius_m) ** 2
        return view

    def _draw(self) -> None:
        """Sigma points for the next use of the filter; what was derived from older ones is void."""
        self._state = self._expected = self._expected_all = None
        self._filter.sigmas_f = self._sigma_points(Gaussian(self._filter.x, self._filter.P))

    def _sigma_points(self, state: Gaussian) -> np.ndarray:
        return np.asarray(
            self._filter.points_fn.sigma_points(state.mean, positive(state.covariance))
        )


_REMEMBERED = 5.0
"""Log-odds of having moved that are carried on, at most, so that a thing that stops is believed to."""

_ANYWHERE = 1.0
"""Density of a stray detection, per square metre."""

_LAG = 0.7
"""What is kept from frame to frame of the sum of innovations that shows a turn."""


def _turned(straight: Gaussian, since: Turning) -> Gaussian:
    """The state of a track that has turned, from that of one that has not."""
    F = np.eye(SIZE)
    F[:4, :4] = np.kron([[1.0, since.move_s - since.seconds], [0.0, since.keep]], np.eye(2))
    velocity = straight.mean[VELOCITY]
    power = np.outer(velocity, velocity) + straight.covariance[VELOCITY, VELOCITY]
    covariance = F @ straight.covariance @ F.T
    covariance[:4, :4] += np.kron(since.noise, power)
    return Gaussian(F @ straight.mean, covariance)


def _stopped(straight: Gaussian) -> Gaussian:
    """The state of a track if it stands: after a sighting v = 0 without noise."""
    P = straight.covariance
    gain = np.linalg.solve(P[VELOCITY, VELOCITY], P[VELOCITY, :]).T
    mean, covariance = straight.mean - gain @ straight.mean[VELOCITY], P - gain @ P[VELOCITY, :]
    mean[VELOCITY] = 0.0
    covariance[VELOCITY, :] = covariance[:, VELOCITY] = 0.0
    return Gaussian(mean, covariance)


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


def _sigma_point_filter(mean: np.ndarray, covariance: np.ndarray) -> Any:
    """filterpy's filter with the measurement model; prediction is linear and done outside."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # slow to import

    points = MerweScaledSigmaPoints(SIZE, spread(SIZE), 2.0, 0.0, sqrt_method=square_root)
    engine = UnscentedKalmanFilter(
        dim_x=SIZE, dim_z=2, dt=1.0, hx=relative_position, fx=None, points=points
    )
    engine.x, engine.P = mean, covariance
    engine.sigmas_f = points.sigma_points(mean, covariance)
    return engine
