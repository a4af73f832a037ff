"""Glances: looks aside, for one step, for a moving obstacle that the picture ahead does not show.

A camera that always looks ahead loses crossing obstacles, and the guard must assume that they may have reversed. A glance
resolves this. At most every other step is one; the robot then walks on to the target chosen before, since the picture of
a glance selects none. Of several obstacles it goes to the one that could arrive first if it reversed at its last
sighting. A robot that waits without such an obstacle looks to both sides alternately.

Source: ours; in seed 000 the head stays ahead.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import RobotModel

from .command import angle_to

# all ours
UNSEEN_S = 0.5  # an obstacle in the second picture of the last step needs no glance
REACH_M = 1.3  # farther obstacles are ten seconds away
FROM_DEG = 35.0  # nearer to the axis the picture ahead shows the obstacle, unless it is occluded
TO_DEG = 120.0  # farther round it is behind the robot
SPARE_DEG = 20.0  # the head stops short of the predicted direction, which is uncertain
MOST_DEG = 75.0  # largest pan


class Glances:
    """Chooses the pan of each step; remembers the last side."""

    def __init__(self, robot: RobotModel, enabled: bool = True) -> None:
        self._robot, self._enabled = robot, enabled
        self._lateral = False  # whether the last pan was a glance
        self._side = 1.0  # side of the last look while waiting

    def next(
        self, robot: Pose2, movers: Sequence[Obstacle], stamp_s: float, waits: bool = False
    ) -> float:
        """Pan of the head for the next step, left positive, rad; 0 is ahead.

        Args:
            robot: Pose, world frame.
            movers: Moving obstacles at their predicted positions, world frame.
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
            waits: Whether the robot gives way and hardly moves.
        """
        if self._lateral or not self._enabled:
            self._lateral = False
            return 0.0
        wanted: list[tuple[float, float]] = []
        for mover in movers:
            away = math.hypot(mover.position[0] - robot.x, mover.position[1] - robot.y)
            side = angle_to(mover.position, robot)
            beside = FROM_DEG <= abs(math.degrees(side)) <= TO_DEG
            unseen = stamp_s - mover.seen_s
            if beside and away < REACH_M and unseen > UNSEEN_S:
                closing = self._robot.gait.max_speed_mps + math.hypot(*mover.velocity)
                left = (away - self._robot.radius_m - mover.radius_m) / closing - unseen
                wanted.append((left, side))
        self._lateral = bool(wanted) or waits
        if not wanted:
            self._side = -self._side if waits else self._side
            return self._side * math.radians(MOST_DEG) if waits else 0.0
        _, side = min(wanted)
        pan = max(abs(side) - math.radians(SPARE_DEG), 0.0)
        return wrap_angle(math.copysign(min(pan, math.radians(MOST_DEG)), side))
