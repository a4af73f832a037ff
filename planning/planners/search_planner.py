"""The default planner: grid search, univector field, guard and gaze.

A* on the egocentric grid gives a via point, or the next point of its smoothed curve (seed 003), the univector field
leads there (seed 001), the guard replaces steps that come too close to static or moving obstacles (ours), and the gaze
policy chooses where to look.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.evidence import OCCUPIED
from mapping.grid.world_map import WorldMap
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.stopwatch import Stopwatch

from .. import footsteps
from ..commands import GazeCommand, WalkCommand
from ..exploration import ExplorationMap, Explorer
from ..gaze.attention import GazeContext
from ..gaze.policy import GazeControl
from ..safety.guard import Guard
from ..safety.guard_inputs import standing_cells, straight_tracks
from ..safety.line_of_sight import farthest_visible
from ..safety.step_filter import StepFilter
from ..search.curve_walk import CurveWalk
from ..search.route import Route
from ..univector import motion
from ..world_model import WorldModel
from .goals import Goals
from .planner import Decision, Plan
from .settings import PlanningConfig

DEPTH_M = 0.15  # ours: least depth of furniture behind a visible face
HIDDEN = np.float32(0.6)  # ours: occupancy assumed behind a visible face
SAME_M = 1e-6
MOVER_COST = np.float32(0.4)
"""Ours: occupancy that the search assumes for cells of moving obstacles."""


class SearchPlanner:
    """Walks to goals in order, or explores."""

    def __init__(
        self,
        config: PlanningConfig,
        goals: Sequence[tuple[float, float]],
        stepper: StepFilter | None = None,
    ) -> None:
        """Begin with the first goal.

        Args:
            config: Settings of planning; `mission.wander` explores instead of going to the goals.
            goals: In order, map frame, m.
            stepper: Checks every step; None: the guard.
        """
        self._config, self._robot = config, config.robot
        self._guard = Guard(config.guard, self._robot, config.cell_m)
        self._stepper: StepFilter = self._guard if stepper is None else stepper
        self._goals = Goals(goals, config.mission, config.mission.headings_deg)
        self._explorer = (
            Explorer(config.exploration, self._robot) if config.mission.wander else None
        )
        self._route = Route(config.search, config.route, self._robot)
        self._curve = CurveWalk(self._robot.gait) if config.route.follow == "curve" else None
        self.gaze = GazeControl(config.gaze, self._robot)
        self._speed_mps = 0.0

    @property
    def reached(self) -> int:
        """Goals reached so far; places visited when exploring."""
        return self._goals.reached if self._explorer is None else self._explorer.visited

    def distance_to_goal(self, world: WorldModel) -> float:
        """Distance from the estimated pose to the present goal, m; 0 when all are reached."""
        return 0.0 if self._explorer else self._goals.distance(world)

    def finished(self, world: WorldModel) -> bool:
        """Whether all goals are reached; exploring ends with the time alone."""
        return self._explorer is None and self._goals.finished(world)

    def observe(self, world: WorldModel) -> None:
        """Nothing to do between footsteps."""

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep and gaze; called once per footstep."""
        goal = self._goal(world)
        if world.pose is None or world.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        grid, robot, watch = world.grid, world.pose2, Stopwatch(time.thread_time)
        obstacles = straight_tracks(world.tracks)
        with watch.stage("route"):
            probability, unknown, occupied, unseen = _as_ground(grid, world.world_map)
            ground = probability, unknown, grid.origin, grid.cell_m
            via = self._route.update(*ground, robot, goal, world.world_map)
        with watch.stage("gaze"):
            expected = self._guard.expected(obstacles, world.stamp_s)
            gaze = self.gaze.next(world.stamp_s, robot, via, expected, GazeContext.of(world))
        with watch.stage("field"):
            desired, why = self._wanted(world.pose, via, obstacles)
        with watch.stage("guard"):
            standing = standing_cells(grid.centres()[occupied], obstacles, grid.cell_m)
            here = world.pose.mean[:2]
            near_m = self._guard.cell_distance_m
            target = farthest_visible(here, self._route.ahead(here), standing, near_m)
            walk = self._stepper.choose(
                desired,
                world.pose,
                obstacles,
                standing,
                target,
                world.stamp_s,
                grid.centres()[unseen],
            )
        self._speed_mps = walk.forward_m / self._robot.gait.step_s
        if walk != desired:
            why = self._guard.word if self._stepper is self._guard else "guard"
        return Decision(walk, gaze, why, watch.milliseconds, plan=self._plan(here, goal))

    def _plan(self, here: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"]) -> Plan:
        """What is intended beyond the next step."""
        route = np.vstack([here, self._route.ahead(here)])
        guarded = self._stepper is self._guard
        return Plan(
            goal,
            route if self._route.path is not None else np.zeros((0, 2)),
            self._guard.ahead if guarded else np.zeros((0, 3)),
            self._guard.risk if guarded else None,
            self.gaze.valued,
        )

    def _goal(self, world: WorldModel) -> Float[np.ndarray, "2"] | None:
        """The present goal, map frame, m; None without one."""
        if self._explorer is None:
            return self._goals.present
        if world.pose is None or world.world_map is None or not world.world_map.known.any():
            return None
        occupancy = world.world_map
        known = occupancy.known
        occupied = known & (occupancy.probability >= OCCUPIED)
        ground = ExplorationMap(
            occupied, known, occupancy.updated_s, occupancy.origin, occupancy.cell_m
        )
        visited = self._explorer.visited
        goal = self._explorer.goal(ground, world.pose.mean[:2], world.stamp_s)
        if self._explorer.visited > visited:
            self.gaze.survey()
        return goal

    def _wanted(
        self, pose: Gaussian, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle]
    ) -> tuple[WalkCommand, str]:
        """The step before the guard checks it, and why."""
        if self.gaze.surveying:
            return WalkCommand(), "survey"
        gait = self._robot.gait
        if self.gaze.turning:
            turn = math.copysign(gait.max_turn_rad, self.gaze.turning)
            return footsteps.limited_step(gait, 0.0, 0.0, turn), "look behind"
        if self._goals.turning and self._goals.heading is not None:
            x, y, yaw = (float(v) for v in pose.mean)
            return footsteps.footstep(self._goals.heading, 0.0, Pose2(x, y, yaw), gait), "walk"
        if self._route.path is None:
            return WalkCommand(), "blocked"
        if self._curve is not None:
            via = self._curve.aim(self._route.path, pose.mean[:2])
        return self._desired(pose, via, obstacles), "walk"

    def _desired(
        self, pose: Gaussian, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle]
    ) -> WalkCommand:
        """The field's step round moving obstacles; the path avoids the static ones."""
        config, gait = self._config.univector, self._robot.gait
        x, y, yaw = (float(v) for v in pose.mean)
        to_goal = _same(via, self._goals.present)
        arrival = self._goals.heading if to_goal else None
        movers = [o for o in obstacles if o.moving >= MOVING]
        advice = motion.advise(
            pose,
            self._speed_mps,
            movers,
            via,
            arrival,
            config,
            self._robot,
            self._config.gaze.map.evaluation,
        )
        speed = advice.speed_mps if config.velocity_change else gait.cruise_mps
        away_m = math.hypot(via[0] - x, via[1] - y) if to_goal else math.inf
        return footsteps.footstep(advice.heading_rad, speed, Pose2(x, y, yaw), gait, away_m)


def _same(via: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"] | None) -> bool:
    """Whether the via point is the goal, but for the rounding to cells and back."""
    return goal is not None and math.dist(via, goal) < SAME_M


def _as_ground(
    grid: EgocentricGrid, world_map: WorldMap | None = None
) -> tuple[
    Float32[np.ndarray, "n n"],
    Bool[np.ndarray, "n n"],
    Bool[np.ndarray, "n n"],
    Bool[np.ndarray, "n n"],
]:
    """Occupancy and unknown cells for the search, the cells that no step may touch, and those never seen.

    What stood in cells that the grid has forgotten, unseen for half a minute, stands there until it is seen to be gone.
    Static obstacles extend behind the face that is seen. The search keeps away from all unseen cells beside a face; no
    step may touch those with free ground opposite, which the unseen ground at the feet of the robot has not. Cells of
    moving obstacles are expensive for the search, not blocked: the guard avoids the obstacles themselves.
    """
    probability, known, moving = grid.probability, grid.known, grid.moving
    unseen = ~known
    if world_map is not None:
        y, x = (low + grid.cell_m * (np.arange(len(known)) + 0.5) for low in grid.origin[::-1])
        remembered, stands, _ = world_map.standing(x, y)
        unseen &= ~stands
        stood = ~known & stands & (remembered >= OCCUPIED)
        probability, known = np.where(stood, remembered, probability), known | stood
    occupied = known & (probability >= OCCUPIED)
    standing = (occupied & ~moving).view(np.uint8)
    diamond = _diamond(round(DEPTH_M / grid.cell_m))
    beside = ~known & cv2.dilate(standing, diamond).view(np.bool_)
    behind = beside & _opposite(known & ~occupied, standing.view(np.bool_), diamond)
    probability = np.where(known & moving, np.minimum(probability, MOVER_COST), probability)
    probability = np.where(beside, HIDDEN, probability).astype(np.float32)
    return probability, ~known & ~beside, occupied | behind, unseen


def _opposite(
    free: Bool[np.ndarray, "n n"],
    standing: Bool[np.ndarray, "n n"],
    offsets: UInt8[np.ndarray, "side side"],
) -> Bool[np.ndarray, "n n"]:
    """Cells that mirror a free one in a standing one, which lies at one of the offsets."""
    n, edge = len(free), len(offsets) - 1
    ground, face = np.pad(free, edge), np.pad(standing, edge)
    found = np.zeros_like(free)
    for row, column in np.argwhere(offsets) - edge // 2:
        over = face[edge + row :, edge + column :][:n, :n]
        found |= over & ground[edge + 2 * row :, edge + 2 * column :][:n, :n]
    return found


@cache
def _diamond(cells: int) -> UInt8[np.ndarray, "side side"]:
    """Structuring element: cells within that many steps up, down, left and right."""
    along = np.abs(np.arange(-cells, cells + 1))
    return (along[:, None] + along <= cells).astype(np.uint8)
