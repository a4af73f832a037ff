"""Other robots, followed by one that knows where it is only roughly, and among sightings that are none.

Each is a sigma-point filter over place and velocity that knows how fast such robots go. A sighting that does not
fit is not believed; several in a row that fit each other begin the track anew. A track counts once it has
been seen often and long enough: a misread tag is seen for a moment.
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

GATE = chi_square_quantile(0.9999, 2)  # true sightings are rarer than phantoms are dangerous
SPEED_SIGMA = 0.05  # m/s per axis: such robots drive at 0.07 m/s
TURN_S = 5.0  # s, for about so long they keep their direction
BODY_SIGMA_M = 0.03  # tags stand around the body, not in its middle
CONFIRM_SIGHTINGS, CONFIRM_S = 4, 1.0  # to count: seen so often, over so long
FORGET_S = 30.0  # unseen for so long, it must be confirmed again


@dataclass
class _Track:
    filter: SquareRootFilter
    stamp_s: float
    first_s: float
    sightings: int = 0

    @property
    def confirmed(self) -> bool:
        """Whether it counts."""
        long_enough = self.stamp_s - self.first_s >= CONFIRM_S
        return self.sightings >= CONFIRM_SIGHTINGS and long_enough


class RobotTracks:
    """Tracks by subject; `update` takes one sighting and tells where that robot is, if it is sure."""

    def __init__(self, config: PlanarConfig) -> None:
        """With the noise of sightings as fitted to landmarks."""
        self.config = config
        self.rejected = 0
        self._tracks: dict[int, _Track] = {}
        self._rivals: dict[int, _Track] = {}

    def update(
        self, subject: int, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian
    ) -> Gaussian | None:
        """Learn from a sighting.

        Args:
            subject: Which robot its tag says it is.
            stamp_s: When, not before the last one.
            seen: Depth, m, and bearing, rad.
            robot: Pose (x, y, yaw) of the observer then.

        Returns:
            Over (x, y, vx, vy), m and m/s, world frame; None while it is not confirmed or not believed.
        """
        track = self._tracks.setdefault(subject, self._begin(stamp_s, seen, robot))
        if track.sightings == 0 or self._fits(track, stamp_s, seen, robot):
            track.sightings += 1
            self._rivals.pop(subject, None)
            return track.filter.belief if track.confirmed else None
        self.rejected += 1
        rival = self._rivals.setdefault(subject, self._begin(stamp_s, seen, robot))
        if rival.sightings and not self._fits(rival, stamp_s, seen, robot):
            rival = self._rivals[subject] = self._begin(stamp_s, seen, robot)
        rival.sightings += 1
        if not rival.confirmed:
            return None
        self._tracks[subject] = self._rivals.pop(subject)
        return rival.filter.belief

    def _fits(
        self, track: _Track, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian
    ) -> bool:
        """Whether a sighting is believed to be of this track, which moves on and, if so, learns from it."""
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

    def _begin(self, stamp_s: float, seen: Float[np.ndarray, "2"], robot: Gaussian) -> _Track:
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
        """Depth and bearing of places (k, 2 or more) from the observer (x, y, yaw)."""
        x, y = points[:, 0] - robot[0], points[:, 1] - robot[1]
        c, s = math.cos(robot[2]), math.sin(robot[2])
        ahead, left = c * x + s * y, c * y - s * x
        depth = self.config.offset + self.config.scale * ahead
        return np.stack([depth, wrap_angles(np.arctan2(left, ahead))], axis=-1)

    def _noise(self, seen: Float[np.ndarray, "2"], robot: Gaussian) -> Float[np.ndarray, "2 2"]:
        """Of depth and bearing: of the camera, of the tag's place on the body, and of the observer's pose."""
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
