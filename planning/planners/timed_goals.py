"""Goals that hold by the clock, and a schedule that makes up lost time.

Source: seed 000, section 6.5.1; the schedule is ours.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits

from ..commands import WalkCommand
from ..footsteps import limited_step
from ..world_model import WorldModel
from .mission import MissionConfig

STRAIGHT = 0.9  # ours: share of the cruising step from which a step counts as straight ahead
CATCH_UP_S = 5.0  # ours: time in which a delay is made up
NEAR_GOAL_M = 0.25  # ours: a goal this near lies below the picture's lowest rows


class Schedule:
    """Distance to the goal over time at cruising speed; a delay is made up by longer steps.

    The mean speed of approach never exceeds cruising speed.
    """

    def __init__(self, gait: GaitLimits) -> None:
        self._gait = gait
        self._goal: np.ndarray | None = None
        self._from_m, self._since_s = 0.0, 0.0

    def make_up(
        self, desired: WalkCommand, goal: Float[np.ndarray, "2"], robot: Pose2, stamp_s: float
    ) -> WalkCommand:
        """The desired step, lengthened if it leads straight ahead and the robot is late.

        Args:
            desired: Step at cruising speed.
            goal: Present goal, world frame, m; a new goal begins a new schedule.
            robot: Pose, world frame.
            stamp_s: Now, s.
        """
        gait = self._gait
        away = float(np.hypot(*(goal - np.array([robot.x, robot.y]))))
        if self._goal is None or not np.array_equal(goal, self._goal):
            self._goal, self._from_m, self._since_s = goal.copy(), away, stamp_s
        behind = away - (self._from_m - gait.cruise_mps * (stamp_s - self._since_s))
        cruise = gait.cruise_mps * gait.step_s
        if behind <= cruise or desired.forward_m < STRAIGHT * cruise or away < NEAR_GOAL_M:
            return desired
        faster = min(
            gait.max_speed_mps / gait.cruise_mps, 1.0 + behind / CATCH_UP_S / gait.cruise_mps
        )
        return limited_step(gait, faster * desired.forward_m / gait.step_s, 0.0, desired.turn_rad)


class TimedGoals:
    """One goal at a time, each valid from a given time on; only the last one ends the mission.

    Source: seed 000, section 6.5.1.
    """

    def __init__(
        self,
        goals: Sequence[tuple[float, float]],
        times_s: Sequence[float],
        mission: MissionConfig,
    ) -> None:
        """Begin with the first goal.

        Args:
            goals: Map frame, m; those beyond the number of times are not used.
            times_s: From when each goal is valid, ascending, s.
            mission: Tolerance.
        """
        self._times = times_s[: len(goals)]
        self._goals = [np.array(goal) for goal in goals[: len(self._times)]]
        self._mission = mission
        self._reached: set[int] = set()
        self._index = 0

    @property
    def reached(self) -> int:
        """Goals reached while they were valid."""
        return len(self._reached)

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The goal that is valid now, map frame, m."""
        return self._goals[self._index] if self._goals else None

    def distance(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m."""
        if self.present is None or world.pose is None:
            return 0.0
        return float(np.linalg.norm(self.present - world.pose.mean[:2]))

    def finished(self, world: WorldModel) -> bool:
        """Count the goal if it is reached, advance by the clock; whether the last one is reached."""
        self._index = max(0, bisect.bisect_right(self._times, world.stamp_s) - 1)
        if world.pose is not None and self.distance(world) <= self._mission.tolerance_m:
            self._reached.add(self._index)
        return not self._goals or len(self._goals) - 1 in self._reached
