"""The places to walk to, one after the other, when a mission is over, and the face planners share for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.estimate import Estimate
from perception.primitives.pose import wrap_angle
from planning.planners.mission import MissionConfig

TURNING = (
    2.0  # ours: so many times its tolerance a robot may drift from its goal while it turns there
)


@runtime_checkable
class Course(Protocol):
    """What a planner asks of its goals: a list that is worked off, or one that holds by the clock."""

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        ...

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The place to walk to now, map frame, m; None if there is none."""
        ...

    def distance(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 if there is none."""
        ...

    def finished(self, estimate: Estimate) -> bool:
        """Take in where the robot is; whether the mission is over."""
        ...


class GoalSeeker:
    """The part of a planner that every walker to goals has alike."""

    def __init__(self, goals: Course) -> None:
        """Set out.

        Args:
            goals: Where to walk.
        """
        self._goals = goals

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._goals.reached

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        return self._goals.distance(estimate)

    def finished(self, estimate: Estimate) -> bool:
        """Whether the last goal is reached or the time is up; called once per frame."""
        return self._goals.finished(estimate)


class Goals:
    """A list of places that is worked off by the estimated pose."""

    def __init__(
        self,
        goals: Sequence[tuple[float, float]],
        config: MissionConfig,
        headings_deg: Sequence[float] = (),
    ) -> None:
        """Set out.

        Args:
            goals: Where to walk, one after the other, map frame, m.
            config: Tolerances and time limit.
            headings_deg: th_tg, with which to arrive at each; NaN, or none given for it: with any.
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
        """The place to walk to now, map frame, m; None when all are reached."""
        return self._goals[self._reached] if self._reached < len(self._goals) else None

    @property
    def heading(self) -> float | None:
        """th_tg of the present goal, map frame, rad; None for any."""
        if self._reached >= min(len(self._headings), len(self._goals)):
            return None
        heading = self._headings[self._reached]
        return None if math.isnan(heading) else heading

    @property
    def turning(self) -> bool:
        """Whether the place of the present goal is reached, and only its heading is not."""
        return self._there

    def distance(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        if self.present is None or estimate.pose is None:
            return 0.0
        return float(np.linalg.norm(self.present - estimate.pose.mean[:2]))

    def finished(self, estimate: Estimate) -> bool:
        """Count the present goal if it is reached; whether all are, or the time is up."""
        reach = self._config.tolerance_m * (TURNING if self._there else 1.0)
        near = estimate.pose is not None and self.distance(estimate) <= reach
        self._there = self.present is not None and near
        if self._there and self._faces(estimate):
            self._reached, self._there = self._reached + 1, False
        return self.present is None or estimate.stamp_s >= self._config.time_limit_s

    def _faces(self, estimate: Estimate) -> bool:
        """Whether the robot has the heading of the present goal."""
        if self.heading is None or estimate.pose is None:
            return True
        off = wrap_angle(float(estimate.pose.mean[2]) - self.heading)
        return abs(off) <= math.radians(self._config.heading_tolerance_deg)
