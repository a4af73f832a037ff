"""Planner for ground of several levels: a place for every foot, and the gaze where the next ones will land.

Once a step the way for the body and the next footsteps are planned anew. What stands above the ground keeps the body away.
Where no step leads on, the robot stands and looks about, then gives up: "unknown" is a reason to stop.

Source: ours.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from mapping.ground.levels import Levels
from perception.primitives.pose import Pose2

from ..commands import GazeCommand, WalkCommand
from ..footholds import room
from ..footholds.foothold import Foothold, FootNoise
from ..footholds.search import NODES, FootstepPlan, PlanEnd, Stance, plan
from ..world_model import WorldModel
from .planner import Decision, Plan
from .settings import PlanningConfig

NEAR_M = 0.10  # ours: of the goal; half of a long step
LOOKS = ((0.0, 0.0), (0.0, 0.25), (0.35, 0.1), (-0.35, 0.1), (0.0, -0.2), (0.0, 0.1))
"""Ours: gaze of a robot that stands and looks about, pan and tilt from its usual one, rad."""
PATIENCE = 2  # ours: steps more than a turn about takes that lead nowhere before it looks about, and again before it gives up
SOMEWHERE_M = 0.5  # ours: from where it was, of a step that leads somewhere
LINGERS, THOROUGH = 6, 4 * NODES
"""Ours: steps that lead nowhere, after which a search may take so many nodes."""
LEAST_GAIN = 0.5
"""Ours: of a longest step, for which a step to the border of what is known is worth it."""
AHEAD = 3  # ours: footsteps at which the gaze is directed
LEVEL_M = 0.01  # ours: a step that rises by less is level


class FootholdPlanner:
    """Walks over surfaces to goals, one after the other.

    Args:
        config: Robot, footholds.
        goals: Map frame, m.
    """

    def __init__(self, config: PlanningConfig, goals: Sequence[tuple[float, float]]) -> None:
        self._config, self._goals = config, [np.array(goal) for goal in goals]
        model = config.robot
        steps = replace(model.steps, up_m=min(model.steps.up_m, model.steps.down_m))
        self._robot = replace(model, steps=steps)  # no step up that cannot be taken back
        self._patience = PATIENCE + math.ceil(math.pi / model.gait.max_turn_rad)
        self._idle = self._surveyed = 0
        self._from, self._left = np.full(2, math.inf), 0  # a place, and landings when it was left
        self._gave_up = False
        self._reached = 0

    @property
    def reached(self) -> int:
        """Goals reached so far."""
        return self._reached

    def observe(self, world: WorldModel) -> None:
        """Nothing to do between footsteps."""

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        if self._reached == len(self._goals):
            return 0.0
        return float(np.linalg.norm(self._goals[self._reached] - world.pose2.vector[:2]))

    def finished(self, world: WorldModel) -> bool:
        """Whether all goals are reached, or no step leads on."""
        return self._gave_up or self._reached == len(self._goals)

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep and gaze.

        Without ground of several levels in the world model it stands.
        """
        levels = world.levels
        if levels is None or self._reached == len(self._goals):
            return Decision(WalkCommand(stay=True), GazeCommand(), "blocked")
        robot, began_s = self._robot, time.thread_time()
        middle = np.array([0.0, -levels.foot * robot.stance_m / 2])
        ground = room.reachable(levels.surfaces, robot.steps.down_m)
        space = room.terrain(ground, levels.voxels, robot, middle)
        roomed_s = time.thread_time()
        goal = self._goals[self._reached]
        here = levels.stands.apply(middle)
        if np.linalg.norm(here - self._from) > SOMEWHERE_M:
            self._from, self._left = here, levels.landings
        lingered = levels.landings - self._left
        found = plan(
            levels.surfaces, Stance(levels.foot, Pose2()), levels.stands.inverse().apply(goal), NEAR_M, robot,
            FootNoise(*levels.step_sigma.tolist()), self._config.footholds, space,
            THOROUGH if self._idle > 0 or lingered > LINGERS else NODES,
        )  # fmt: skip
        decision = self._decided(world, levels, found, middle, lingered)
        times = {"room": roomed_s - began_s, "plan": time.thread_time() - roomed_s}
        shown = replace(decision.plan or Plan(), goal=goal)
        if decision.why == "arrived":
            self._reached += 1
        self._gave_up = decision.why == "unknown"
        timing_ms = {name: 1e3 * seconds for name, seconds in times.items()}
        return replace(decision, plan=shown, timing_ms=timing_ms)

    def _decided(
        self,
        world: WorldModel,
        levels: Levels,
        found: FootstepPlan,
        middle: Float[np.ndarray, "2"],
        lingered: int,
    ) -> Decision:
        """The decision by a plan, and the middle between the feet."""
        robot = self._robot
        there = self._goals[self._reached]
        goal = levels.stands.inverse().apply(there)
        if np.linalg.norm(goal - middle) <= NEAR_M:
            joined = np.linalg.norm(world.pose2.inverse().apply(there)) <= NEAR_M
            return Decision(WalkCommand(), self._gaze(goal), "arrived" if joined else "walk")
        if self._surveyed < len(LOOKS):
            self._surveyed += 1
            return self._look(goal, self._surveyed - 1, "survey")
        least_m = LEAST_GAIN * robot.gait.max_speed_mps * robot.gait.step_s
        onward = found.end is not PlanEnd.BORDER or found.gain_m > least_m
        if not onward or lingered > self._patience:
            self._idle += 1
            tries = self._idle - len(LOOKS)
            if tries > self._patience or (tries > len(LOOKS) and not found.footholds):
                return Decision(WalkCommand(stay=True), self._gaze(goal), "unknown")
            if tries <= 0 or not found.footholds:
                return self._look(goal, self._idle % len(LOOKS), "look")
        else:
            self._idle = 0
        command = found.commands[0]
        walk = replace(command, forward_m=command.forward_m - levels.slip_m)
        why = "walk" if abs(walk.rise_m) < LEVEL_M else ("up" if walk.rise_m > 0.0 else "down")
        target = found.footholds[min(AHEAD, len(found.footholds)) - 1].pose.vector[:2]
        return Decision(walk, self._gaze(target), why, plan=_shown(levels, found.footholds))

    def _look(self, goal: Float[np.ndarray, "2"], number: int, why: str) -> Decision:
        """Stand and look about: towards the goal, and beside and above that."""
        pan, tilt = LOOKS[number]
        away = goal / max(float(np.linalg.norm(goal)), 1e-9)
        usual = self._gaze(0.6 * self._robot.hip_m * away)
        gaze = GazeCommand(usual.pan_rad + pan, usual.tilt_rad + tilt)
        return Decision(WalkCommand(stay=True), gaze, why)

    def _gaze(self, target: Float[np.ndarray, "2"]) -> GazeCommand:
        """The gaze at a place on the ground."""
        robot = self._robot
        x, y = (float(v) for v in target)
        high, low = (math.radians(v) for v in robot.head.tilt_deg)
        tilt = math.atan2(robot.eye_m, max(math.hypot(x, y), 1e-3))
        return GazeCommand(math.atan2(y, max(x, 0.1)), min(max(tilt, high), low))


def _shown(levels: Levels, footholds: Sequence[Foothold]) -> Plan:
    """The footholds of a plan, map frame."""
    steps = np.array([(levels.stands @ one.pose).vector for one in footholds])
    return Plan(steps=steps.reshape(-1, 3), foothold=footholds[0] if footholds else None)
