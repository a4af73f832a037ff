"""A track with its history: whether the world, not only the estimate, shows that the obstacle moves.

The filter of a track knows positions and radii. A static obstacle can deceive it: another side comes into view, a
cluster is split, the pose of the camera is wrong. A moving obstacle leaves places that it filled and enters places that
were seen free, so the points on its front are compared with the depth images of other frames: a point of an earlier
frame through which this frame sees has been left, a point of this frame through which an earlier one saw has been
entered. A velocity that most obstacles share is that of a wrong pose.

Source: ours; free space along the line of sight as in occupancy grids (Moravec and Elfes 1985).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..primitives.gaussian import Gaussian
from ..primitives.motion import GOING
from ..primitives.obstacle import MOVING
from ..primitives.pose import Pose2
from .motion_model import MotionModel
from .track import SHAPE_MEMORY_S, UNSURE, Detection

Through = Callable[[Float[np.ndarray, "n 3"]], tuple[int, int]]
"""How many points of the map, m, a frame sees through, and how many it shows to be occupied (`Sight`)."""

DISPLACED_SHARE = 0.5  # ours: least share of the judged points that are seen through
DISPLACED_POINTS = 3  # ours: least number of them
DISPLACED_FRAMES = 2  # ours: frames that must agree; one may have a wrong pose
SNAPSHOTS = 4  # ours: earlier detections of a track that a new one is compared with
SNAPSHOT_S = 1.0  # ours: time between them
COMMON = 3  # ours: least number of tracks in view whose velocities are compared
SURE = 9.21  # 99 % of chi-square with two degrees of freedom


@dataclass(frozen=True)
class Snapshot:
    """A detection in one frame.

    Args:
        stamp_s: Time of the frame.
        surface: Points on its front, map frame, m; none if not known.
        through: What the frame sees through; None if not known.
    """

    stamp_s: float
    surface: Float[np.ndarray, "k 3"]
    through: Through | None

    @classmethod
    def of(
        cls, seen: Detection, stamp_s: float, robot: Gaussian, through: Through | None
    ) -> Snapshot:
        """Of a detection in the body frame, from the pose (x, y, yaw) of the robot."""
        x, y, yaw = robot.mean.tolist()
        return cls(stamp_s, Pose2(x, y, yaw).lifted().apply(seen.surface), through)

    def apart_from(self, other: Snapshot) -> bool:
        """Whether one of the two frames sees through the place of the surface in the other frame."""
        for through, surface in ((self.through, other.surface), (other.through, self.surface)):
            if through is not None:
                free, occupied = through(surface)
                if free >= max(DISPLACED_SHARE * (free + occupied), DISPLACED_POINTS):
                    return True
        return False


@dataclass
class Record:
    """A track and its detection history.

    Args:
        track: Its filter.
        number: Its number.
        since_s, seen_s: Time of the first and of the last detection.
        hits, misses: Frames with a detection, and without one although visible.
        earlier: Earlier detections, the first one first.
        displaced: Frames in which it had left the place of one of these, or entered a place seen free then.
        compared_s: When it was last compared.
        carried: Frames of doubt left after it had the velocity of most others.
        youth: Time, detection and pose of the robot of its first frames, while it is young.
    """

    track: MotionModel
    number: int
    since_s: float
    seen_s: float
    hits: int = 1
    misses: int = 0
    earlier: list[Snapshot] = field(default_factory=list)
    displaced: int = 0
    compared_s: float = -np.inf
    carried: int = 0
    youth: list[tuple[float, Detection, Gaussian]] = field(default_factory=list)

    @property
    def moving(self) -> float:
        """Probability of moving; unsure without displaced points, and with the velocity of most others."""
        doubtful = self.carried > 0 or bool(self.earlier)
        return min(self.track.moving, UNSURE) if doubtful else self.track.moving

    def grow(self, frame: tuple[float, Detection, Gaussian], young_s: float) -> None:
        """Keep the detection of a frame while the track is young."""
        if frame[0] - self.since_s <= young_s:
            self.youth.append(frame)
        else:
            self.youth.clear()

    def compare(self, now: Snapshot) -> None:
        """Compare its surface in this frame with that in earlier ones, until it is clear that it has moved.

        After a long gap the comparison begins anew: the error of the pose is another one, perhaps even the obstacle.
        """
        if now.through is None or not len(now.surface) or self.displaced >= DISPLACED_FRAMES:
            return
        if self.earlier and now.stamp_s - self.compared_s > SHAPE_MEMORY_S:
            self.earlier.clear()
        self.compared_s = now.stamp_s
        if self.track.moving >= MOVING and any(now.apart_from(one) for one in self.earlier):
            self.displaced += 1
        if self.displaced >= DISPLACED_FRAMES:
            self.earlier.clear()
        elif not self.earlier or now.stamp_s - self.earlier[-1].stamp_s >= SNAPSHOT_S:
            if len(self.earlier) == SNAPSHOTS:
                del self.earlier[1]
            self.earlier.append(now)


def doubt_carried(records: Sequence[Record]) -> None:
    """Doubt the motion of obstacles that share a velocity, if they are at least three and more than half of all.

    Then it is the pose of the camera that moves. They share one if their velocities agree better than chance, and if
    that velocity explains them together better than standing does. The doubt lasts twice as long as they share it.

    Args:
        records: Those detected in this frame.
    """
    moving = [record for record in records if record.track.moving >= MOVING]
    sharing: list[Record] = []
    if len(moving) >= COMMON and 2 * len(moving) > len(records):
        own = [_velocity(record.track) for record in moving]
        common = np.median([velocity.mean for velocity in own], axis=0)
        apart = np.array([velocity.mahalanobis_squared(common) for velocity in own])
        gained = np.array([velocity.mahalanobis_squared(np.zeros(2)) for velocity in own]) - apart
        near = apart < SURE
        if apart[near].sum() < near.sum() - 1 and gained[near].sum() > SURE:
            sharing = [record for record, is_near in zip(moving, near, strict=True) if is_near]
    shared = len(sharing) >= COMMON and 2 * len(sharing) > len(records)
    for record in records:
        is_carried = shared and any(record is one for one in sharing)
        record.carried = record.carried + 2 if is_carried else max(record.carried - 1, 0)


def _velocity(track: MotionModel) -> Gaussian:
    """Velocity, m/s, if it goes straight: the sharpest of the modes that go."""
    if track.motion is None:
        return Gaussian(track.state.mean[2:], track.state.covariance[2:, 2:])
    return Gaussian(track.motion.means[GOING, 2:], track.motion.covariances[GOING, 2:, 2:])
