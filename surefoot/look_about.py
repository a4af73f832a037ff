"""Where the search finds no way, or nothing moves on: stop, look about, and pass as seed 004 does.

The search walks a disc. A body is narrower one way than the other, and a panorama shows gaps that a grid of
coarse cells closes. So a robot that has all but stood for three seconds, with nothing moving near, turns to its
goal, takes a panorama, chooses side, motion and pivot, and walks that motion's legs, the pivot first; then
the search goes on from there. While it looks about, whatever comes near hands the step back to the guard.

Source: the specification's rule of cooperation; seed 004 for what it does.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.obstacle import MOVING

from .avoidance_planner import LOOKS, AvoidancePlanner, Look
from .config.schema import Config
from .planners import Decision, Planner
from .run.pipeline import Pipeline

LOG = logging.getLogger(__name__)

WORD = "no way: looks about"
SLOW_MPS = 0.02  # specification: slower than this is stuck ...
STUCK_S = 3.0  # ... for so long
TURNING_RAD = math.radians(2.0)  # ours: who turns is not stuck
NEAR_M = 1.2  # ours: a mover as near is what the guard waits for, and nobody turns the eyes from it
AGAIN_S = 30.0  # ours: after a look, until the next one


class LookAbout:
    """The planner that was asked for, and seed 004's way where that one is stuck."""

    def __init__(
        self, planner: Planner, config: Config, goals: Sequence[tuple[float, float]]
    ) -> None:
        """Set out.

        Args:
            planner: Who decides while there is a way.
            config: Of everything.
            goals: The same that the planner has.
        """
        self._planner, self._config, self._goals = planner, config, goals
        self._robot = config.robot_model
        self._avoider: AvoidancePlanner | None = None
        self._looks: list[Look] = []
        self._still_since_s = math.inf
        self._next_s = -math.inf

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._planner.reached

    @property
    def looks(self) -> list[Look]:
        """What was seen by looking about, and what came of it, for people."""
        return self._looks + ([] if self._avoider is None else self._avoider.looks)

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        return self._planner.distance_to_goal(estimate)

    def finished(self, estimate: Estimate) -> bool:
        """Whether the mission is over, as the planner sees it."""
        return self._planner.finished(estimate)

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Take in one cycle."""
        self._planner.notice(frame, estimate, pipeline)
        if self._avoider is not None:
            self._avoider.notice(frame, estimate, pipeline)

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The next footstep by whom there is a way for."""
        if self._avoider is not None:
            if self._avoider.looking and _disturbed(estimate):
                LOG.info("%.1f s: something comes near: looks about no more", estimate.stamp_s)
                self._go_on(estimate.stamp_s)
            else:
                decision = self._avoider.decide(frame, estimate, pipeline)
                if self._avoider.at_it:
                    return replace(decision, why=f"{WORD}, {decision.why}")
                self._go_on(estimate.stamp_s)
        decision = self._planner.decide(frame, estimate, pipeline)
        if self._stuck(decision, estimate):
            LOG.info("%.1f s: no way on: looks about", estimate.stamp_s)
            self._avoider = AvoidancePlanner(self._config, self._goals[self.reached :])
            self._avoider.look_about()
        return decision

    def _go_on(self, stamp_s: float) -> None:
        self._looks, self._avoider = self.looks[-LOOKS:], None
        self._still_since_s, self._next_s = math.inf, stamp_s + AGAIN_S

    def _stuck(self, decision: Decision, estimate: Estimate) -> bool:
        """Whether it has all but stood for long enough, though it knows where it is and nothing moves near."""
        walk = decision.walk
        speed = math.hypot(walk.forward_m, walk.lateral_m) / self._robot.gait.step_s
        still = speed < SLOW_MPS and abs(walk.turn_rad) < TURNING_RAD and decision.why != "survey"
        if not still or estimate.pose is None or _disturbed(estimate):
            self._still_since_s = math.inf
            return False
        self._still_since_s = min(self._still_since_s, estimate.stamp_s)
        long = estimate.stamp_s - self._still_since_s >= STUCK_S
        return long and estimate.stamp_s >= self._next_s and self.reached < len(self._goals)


def _disturbed(estimate: Estimate) -> bool:
    """Whether anything that probably moves is near."""
    if estimate.pose is None:
        return False
    here = estimate.pose.mean[:2]
    return any(
        one.moving >= MOVING and math.dist(one.position.tolist(), here.tolist()) < NEAR_M
        for one in estimate.obstacles
    )
