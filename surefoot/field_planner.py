"""The univector field straight to the goal: no search, no via points, the guard alone beside it.

What moves is a disc of the field, and so is every occupied cell near by. Where the field has a trap (a
hollow that opens towards the robot) this planner stays in it; that is what the search is for.

Source: seed 001, section 4; cells as discs are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.egocentric_grid import EgocentricGrid
from perception.primitives.frame import Frame
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from planning import footsteps
from planning.commands import GazeCommand, WalkCommand
from planning.gaze.attention import Known
from planning.gaze.policy import GazePolicy
from planning.guard import Guard
from planning.univector import fields

from .config import Config
from .goals import Goals, GoalSeeker
from .pipeline import Estimate, Pipeline
from .planners import Decision

MOVER = 0.3  # probability of moving from which a track counts as a mover, as the guard has it
OCCUPIED = 0.5  # seed 003: a cell of this probability is never walked over
NEAR_M = 0.8  # ours: farther cells do not reach into the field here
BESIDE_M = 0.05  # ours: a cell this near to a mover's disc is the mover's own


class FieldPlanner(GoalSeeker):
    """Walks along the field to one goal after the other."""

    def __init__(self, config: Config, goals: Sequence[tuple[float, float]]) -> None:
        """Set out.

        Args:
            config: Of everything.
            goals: Where to walk, one after the other, map frame, m.
        """
        super().__init__(Goals(goals, config.mission))
        self._config = config
        self._gaze = GazePolicy(config.gaze)
        self._guard = Guard(config.guard)

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Nothing to be done between footsteps: the pipeline remembers."""

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The field's step, if the guard lets it pass."""
        goal = self._goals.present
        if estimate.pose is None or pipeline.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot, config = estimate.pose2, self._config
        obstacles = [o.gone_straight() if o.moving >= MOVER else o for o in estimate.obstacles]
        movers = [o for o in obstacles if o.moving >= MOVER]
        cells = _cells(pipeline.grid, movers)
        known = Known(
            estimate.pose,
            pipeline.grid,
            pipeline.confidence,
            pipeline.landmarks,
            estimate.sightings,
        )
        gaze = self._gaze.next(estimate.stamp_s, robot, goal, obstacles, known)
        desired, why = WalkCommand(), "survey"
        if not self._gaze.surveying:
            heading = self._heading(robot, goal, movers, cells, pipeline.grid.cell_m)
            gait, why = config.guard.gait, "walk"
            desired = footsteps.footstep(heading, gait.cruise_mps, robot, gait)
        walk = self._guard.choose(desired, estimate.pose, obstacles, cells, goal, estimate.stamp_s)
        return Decision(walk, gaze, why if walk == desired else "guard")

    def _heading(
        self,
        robot: Pose2,
        goal: Float[np.ndarray, "2"],
        movers: Sequence[Obstacle],
        cells: Float[np.ndarray, "n 2"],
        cell_m: float,
    ) -> float:
        """Direction of the field here."""
        config = self._config.univector
        near = cells[np.hypot(*(cells - [robot.x, robot.y]).T) < NEAR_M]
        radii = np.concatenate(
            [np.array([o.radius_m for o in movers]), np.full(len(near), cell_m / 2)]
        )
        speeds = np.concatenate(
            [np.array([float(np.hypot(*o.velocity)) for o in movers]), np.zeros(len(near))]
        )
        centres = np.concatenate([np.array([o.position for o in movers]).reshape(-1, 2), near])
        direction = fields.total(
            np.array([[robot.x, robot.y]]),
            goal,
            None,
            centres,
            fields.extended_radius(radii, speeds, np.zeros(len(radii)), config),
            config,
            np.array([robot.yaw]),
        )[0]
        return math.atan2(float(direction[1]), float(direction[0]))


def _cells(grid: EgocentricGrid, movers: Sequence[Obstacle]) -> Float[np.ndarray, "n 2"]:
    """Middles of occupied cells that no mover accounts for, world frame, m."""
    cells = grid.centres()[grid.known & (grid.probability >= OCCUPIED)]
    free = np.ones(len(cells), dtype=bool)
    for mover in movers:
        free &= np.hypot(*(cells - mover.position).T) > mover.radius_m + BESIDE_M
    return np.asarray(cells[free])
