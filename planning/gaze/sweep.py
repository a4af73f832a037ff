"""The sweep: the simple gaze policy with a fixed order of directions.

One gaze per footstep. Before the first step the robot stands and surveys its surroundings within the range of the
neck. Afterwards every other gaze goes along the path; the ones between go to a moving obstacle out of sight, else
left and right in turn.

Source: seed 003, section 5 (head command: the next way point, and sweeps); order and intervals are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import DARWIN_OP, HeadLimits

from ..commands import GazeCommand

# all ours
TILT_DEG = 28.0  # from 0.38 m and with 35 deg of view this shows the floor from 0.4 to 2.1 m
NEAR_TILT_DEG = 38.0  # this shows the floor from 0.3 to 1.0 m
NEAR_M = 0.6  # distance below which that tilt is used
SURVEY_PANS_DEG = (0.0, 40.0, 80.0, 40.0, 0.0, -40.0, -80.0, -40.0)  # views of 44 deg overlap
GLANCE_PANS_DEG = (40.0, -40.0, 80.0, -80.0)
REVISIT_S = 1.0
"""Ours: two steps, rounded; the gaze looks for a moving obstacle that is out of sight for longer."""
REVISIT_M = 2.0  # distance within which it does
CLOSE_M, CLOSE_REVISIT_S = 1.2, 0.6  # the same for a close one
UNWATCHED_S = 2.0  # ours: three steps; longest time without a look along the path
VIEW_DEG = 44.0  # seed 004: horizontal field of view of the narrowest depth camera
LONG_UNSEEN_S = 3.0  # out of sight for longer, an obstacle may have reversed


class Sweep:
    """Chooses one gaze per footstep; remembers the last look in each direction."""

    def __init__(self, head: HeadLimits = DARWIN_OP.head) -> None:
        self._limit = math.radians(head.pan_deg)
        self._surveyed = 0
        self._glances = 0
        self._ahead_s = -math.inf  # stamp of the last look along the path
        self._lateral = False  # whether the last gaze left the path
        self._sought_s: dict[int, float] = {}  # by track: stamp of the last look for it

    @property
    def surveying(self) -> bool:
        """Whether the survey is under way; the robot should stand meanwhile."""
        return self._surveyed <= len(SURVEY_PANS_DEG)

    def survey(self) -> None:
        """Survey the surroundings again, from the next gaze on."""
        self._surveyed = 0

    def next(
        self,
        stamp_s: float,
        robot: Pose2,
        via: Float[np.ndarray, "2"],
        obstacles: Sequence[Obstacle],
    ) -> GazeCommand:
        """The gaze until the next footstep.

        Args:
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
            robot: Pose, world frame.
            via: Via point, world frame, m.
            obstacles: Tracks, world frame.
        """
        if self._surveyed < len(SURVEY_PANS_DEG):
            pan = math.radians(SURVEY_PANS_DEG[self._surveyed])
            self._surveyed += 1
            return self._gaze(pan, math.inf)
        self._surveyed += 1
        ahead = self._walking(robot, via)
        overdue = stamp_s - self._ahead_s >= UNWATCHED_S - 0.7
        if self._lateral and overdue:
            return self._look_ahead(stamp_s, ahead)
        lost = self._lost(stamp_s, robot, obstacles)
        if lost is not None:
            self._lateral = True
            track, pan, distance = lost
            self._sought_s[track] = stamp_s
            return self._gaze(pan, distance)
        if self._lateral or self._ahead_s == -math.inf:
            return self._look_ahead(stamp_s, ahead)
        self._lateral = True
        pan = math.radians(GLANCE_PANS_DEG[self._glances % len(GLANCE_PANS_DEG)])
        self._glances += 1
        return self._gaze(ahead + pan if abs(ahead + pan) <= self._limit else pan, math.inf)

    def _walking(self, robot: Pose2, via: np.ndarray) -> float:
        """Pan towards the via point."""
        dx, dy = float(via[0]) - robot.x, float(via[1]) - robot.y
        if math.hypot(dx, dy) < 0.05:
            return 0.0
        off = wrap_angle(math.atan2(dy, dx) - robot.yaw)
        return min(max(off, -self._limit), self._limit)

    def _look_ahead(self, stamp_s: float, pan: float) -> GazeCommand:
        self._ahead_s = stamp_s
        self._lateral = False
        return self._gaze(pan, math.inf)

    def _lost(
        self, stamp_s: float, robot: Pose2, obstacles: Sequence[Obstacle]
    ) -> tuple[int, float, float] | None:
        """Track, pan and distance of the moving obstacle with the longest time out of sight by its distance."""
        best, found = 0.0, None
        reach = self._limit + math.radians(VIEW_DEG / 2)
        for obstacle in obstacles:
            unseen = stamp_s - obstacle.seen_s
            alone = min(unseen, stamp_s - self._sought_s.get(obstacle.track, -math.inf))
            if obstacle.moving < MOVING:
                continue
            for place in _may_be(obstacle, unseen):
                dx, dy = float(place[0]) - robot.x, float(place[1]) - robot.y
                distance = math.hypot(dx, dy)
                pan = wrap_angle(math.atan2(dy, dx) - robot.yaw)
                patience = CLOSE_REVISIT_S if distance < CLOSE_M else REVISIT_S
                if alone <= patience or distance > REVISIT_M or abs(pan) > reach:
                    continue
                need = alone / max(distance, 0.3)
                if need > best:
                    best, found = need, (obstacle.track, pan, distance)
        return found

    def _gaze(self, pan: float, distance_m: float) -> GazeCommand:
        tilt = NEAR_TILT_DEG if distance_m < NEAR_M else TILT_DEG
        return GazeCommand(min(max(pan, -self._limit), self._limit), math.radians(tilt))


def _may_be(obstacle: Obstacle, unseen_s: float) -> list[Float[np.ndarray, "2"]]:
    """Possible positions of an obstacle out of sight: straight on, or reversed at the last sighting."""
    back = obstacle.position - 2.0 * obstacle.velocity * unseen_s
    return [obstacle.position] if unseen_s < LONG_UNSEEN_S else [obstacle.position, back]
