"""Where everything round the robot may be in the next seconds, and how far to keep away from it.

A thing stands or moves, by the probability that its track gives. What moves goes where its line is known to lead,
else straight on; what was lost may have turned or stopped at any time since it was seen. Each
possibility is a disc with a place at every sample of a rollout, a distance to be kept, and a weight.

Source: ours; chance constraints by one deviation of the relative position.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import RobotModel

from . import _guard_kernels
from .guard_settings import GuardConfig
from .prediction import Line, MotionPatterns

SURE = 0.95
"""A probability of moving above it needs no standing hypothesis, and the other way round."""

LOST_M = 1.0
"""A line as far away does not matter now."""


class Hypotheses:
    """Where discs may be at the samples, how far to keep away, and how likely they turn there."""

    def __init__(
        self,
        robot: Gaussian,
        stamp_s: float,
        config: GuardConfig,
        model: RobotModel,
        habits: MotionPatterns,
    ) -> None:
        self._robot, self._stamp_s, self._config, self._habits = robot, stamp_s, config, habits
        self._model = model
        samples = 2 * config.steps
        self._times = (np.arange(samples) + 2) * model.gait.step_s / 2
        self._horizon_s = float(self._times[-1])
        self._here = robot.mean[:2].tolist()
        self._rest, self._never = np.zeros((samples, 2)), np.zeros(samples)
        self._places = [np.zeros((0, samples, 2))]
        self._velocities = [np.zeros((0, samples, 2))]
        self._needed = [np.zeros((0, samples))]
        self._doubts, self._certain = [np.zeros((0, samples, 3))], np.zeros((samples, 3))
        self._turning = [np.zeros((0, samples))]
        self._weights: list[float] = []

    def arrays(self) -> tuple[np.ndarray, ...]:
        """As `_guard_kernels.roll_out` takes them."""
        return (
            np.concatenate(self._places),
            np.concatenate(self._velocities),
            np.concatenate(self._needed),
            np.concatenate(self._doubts),
            np.array(self._weights, np.float64),
            np.concatenate(self._turning),
        )

    def add(self, obstacle: Obstacle) -> None:
        """All that one obstacle may do: stand, by the probability of that, or move."""
        config, times = self._config, self._times
        moves = obstacle.moving
        if moves < MOVING and obstacle.radius_m > config.small_radius_m:
            return
        near = self._model.radius_m + obstacle.radius_m
        away = math.dist(obstacle.position.tolist(), self._here)
        reach = self._horizon_s * (self._model.gait.max_speed_mps + config.prediction.most_mps)
        if away > reach + near + config.margin_m + config.max_sigma_m + config.soft_m:
            return
        if moves < SURE:
            place = self._last_seen(obstacle) if moves >= MOVING else obstacle.position
            doubt = min(config.sigmas * _place_deviation(self._robot, obstacle), config.margin_m)
            here = math.dist(place.tolist(), self._here)
            need = min(near + config.still_margin_m + doubt, max(here, near))
            places = np.empty((len(times), 2))
            places[:] = place
            self._put(
                places,
                self._rest,
                np.full(len(times), need),
                self._certain,
                1.0 - moves,
                self._never,
            )
        if moves > 1.0 - SURE:
            going = obstacle.gone_straight()
            doubts = np.empty((len(times), 3))
            _guard_kernels.relative_places(
                going.state.covariance,
                self._robot.covariance,
                times,
                config.sure_s,
                config.acceleration_mps2,
                doubts,
            )
            self._add_mover(going, near + config.margin_m, config.sigmas**2 * doubts, moves)

    def _last_seen(self, obstacle: Obstacle) -> np.ndarray:
        unseen = max(self._stamp_s - obstacle.seen_s, 0.0)
        return np.asarray(obstacle.position - obstacle.velocity * unseen)

    def _put(
        self,
        places: np.ndarray,
        velocities: np.ndarray,
        needed: np.ndarray,
        doubts: np.ndarray,
        weight: float,
        turning: np.ndarray,
    ) -> None:
        self._places.append(places[None])
        self._velocities.append(velocities[None])
        self._needed.append(needed[None])
        self._doubts.append(doubts[None])
        self._weights.append(weight)
        self._turning.append(turning[None])

    def add_lost(self, line: Line) -> None:
        """What was lost on a line whose ends are not known: it may be anywhere there, either way."""
        config, times = self._config, self._times
        middle = line.origin + 0.5 * (line.low + line.high) * line.direction
        away = math.dist(middle.tolist(), self._here)
        if away > 0.5 * (line.high - line.low) + LOST_M:
            return
        need = np.full(len(times), self._model.radius_m + line.radius_m + config.margin_m)
        need = np.where(times <= config.doubt_s, need, 0.0)
        pieces = 1 + int((line.high - line.low) / float(need[0]))
        for k in range(pieces):
            start = line.low + (k + 0.5) / pieces * (line.high - line.low)
            for sense in (1.0, -1.0):
                at = start + sense * line.speed_mps * times
                places = line.origin + at[:, None] * line.direction
                self._put(
                    places,
                    self._rest,
                    need,
                    self._certain,
                    config.lost_weight / pieces,
                    self._never,
                )

    def _add_mover(
        self, obstacle: Obstacle, distance: float, doubts: np.ndarray, moves: float
    ) -> None:
        """It goes on as forecast; if it was lost, it may have turned or stopped at any time since."""
        config, times = self._config, self._times
        unseen = min(max(self._stamp_s - obstacle.seen_s, 0.0), config.longest_unseen_s)
        forecast = self._habits.forecast(obstacle, self._stamp_s, times)
        turning = np.where(forecast.learnt, config.learnt_weight, config.turn_weight)
        always = np.full(len(times), distance)
        self._put(forecast.places, forecast.velocities, always, doubts, moves, turning)
        if forecast.since_seen or unseen <= self._model.gait.step_s:
            return
        velocity = obstacle.velocity
        speed = float(np.hypot(*velocity))
        velocity = velocity * min(1.0, config.prediction.most_mps / max(speed, 1e-9))
        seen_at = obstacle.position - obstacle.velocity * unseen
        early = np.where(times <= config.doubt_s, distance, 0.0)
        pieces = 1 + int(speed * unseen / distance)
        weight = -math.expm1(-unseen / config.turns_every_s)
        for k in range(1, 2 * pieces + 1):
            share = 1.0 - k / pieces  # below 1, ..., 0, ..., -1
            places = seen_at + share * velocity * (unseen + times[:, None])
            self._put(places, self._rest, early, doubts, moves * max(weight, 0.2), self._never)


def _place_deviation(robot: Gaussian, obstacle: Obstacle) -> float:
    """Deviation of the relative place of a thing that stands, along its worst axis, m."""
    P = obstacle.state.covariance[:2, :2] + robot.covariance[:2, :2]
    middle, spread = (P[0, 0] + P[1, 1]) / 2, math.hypot((P[0, 0] - P[1, 1]) / 2, P[0, 1])
    return math.sqrt(max(float(middle) + spread, 0.0))
