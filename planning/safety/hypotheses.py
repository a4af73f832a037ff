"""Hypotheses about the obstacles near the robot during a rollout, and the distance to keep from each.

An obstacle stands or goes, with the probabilities that its modes of motion give. One that goes follows its motion
pattern, else goes straight on; one out of sight may have reversed or stopped at any time since its last sighting. Each
hypothesis is a disc with a position at every sample of the rollout, a required distance, and a weight.

Source: ours; chance constraints by one standard deviation of the relative position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.obstacles.forecast import AS_OBSERVED, forecast
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.robot_model import RobotModel

from . import _guard_kernels as kernels
from ._guard_arguments import Discs
from .guard_settings import (
    DOUBT_S,
    ESCAPE_S,
    LONGEST_UNSEEN_S,
    LOST_WEIGHT,
    SMALL_RADIUS_M,
    SOFT_M,
    STILL_MARGIN_M,
    SURE_S,
    TURNS_EVERY_S,
    GuardConfig,
)
from .prediction import Line, MotionPatterns

SURE = 0.95
"""Ours: the hypothesis of rest is left out above this probability of moving, that of motion below 1 less this."""

LOST_M = 1.0
"""Ours: lines whose ends are farther from the robot than this are left out."""


class Hypotheses:
    """Discs with their positions, required distances and probabilities of reversal."""

    def __init__(
        self,
        robot: Gaussian,
        stamp_s: float,
        config: GuardConfig,
        model: RobotModel,
        patterns: MotionPatterns,
        occupied: Float[np.ndarray, "n 2"],
    ) -> None:
        self._occupied = occupied
        self._robot, self._stamp_s, self._config, self._patterns = robot, stamp_s, config, patterns
        self._model = model
        samples = 2 * config.steps
        self._times = (np.arange(samples) + 2) * model.gait.step_s / 2
        self._horizon_s = float(self._times[-1])
        self._here = robot.mean[:2].tolist()
        self._rest, self._never = np.zeros((samples, 2)), np.zeros(samples)
        self._places = [np.zeros((0, samples, 2))]
        self._velocities = [np.zeros((0, samples, 2))]
        self._needed = [np.zeros((0, samples))]
        self._covariances, self._certain = [np.zeros((0, samples, 3))], np.zeros((samples, 3))
        self._turning = [np.zeros((0, samples))]
        self._weights: list[float] = []

    def discs(self) -> Discs:
        """All discs, as arrays for the kernel."""
        return Discs(
            np.concatenate(self._places),
            np.concatenate(self._velocities),
            np.concatenate(self._needed),
            np.concatenate(self._covariances),
            np.array(self._weights, np.float64),
            np.concatenate(self._turning),
        )

    def add(self, obstacle: Obstacle) -> None:
        """Add the hypotheses of one obstacle: it stands, with that probability, or goes.

        What surely stands has none where occupied cells show it: they keep the body away.
        """
        config, times = self._config, self._times
        if not may_move(obstacle):
            return
        near = self._model.radius_m + obstacle.radius_m
        away = math.dist(obstacle.position.tolist(), self._here)
        going = obstacle.gone_straight()
        speed = float(np.hypot(*going.velocity))
        reach = self._horizon_s * (self._model.gait.max_speed_mps + speed)
        if away > reach + near + config.margin_m + config.max_sigma_m + SOFT_M:
            return
        goes = _goes(obstacle)
        may_go = goes > 1.0 - SURE
        if goes < SURE and (may_go or not self._is_in_cells(obstacle)):
            place = self._stands_at(obstacle)
            sigma = min(config.sigmas * _position_sigma(self._robot, obstacle), config.margin_m)
            here = math.dist(place.tolist(), self._here)
            need = min(near + STILL_MARGIN_M + sigma, max(here, near))
            places = np.empty((len(times), 2))
            places[:] = place
            always = np.full(len(times), need)
            self._put(places, self._rest, always, self._certain, 1.0 - goes, self._never)
        if may_go:
            covariances = config.sigmas**2 * self._relative(obstacle)
            self._add_moving(going, near + config.margin_m, covariances, goes)

    def _is_in_cells(self, obstacle: Obstacle) -> bool:
        """Whether occupied cells show where it stands."""
        gaps = np.linalg.norm(self._occupied - obstacle.position, axis=1)
        return bool(np.any(gaps <= obstacle.radius_m))

    def _relative(self, obstacle: Obstacle) -> Float[np.ndarray, "n 3"]:
        """Variances of x and of y, and their covariance, m^2, of a going obstacle's position relative to the robot."""
        covariances = np.empty((len(self._times), 3))
        if obstacle.motion is None:
            kernels.relative_covariances(
                obstacle.state.covariance,
                self._robot.covariance,
                self._times,
                SURE_S,
                self._config.acceleration_mps2,
                covariances,
            )
            return covariances
        found = forecast(obstacle, np.minimum(self._times, SURE_S))
        P = found.as_observed() + self._robot.covariance[:2, :2]
        return np.stack([P[:, 0, 0], P[:, 1, 1], P[:, 0, 1]], axis=1)

    def add_lost(self, line: Line) -> None:
        """Add discs along the whole line of a target that was lost on it, going either way."""
        config, times = self._config, self._times
        middle = line.origin + 0.5 * (line.low + line.high) * line.direction
        away = math.dist(middle.tolist(), self._here)
        if away > 0.5 * (line.high - line.low) + LOST_M:
            return
        need = np.full(len(times), self._model.radius_m + line.radius_m + config.margin_m)
        need = np.where(times <= DOUBT_S, need, 0.0)
        pieces = 1 + int((line.high - line.low) / float(need[0]))
        for k in range(pieces):
            start = line.low + (k + 0.5) / pieces * (line.high - line.low)
            for sense in (1.0, -1.0):
                at = start + sense * line.speed_mps * times
                places = line.origin + at[:, None] * line.direction
                weight = LOST_WEIGHT / pieces
                self._put(places, self._rest, need, self._certain, weight, self._never)

    def _stands_at(self, obstacle: Obstacle) -> np.ndarray:
        """Where it stands if it does, m."""
        if obstacle.motion is not None:
            return obstacle.motion.standing
        unseen = max(self._stamp_s - obstacle.seen_s, 0.0) if obstacle.moving >= MOVING else 0.0
        return np.asarray(obstacle.position - obstacle.velocity * unseen)

    def _put(
        self,
        places: np.ndarray,
        velocities: np.ndarray,
        needed: np.ndarray,
        covariances: np.ndarray,
        weight: float,
        turning: np.ndarray,
    ) -> None:
        self._places.append(places[None])
        self._velocities.append(velocities[None])
        self._needed.append(needed[None])
        self._covariances.append(covariances[None])
        self._weights.append(weight)
        self._turning.append(turning[None])

    def _add_moving(
        self, obstacle: Obstacle, distance: float, covariances: np.ndarray, moves: float
    ) -> None:
        """Add the forecast; for an obstacle out of sight also that it reversed or stopped since then."""
        config, times = self._config, self._times
        unseen = min(max(self._stamp_s - obstacle.seen_s, 0.0), LONGEST_UNSEEN_S)
        expected = self._patterns.forecast(obstacle, self._stamp_s, times)
        rate = 1.0 / TURNS_EVERY_S if obstacle.motion is None else obstacle.motion.turns_per_s
        turns = -math.expm1(-rate * ESCAPE_S)
        turning = np.where(expected.learnt, config.learnt_weight, turns)
        always = np.full(len(times), distance)
        self._put(expected.places, expected.velocities, always, covariances, moves, turning)
        if expected.since_seen or unseen <= self._model.gait.step_s:
            return
        velocity = obstacle.velocity
        speed = float(np.hypot(*velocity))
        seen_at = obstacle.position - obstacle.velocity * unseen
        early = np.where(times <= DOUBT_S, distance, 0.0)
        pieces = 1 + int(speed * unseen / distance)
        weight = -math.expm1(-unseen * rate)
        for k in range(1, 2 * pieces + 1):
            share = 1.0 - k / pieces  # below 1, ..., 0, ..., -1
            places = seen_at + share * velocity * (unseen + times[:, None])
            self._put(places, self._rest, early, covariances, moves * max(weight, 0.2), self._never)


@dataclass(frozen=True, eq=False)
class Ahead:
    """Where an obstacle will be at n times: m modes, those that keep their velocity on its motion pattern.

    Args:
        weights: (n, m) probabilities; rows sum to 1.
        means: (n, m, 2) world frame, m.
        covariances: (n, m, 2, 2).
    """

    weights: Float[np.ndarray, "n m"]
    means: Float[np.ndarray, "n m 2"]
    covariances: Float[np.ndarray, "n m 2 2"]

    @classmethod
    def of(
        cls,
        obstacle: Obstacle,
        stamp_s: float,
        times_s: Float[np.ndarray, "n"],
        patterns: MotionPatterns,
        config: GuardConfig,
    ) -> Ahead:
        """Of a track at the present time.

        Args:
            obstacle: The track.
            stamp_s: Present time.
            times_s: From the present on, ascending.
            patterns: Learnt from the tracks.
            config: For the random acceleration of an obstacle without modes.
        """
        going = obstacle.gone_straight()
        places = patterns.forecast(going, stamp_s, times_s).places
        if obstacle.motion is not None:
            modes = forecast(obstacle, times_s)
            shifts = places - (going.position + times_s[:, None] * going.velocity)
            modes.means[:, AS_OBSERVED, :2] += shifts[:, None]
            means, P = modes.means[..., :2], modes.covariances[..., :2, :2]
            return cls(modes.probabilities, means.copy(), P.copy())
        moves = obstacle.moving
        standing = np.broadcast_to(obstacle.position, places.shape)
        still = obstacle.state.covariance[:2, :2]
        P = np.array(
            [
                [
                    still,
                    going.after(min(t, SURE_S), config.acceleration_mps2).state.covariance[:2, :2],
                ]
                for t in times_s.tolist()
            ]
        )
        weights = np.tile([1.0 - moves, moves], (len(times_s), 1))
        return cls(weights, np.stack([standing, places], axis=1), P)


def may_move(obstacle: Obstacle) -> bool:
    """Whether a track counts as more than the occupied cells that it covers: it moves, or is small enough for a disc."""
    return obstacle.moving >= MOVING or obstacle.radius_m <= SMALL_RADIUS_M


def _goes(obstacle: Obstacle) -> float:
    """Probability that it goes now."""
    if obstacle.motion is None:
        return obstacle.moving
    return obstacle.moving * obstacle.motion.goes_if_it_moves


def _position_sigma(robot: Gaussian, obstacle: Obstacle) -> float:
    """Standard deviation of the relative position along its worst axis, m."""
    P = obstacle.state.covariance[:2, :2] + robot.covariance[:2, :2]
    middle, spread = (P[0, 0] + P[1, 1]) / 2, math.hypot((P[0, 0] - P[1, 1]) / 2, P[0, 1])
    return math.sqrt(max(float(middle) + spread, 0.0))
