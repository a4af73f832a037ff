"""Goals: a list that is worked off in order, and the part of a planner that deals with goals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import wrap_angle

from ..world_model import WorldModel
from .mission import MissionConfig

TURNING = 2.0  # ours: factor on the tolerance while the robot turns at its goal, against drift


@runtime_checkable
class GoalSequence(Protocol):
    """Goals in order, advanced by arrival (`Goals`) or by the clock (`TimedGoals`)."""

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        ...

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The present goal, map frame, m; None without one."""
        ...

    def distance(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 without one."""
        ...

    def finished(self, world: WorldModel) -> bool:
        """Count what is reached; whether the mission is over."""
        ...


class GoalSeeker:
    """Base of planners that walk to goals."""

    def __init__(self, goals: GoalSequence) -> None:
        """Begin with the first goal.

        Args:
            goals: In order.
        """
        self._goals = goals

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._goals.reached

    @property
    def goal(self) -> Float[np.ndarray, "2"] | None:
        """The present goal, map frame, m; None without one."""
        return self._goals.present

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        return self._goals.distance(world)

    def finished(self, world: WorldModel) -> bool:
        """Whether the last goal is reached; called once per frame."""
        return self._goals.finished(world)


class Goals:
    """Goals that are worked off by the estimated pose."""

    def __init__(
        self,
        goals: Sequence[tuple[float, float]],
        config: MissionConfig,
        headings_deg: Sequence[float] = (),
    ) -> None:
        """Begin with the first goal.

        Args:
            goals: In order, map frame, m.
            config: Tolerances.
            headings_deg: th_tg, heading to arrive with at each goal; NaN or missing: any.
        """
        self._goals = [np.array(goal) for goal in goals]
        self._headings = [math.radians(heading) for heading in headings_deg]
        self._config = config
        self._reached = 0
        self._there = False

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._reached

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The present goal, map frame, m; None when all are reached."""
        return self._goals[self._reached] if self._reached < len(self._goals) else None

    @property
    def heading(self) -> float | None:
        """th_tg of the present goal, map frame, rad; None for any."""
        if self._reached >= min(len(self._headings), len(self._goals)):
            return None
        heading = self._headings[self._reached]
        return None if math.isnan(heading) else heading

    @property
    def last(self) -> Float[np.ndarray, "2"] | None:
        """The goal that was reached last, map frame, m; None before the first."""
        return self._goals[self._reached - 1] if self._reached else None

    @property
    def turning(self) -> bool:
        """Whether the present goal's position is reached, but not yet its heading."""
        return self._there

    def distance(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        if self.present is None or world.pose is None:
            return 0.0
        return float(np.linalg.norm(self.present - world.pose.mean[:2]))

    def finished(self, world: WorldModel) -> bool:
        """Count the present goal if it is reached; whether all are."""
        reach = self._config.tolerance_m * (TURNING if self._there else 1.0)
        near = world.pose is not None and self.distance(world) <= reach
        self._there = self.present is not None and near
        if self._there and self._faces(world):
            self._reached, self._there = self._reached + 1, False
        return self.present is None

    def _faces(self, world: WorldModel) -> bool:
        """Whether the robot has the heading of the present goal."""
        if self.heading is None or world.pose is None:
            return True
        off = wrap_angle(float(world.pose.mean[2]) - self.heading)
        return abs(off) <= math.radians(self._config.heading_tolerance_deg)
