"""Planner by the univector field straight to the goal: without search or via points, checked by the guard.

Moving obstacles are discs of the field, and so is every occupied cell near the robot. The additions of seed 001
(virtual obstacles, velocity change, gaze coupling, uncertainty) are switches of `univector`. In a local minimum of
the field, such as a concave obstacle, this planner gets stuck; the search planner does not.

With `univector.mode` "seed" or "printed" it is the walker of seed 001: every tracked obstacle is a disc that grows with
the evaluations, the speed changes by the printed law, the goals are via points that are passed with a heading, and
nothing checks the steps. The heading at a via point, which the paper leaves open, is that of the line from the one
before: eq. (9) ignores obstacles that lie off the direction to the goal, and any other heading leads through them on
the curve that it asks for (contacts per course of 30 m, six courses: 2.5; heading from the one before to
the next: 4.2; without headings: 2.3).

Source: seed 001, sections 4 and 6; cells as discs are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.evidence import OCCUPIED
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2

from .. import footsteps
from ..commands import GazeCommand, WalkCommand
from ..gaze.attention import GazeContext
from ..gaze.policy import GazeControl
from ..safety.guard import Guard
from ..safety.step_filter import StepFilter, Unfiltered
from ..univector import motion
from ..world_model import WorldModel
from .goals import Goals, GoalSeeker
from .planner import Decision, Plan
from .settings import PlanningConfig

NEAR_M = 0.8  # ours: farther cells do not reach into the field here
BESIDE_M = 0.05  # ours: a cell this near to an obstacle's disc belongs to it


class FieldPlanner(GoalSeeker):
    """Walks along the field to one goal after the other."""

    def __init__(self, config: PlanningConfig, goals: Sequence[tuple[float, float]]) -> None:
        """Begin with the first goal.

        Args:
            config: Settings of planning.
            goals: In order, map frame, m.
        """
        self._goals: Goals
        super().__init__(Goals(goals, config.mission, config.mission.headings_deg))
        self._config, self._robot = config, config.robot
        self.gaze = GazeControl(config.gaze, self._robot)
        self._field = config.univector.as_walked
        self._start: Float[np.ndarray, "2"] | None = None
        self._published = self._field.mode != "ours"
        self._guard: StepFilter = (
            Unfiltered() if self._published else Guard(config.guard, self._robot, config.cell_m)
        )
        self._speed_mps = 0.0

    def observe(self, world: WorldModel) -> None:
        """Nothing to do between footsteps."""

    def decide(self, world: WorldModel) -> Decision:
        """The field's step, if the guard lets it pass."""
        goal = self.goal
        if world.pose is None or world.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot = world.pose2
        obstacles = [o.gone_straight() if o.moving >= MOVING else o for o in world.tracks]
        discs = [o for o in obstacles if self._published or o.moving >= MOVING]
        cells = _cells(world.grid, discs)
        gaze = self.gaze.next(world.stamp_s, robot, goal, obstacles, GazeContext.of(world))
        desired, why = WalkCommand(), "survey"
        if not self.gaze.surveying:
            desired = self._desired(world.pose, goal, discs, cells, world.grid.cell_m)
            why = "walk"
        unseen = world.grid.centres()[~world.grid.known]
        walk = self._guard.choose(
            desired, world.pose, obstacles, cells, goal, world.stamp_s, unseen
        )
        self._speed_mps = walk.forward_m / self._robot.gait.step_s
        plan = Plan(goal, gaze_map=self.gaze.valued)
        if isinstance(self._guard, Guard):
            plan = replace(plan, steps=self._guard.ahead, risk=self._guard.risk)
        word = self._guard.word if isinstance(self._guard, Guard) else "guard"
        return Decision(walk, gaze, why if walk == desired else word, plan=plan)

    def _desired(
        self,
        pose: Gaussian,
        goal: Float[np.ndarray, "2"],
        discs: Sequence[Obstacle],
        cells: Float[np.ndarray, "n 2"],
        cell_m: float,
    ) -> WalkCommand:
        """The field's step, with all the additions that its switches ask for."""
        field, gait = self._field, self._robot.gait
        x, y, yaw = (float(v) for v in pose.mean)
        arrival = self._goals.heading
        if arrival is not None and self._goals.turning:
            return footsteps.footstep(arrival, 0.0, Pose2(x, y, yaw), gait)
        if arrival is None and self._published:
            arrival = self._along(pose.mean[:2], goal)
        advice = motion.advise(
            pose,
            self._speed_mps,
            discs,
            goal,
            arrival,
            field,
            self._robot,
            self._config.gaze.map.evaluation,
            cells[np.hypot(*(cells - [x, y]).T) < NEAR_M],
            cell_m,
        )
        speed = advice.speed_mps if field.velocity_change else gait.cruise_mps
        away_m = math.hypot(goal[0] - x, goal[1] - y)
        return footsteps.footstep(advice.heading_rad, speed, Pose2(x, y, yaw), gait, away_m)

    def _along(self, here: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"]) -> float:
        """th_tg at a via point without a given heading: of the line from the via point before."""
        if self._start is None:
            self._start = here.copy()
        last = self._goals.last
        x, y = goal - (self._start if last is None else last)
        return math.atan2(y, x)


def _cells(grid: EgocentricGrid, discs: Sequence[Obstacle]) -> Float[np.ndarray, "n 2"]:
    """Middles of occupied cells that no disc accounts for, world frame, m."""
    cells = grid.centres()[grid.known & (grid.probability >= OCCUPIED)]
    free = np.ones(len(cells), dtype=bool)
    for disc in discs:
        free &= np.hypot(*(cells - disc.position).T) > disc.radius_m + BESIDE_M
    return np.asarray(cells[free])
