"""Tracks of other robots, from an observer with an uncertain pose and with false sightings.

Each track is a sigma-point filter over position and velocity with a speed prior. Sightings outside the gate are
rejected; several consecutive rejected sightings that agree with each other restart the track. A track is confirmed
after enough sightings over enough time, since misread tags appear only briefly.

Source: ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import chi_square_quantile
from perception.filtering.models import wrap_angles
from perception.filtering.square_root import SquareRootFilter
from perception.planar.config import PlanarConfig
from perception.primitives.gaussian import Gaussian

GATE = chi_square_quantile(0.9999, 2)  # wide: true sightings are rare
SPEED_SIGMA = 0.05  # m/s per axis: such robots drive at 0.07 m/s
TURN_S = 5.0  # correlation time of the velocity
BODY_SIGMA_M = 0.03  # tags are mounted around the body's centre
CONFIRM_SIGHTINGS, CONFIRM_S = 4, 1.0  # sightings and duration that confirm a track
FORGET_S = 30.0  # after a longer gap the track must be confirmed again


@dataclass
class _Track:
    filter: SquareRootFilter
    stamp_s: float
    first_s: float
    sightings: int = 0

    @property
    def confirmed(self) -> bool:
        """Whether the track has enough sightings over enough time."""
        long_enough = self.stamp_s - self.first_s >= CONFIRM_S
        return self.sightings >= CONFIRM_SIGHTINGS and long_enough


class RobotTracks:
    """Tracks by robot identity."""

    def __init__(self, config: PlanarConfig) -> None:
        """Use the sighting noise fitted to landmarks."""
        self.config = config
        self.rejected = 0
        self._tracks: dict[int, _Track] = {}
        self._candidates: dict[int, _Track] = {}

    def update(
        self, subject: int, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian
    ) -> Gaussian | None:
        """Process one sighting.

        Args:
            subject: Robot identity by the tag.
            stamp_s: Time, not before the last sighting.
            seen: Depth, m, and bearing, rad.
            robot: Pose (x, y, yaw) of the observer.

        Returns:
            State (x, y, vx, vy), m and m/s, world frame; None if the track is unconfirmed or the sighting rejected.
        """
        track = self._tracks.setdefault(subject, self._new_track(stamp_s, seen, robot))
        if track.sightings == 0 or self._update_gated(track, stamp_s, seen, robot):
            track.sightings += 1
            self._candidates.pop(subject, None)
            return track.filter.belief if track.confirmed else None
        self.rejected += 1
        candidate = self._candidates.setdefault(subject, self._new_track(stamp_s, seen, robot))
        if candidate.sightings and not self._update_gated(candidate, stamp_s, seen, robot):
            candidate = self._candidates[subject] = self._new_track(stamp_s, seen, robot)
        candidate.sightings += 1
        if not candidate.confirmed:
            return None
        self._tracks[subject] = self._candidates.pop(subject)
        return candidate.filter.belief

    def _update_gated(
        self, track: _Track, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian
    ) -> bool:
        """Predict a track and update it with a sighting; returns whether the sighting passed the gate."""
        dt = stamp_s - track.stamp_s
        keep = math.exp(-dt / TURN_S)
        F = np.eye(4)
        F[0, 2] = F[1, 3] = TURN_S * (1.0 - keep)
        F[2, 2] = F[3, 3] = keep
        place = 2.0 * TURN_S * dt - TURN_S**2 * (3.0 - keep) * (1.0 - keep)
        product = TURN_S * (1.0 - keep) ** 2
        Q = np.kron([[max(place, 0.0), product], [product, 1.0 - keep**2]], np.eye(2))
        track.filter.predict(lambda points: points @ F.T, SPEED_SIGMA**2 * Q + 1e-12 * np.eye(4))
        track.stamp_s = stamp_s
        if dt > FORGET_S:
            track.sightings, track.first_s = 0, stamp_s
        used, _ = track.filter.update(
            lambda points: self._seen(points, robot.mean),
            seen,
            self._noise(seen, robot),
            angles=(1,),
            gate=GATE,
        )
        return used

    def _new_track(self, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian) -> _Track:
        ahead = (seen[0] - self.config.offset) / self.config.scale
        x, y, yaw = robot.mean
        reach, direction = ahead / math.cos(seen[1]), yaw + seen[1]
        mean = np.array(
            [x + reach * math.cos(direction), y + reach * math.sin(direction), 0.0, 0.0]
        )
        away = (0.1 * reach) ** 2 + 0.05**2
        start = Gaussian(mean, np.diag([away, away, SPEED_SIGMA**2, SPEED_SIGMA**2]))
        track = _Track(SquareRootFilter(start), stamp_s, stamp_s)
        track.filter.update(
            lambda points: self._seen(points, robot.mean), seen, self._noise(seen, robot), (1,)
        )
        return track

    def _seen(self, points: np.ndarray, robot: np.ndarray) -> np.ndarray:
        """Predicted depth and bearing of positions (k, 2 or more) from the observer (x, y, yaw)."""
        x, y = points[:, 0] - robot[0], points[:, 1] - robot[1]
        c, s = math.cos(robot[2]), math.sin(robot[2])
        ahead, left = c * x + s * y, c * y - s * x
        depth = self.config.offset + self.config.scale * ahead
        return np.stack([depth, wrap_angles(np.arctan2(left, ahead))], axis=-1)

    def _noise(self, seen: Float[np.ndarray, "2"], robot: Gaussian) -> Float[np.ndarray, "2 2"]:
        """Covariance of depth and bearing: camera noise, tag position on the body, and the observer's pose."""
        c = self.config
        depth = math.hypot(c.depth_near, c.depth_far * seen[0] ** 2) * math.hypot(1, c.depth_shared)
        bearing = math.hypot(c.bearing_sigma, c.bearing_shared)
        reach = max(abs(float(seen[0])), 0.3)
        R = np.diag([depth**2 + BODY_SIGMA_M**2, bearing**2 + (BODY_SIGMA_M / reach) ** 2])
        yaw, left = float(robot.mean[2]), reach * math.tan(float(seen[1]))
        ahead, side = (
            np.array([math.cos(yaw), math.sin(yaw)]),
            np.array([-math.sin(yaw), math.cos(yaw)]),
        )
        H = np.array([[*(-ahead), left], [*(-side / reach), -1.0]])
        return np.asarray(R + H @ robot.covariance @ H.T)
