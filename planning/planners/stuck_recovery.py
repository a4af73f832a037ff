"""Recovery when stuck: panoramic scan, then a manoeuvre of seed 004.

The grid search plans for a disc. A body is narrower in one direction, and a panorama shows gaps that coarse grid cells
close. So a robot that has hardly moved for three seconds, with no moving obstacle near, turns to its goal, makes a
panorama, chooses side, motion and pivot, and walks the legs of that motion; then the planner goes on. A moving
obstacle that comes near ends the scan, and the planner with its guard decides again. A passage that turns out to be
blocked is scanned once more; if that way is blocked too, the planner goes on as well.

Source: the specification's rule of cooperation; seed 004 for the manoeuvre.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

from perception.primitives.obstacle import MOVING

from ..world_model import WorldModel
from .avoidance_planner import LOOKS, AvoidancePlanner, Look
from .planner import Decision, Planner
from .settings import PlanningConfig

LOG = logging.getLogger(__name__)

RECOVERY = "recovery"
SLOW_MPS = 0.02  # specification: a robot slower than this ...
STUCK_S = 3.0  # ... for this long is stuck
TURNING_RAD = math.radians(2.0)  # ours: a robot that turns is not stuck
NEAR_M = 1.2  # ours: the guard waits for moving obstacles this near, and the gaze must follow them
AGAIN_S = 30.0  # ours: least time between two recoveries
SCANS = 2  # ours: of one recovery; the second knows what blocked the first passage


class StuckRecovery:
    """The given planner, and the avoidance planner's manoeuvre where that one is stuck."""

    def __init__(
        self, planner: Planner, config: PlanningConfig, goals: Sequence[tuple[float, float]]
    ) -> None:
        """Begin with the given planner.

        Args:
            planner: Decides unless the robot is stuck.
            config: Settings of planning.
            goals: Those of the planner.
        """
        self._planner, self._config, self._goals = planner, config, goals
        self._robot = config.robot
        self._manoeuvre: AvoidancePlanner | None = None
        self._looks: list[Look] = []
        self._still_since_s = math.inf
        self._next_s = -math.inf

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._planner.reached

    @property
    def looks(self) -> list[Look]:
        """Panoramic scans so far, for the report."""
        return self._looks + ([] if self._manoeuvre is None else self._manoeuvre.looks)

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        return self._planner.distance_to_goal(world)

    def finished(self, world: WorldModel) -> bool:
        """Whether the planner's mission is over."""
        return self._planner.finished(world)

    def observe(self, world: WorldModel) -> None:
        """Take in one frame."""
        self._planner.observe(world)
        if self._manoeuvre is not None:
            self._manoeuvre.observe(world)

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep, of the planner or of the recovery."""
        if self._manoeuvre is not None:
            if self._manoeuvre.looking and self._ends(world, len(self._manoeuvre.looks)):
                self._resume(world.stamp_s)
            else:
                decision = self._manoeuvre.decide(world)
                if self._manoeuvre.active:
                    return replace(decision, why=f"{RECOVERY}, {decision.why}")
                self._resume(world.stamp_s)
        decision = self._planner.decide(world)
        if self._stuck(decision, world):
            LOG.info("%.1f s: stuck: recovery by panoramic scan", world.stamp_s)
            self._manoeuvre = AvoidancePlanner(self._config, self._goals[self.reached :])
            self._manoeuvre.look_about()
        return decision

    @staticmethod
    def _ends(world: WorldModel, scans: int) -> bool:
        """Whether a recovery that is about to scan, or scans, is over."""
        if scans >= SCANS:
            LOG.info("%.1f s: no passage found: recovery ended", world.stamp_s)
            return True
        if _disturbed(world):
            LOG.info("%.1f s: a moving obstacle comes near: scan ended", world.stamp_s)
            return True
        return False

    def _resume(self, stamp_s: float) -> None:
        """Back to the planner."""
        self._looks, self._manoeuvre = self.looks[-LOOKS:], None
        self._still_since_s, self._next_s = math.inf, stamp_s + AGAIN_S

    def _stuck(self, decision: Decision, world: WorldModel) -> bool:
        """Whether the robot has hardly moved for long enough, localised and with no moving obstacle near."""
        walk = decision.walk
        speed = math.hypot(walk.forward_m, walk.lateral_m) / self._robot.gait.step_s
        still = speed < SLOW_MPS and abs(walk.turn_rad) < TURNING_RAD and decision.why != "survey"
        if not still or world.pose is None or _disturbed(world):
            self._still_since_s = math.inf
            return False
        self._still_since_s = min(self._still_since_s, world.stamp_s)
        long = world.stamp_s - self._still_since_s >= STUCK_S
        return long and world.stamp_s >= self._next_s and self.reached < len(self._goals)


def _disturbed(world: WorldModel) -> bool:
    """Whether an obstacle that probably moves is near."""
    if world.pose is None:
        return False
    here = world.pose.mean[:2]
    return any(
        one.moving >= MOVING and math.dist(one.position.tolist(), here.tolist()) < NEAR_M
        for one in world.tracks
    )
