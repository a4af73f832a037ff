"""Planner by the univector field straight to the goal: without search or via points, checked by the guard.

Moving obstacles are discs of the field, and so is every occupied cell near the robot. The additions of seed 001
(virtual obstacles, velocity change, gaze coupling, uncertainty) are switches of `univector`. In a local minimum of
the field, such as a concave obstacle, this planner gets stuck; the search planner does not.

Source: seed 001, sections 4 and 6; cells as discs are ours.
"""

from __future__ import annotations

from collections.abc import Sequence

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
from ..univector import motion
from ..world_model import WorldModel
from .goals import Goals, GoalSeeker
from .planner import Decision
from .settings import PlanningConfig

NEAR_M = 0.8  # ours: farther cells do not reach into the field here
BESIDE_M = 0.05  # ours: a cell this near to a moving obstacle's disc belongs to it


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
        self._gaze = GazeControl(config.gaze, self._robot)
        self._guard = Guard(config.guard, self._robot)
        self._speed_mps = 0.0

    def observe(self, world: WorldModel) -> None:
        """Nothing to do between footsteps."""

    def decide(self, world: WorldModel) -> Decision:
        """The field's step, if the guard lets it pass."""
        goal = self._goals.present
        if world.pose is None or world.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot = world.pose2
        obstacles = [o.gone_straight() if o.moving >= MOVING else o for o in world.tracks]
        movers = [o for o in obstacles if o.moving >= MOVING]
        cells = _cells(world.grid, movers)
        gaze = self._gaze.next(world.stamp_s, robot, goal, obstacles, GazeContext.of(world))
        desired, why = WalkCommand(), "survey"
        if not self._gaze.surveying:
            desired = self._desired(world.pose, goal, movers, cells, world.grid.cell_m)
            why = "walk"
        walk = self._guard.choose(desired, world.pose, obstacles, cells, goal, world.stamp_s)
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
    """Middles of occupied cells that no moving obstacle accounts for, world frame, m."""
    cells = grid.centres()[grid.known & (grid.probability >= OCCUPIED)]
    free = np.ones(len(cells), dtype=bool)
    for mover in movers:
        free &= np.hypot(*(cells - mover.position).T) > mover.radius_m + BESIDE_M
    return np.asarray(cells[free])
