"""The univector field straight to the goal: no search, no via points, the guard alone beside it.

What moves is a disc of the field, and every occupied cell near by is one that stands; the additions of seed 001
(virtual obstacles, change of speed, gaze, uncertainty) are switches of `univector`. Where the field has a trap (a
hollow that opens towards the robot) this planner stays in it; that is what the search is for.

Source: seed 001, sections 4 and 6; cells as discs are ours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.evidence import OCCUPIED
from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from planning import footsteps
from planning.commands import GazeCommand, WalkCommand
from planning.gaze.attention import GazeContext
from planning.gaze.policy import GazePolicy
from planning.safety.guard import Guard
from planning.univector import motion

from .config.schema import Config
from .goals import Goals, GoalSeeker
from .planners import Decision
from .run.pipeline import Pipeline

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
        self._goals: Goals
        super().__init__(Goals(goals, config.mission, config.mission.headings_deg))
        self._config, self._robot = config, config.robot_model
        self._gaze = GazePolicy(config.gaze, self._robot)
        self._guard = Guard(config.guard, self._robot)
        self._speed_mps = 0.0

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """Nothing to be done between footsteps: the pipeline remembers."""

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The field's step, if the guard lets it pass."""
        goal = self._goals.present
        if estimate.pose is None or pipeline.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot = estimate.pose2
        obstacles = [o.gone_straight() if o.moving >= MOVING else o for o in estimate.obstacles]
        movers = [o for o in obstacles if o.moving >= MOVING]
        cells = _cells(pipeline.grid, movers)
        known = GazeContext(
            estimate.pose,
            pipeline.grid,
            pipeline.confidence,
            pipeline.landmarks,
            estimate.sightings,
        )
        gaze = self._gaze.next(estimate.stamp_s, robot, goal, obstacles, known)
        desired, why = WalkCommand(), "survey"
        if not self._gaze.surveying:
            desired = self._desired(estimate.pose, goal, movers, cells, pipeline.grid.cell_m)
            why = "walk"
        walk = self._guard.choose(desired, estimate.pose, obstacles, cells, goal, estimate.stamp_s)
        self._speed_mps = walk.forward_m / self._robot.gait.step_s
        return Decision(walk, gaze, why if walk == desired else "guard")

    def _desired(
        self,
        pose: Gaussian,
        goal: Float[np.ndarray, "2"],
        movers: Sequence[Obstacle],
        cells: Float[np.ndarray, "n 2"],
        cell_m: float,
    ) -> WalkCommand:
        """The field's step, with all the additions that its switches ask for."""
        field, gait = self._config.univector, self._robot.gait
        x, y, yaw = (float(v) for v in pose.mean)
        arrival = self._goals.heading
        if arrival is not None and self._goals.turning:
            return footsteps.footstep(arrival, 0.0, Pose2(x, y, yaw), gait)
        advice = motion.advise(
            pose,
            self._speed_mps,
            movers,
            goal,
            arrival,
            field,
            self._robot,
            self._config.gaze.map.evaluation,
            cells[np.hypot(*(cells - [x, y]).T) < NEAR_M],
            cell_m,
        )
        speed = advice.speed_mps if field.velocity_change else gait.cruise_mps
        return footsteps.footstep(advice.heading_rad, speed, Pose2(x, y, yaw), gait)


def _cells(grid: EgocentricGrid, movers: Sequence[Obstacle]) -> Float[np.ndarray, "n 2"]:
    """Middles of occupied cells that no mover accounts for, world frame, m."""
    cells = grid.centres()[grid.known & (grid.probability >= OCCUPIED)]
    free = np.ones(len(cells), dtype=bool)
    for mover in movers:
        free &= np.hypot(*(cells - mover.position).T) > mover.radius_m + BESIDE_M
    return np.asarray(cells[free])
