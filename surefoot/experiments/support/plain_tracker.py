"""The tracker of the textbooks, for comparison: constant velocity with white acceleration, global nearest neighbour.

Births, deaths and the detections are those of the product's tracker; the filter is a Kalman filter in the world, with
the covariance of the robot's pose added to that of every detection. A track counts as moving once its velocity is
significant.

Source: Bar-Shalom, Li, Kirubarajan 2001, sections 5.2 and 6.2.2 (discretised white noise acceleration).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.obstacles.track import Detection
from perception.obstacles.tracker import MISSES_OF_NEW, TrackerConfig, Visible, match
from perception.primitives.gaussian import Gaussian

ACCELERATION = 1e-3  # density of the acceleration, m^2/s^3; best of five on the development laws
SPEED_SIGMA_MPS = 0.1  # ours: of a new track
GATE = 9.21  # 99 % of chi-square with two degrees of freedom


@dataclass
class PlainTrack:
    """A track: mean and covariance of (x, y, vx, vy), m and m/s, world frame; stamp of the last detection."""

    number: int
    mean: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"]
    seen_s: float
    hits: int = 1
    misses: int = 0

    @property
    def moves(self) -> bool:
        """Whether its velocity differs from zero at 99 %."""
        velocity = self.mean[2:]
        return float(velocity @ np.linalg.solve(self.covariance[2:, 2:], velocity)) > GATE


class PlainTracker:
    """All tracks."""

    def __init__(self, config: TrackerConfig, acceleration: float = ACCELERATION) -> None:
        self._config, self._acceleration = config, acceleration
        self._tracks: list[PlainTrack] = []
        self._stamp_s: float | None = None
        self._born = 0

    @property
    def tracks(self) -> list[PlainTrack]:
        """Those with enough detections."""
        return [one for one in self._tracks if one.hits >= self._config.hits_to_show]

    def update(
        self, stamp_s: float, detections: Sequence[Detection], robot: Gaussian, visible: Visible
    ) -> None:
        """Predict to this frame and update with its detections; arguments as of `ObstacleTracker.update`."""
        dt = 0.0 if self._stamp_s is None else stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        for one in self._tracks:
            self._predict(one, dt)
        seen = [
            _in_world(detection, robot)
            for detection in detections
            if detection.radius_m <= self._config.max_radius_m
        ]
        pairs = self._pairs(seen)
        for i, j in pairs:
            _correct(self._tracks[i], *seen[j], stamp_s)
        given = {i for i, _ in pairs}
        missed = [k for k in range(len(self._tracks)) if k not in given]
        if missed:
            places = np.array([self._tracks[k].mean[:2] for k in missed])
            for k, in_view in zip(missed, visible(places), strict=True):
                self._tracks[k].misses += int(in_view)
        self._tracks = [one for one in self._tracks if self._survives(one, stamp_s)]
        taken = {j for _, j in pairs}
        for j, (place, covariance) in enumerate(seen):
            if j not in taken:
                self._born += 1
                mean, P = np.zeros(4), np.eye(4) * SPEED_SIGMA_MPS**2
                mean[:2], P[:2, :2] = place, covariance
                self._tracks.append(PlainTrack(self._born, mean, P, stamp_s))

    def _predict(self, one: PlainTrack, dt: float) -> None:
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        block = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * self._acceleration
        one.mean = F @ one.mean
        one.covariance = F @ one.covariance @ F.T + np.kron(block, np.eye(2))

    def _pairs(self, seen: list[tuple[np.ndarray, np.ndarray]]) -> list[tuple[int, int]]:
        if not self._tracks or not seen:
            return []
        cost = np.array(
            [
                [_distance(one, place, covariance) for place, covariance in seen]
                for one in self._tracks
            ]
        )
        return match(cost, GATE)

    def _survives(self, one: PlainTrack, stamp_s: float) -> bool:
        config, shown = self._config, one.hits >= self._config.hits_to_show
        if one.misses >= (config.misses_to_die if shown else MISSES_OF_NEW):
            return False
        largest = float(np.linalg.eigvalsh(one.covariance[:2, :2])[-1])
        return stamp_s - one.seen_s <= config.oldest_s and largest < config.largest_sigma_m**2


def _in_world(seen: Detection, robot: Gaussian) -> tuple[np.ndarray, np.ndarray]:
    """Place and covariance of a detection with the pose's own."""
    c, s = math.cos(robot.mean[2]), math.sin(robot.mean[2])
    R = np.array([[c, -s], [s, c]])
    arm = R @ seen.position
    by_pose = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
    covariance = R @ seen.covariance @ R.T + by_pose @ robot.covariance @ by_pose.T
    return arm + robot.mean[:2], covariance


def _distance(one: PlainTrack, place: np.ndarray, covariance: np.ndarray) -> float:
    off = place - one.mean[:2]
    return float(off @ np.linalg.solve(one.covariance[:2, :2] + covariance, off))


def _correct(one: PlainTrack, place: np.ndarray, covariance: np.ndarray, stamp_s: float) -> None:
    P = one.covariance
    gain = np.linalg.solve(P[:2, :2] + covariance, P[:2]).T
    one.mean = one.mean + gain @ (place - one.mean[:2])
    kept = np.eye(4) - gain @ np.eye(2, 4)
    one.covariance = kept @ P @ kept.T + gain @ covariance @ gain.T
    one.seen_s, one.hits, one.misses = stamp_s, one.hits + 1, 0
