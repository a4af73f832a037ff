"""Deciding: the next footstep and the next look, from what the cycle concluded.

A* on the egocentric grid gives a via point (seed 003), the univector field walks there (seed 001), the
guard lets only steps pass that stay clear of what stands and of what may move (ours), and the gaze looks
where the robot will step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planning import footsteps, guard
from planning.commands import GazeCommand, WalkCommand
from planning.gaze.sweep import Sweep
from planning.route import Route
from planning.univector import fields

from .config import Config
from .pipeline import Estimate, Pipeline


@dataclass(frozen=True)
class Decision:
    """What the body is asked to do, and why in a word.

    Args:
        walk: The next footstep.
        gaze: Where to look meanwhile.
        why: "survey", "walk", "guard" or "blocked".
    """

    walk: WalkCommand
    gaze: GazeCommand
    why: str


class Navigator:
    """Walks to one goal after the other."""

    def __init__(self, config: Config, goals: Sequence[tuple[float, float]]) -> None:
        self._config = config
        self._goals = [np.array(goal) for goal in goals]
        self._route = Route(config.search)
        self._gaze = Sweep(config.gaze)
        self.reached = 0

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        if self.reached >= len(self._goals) or estimate.pose is None:
            return 0.0
        return float(np.linalg.norm(self._goals[self.reached] - estimate.pose.mean[:2]))

    def finished(self, estimate: Estimate) -> bool:
        """Whether all goals are reached or the time is up."""
        close = self.distance_to_goal(estimate) <= self._config.mission.tolerance_m
        if self.reached < len(self._goals) and close:
            self.reached += 1
        return (
            self.reached >= len(self._goals)
            or estimate.stamp_s >= self._config.mission.time_limit_s
        )
