"""Deciding: the next footstep and the next look, from what the cycle concluded.

A* on the egocentric grid gives a via point (seed 003), the univector field walks there (seed 001), the
guard lets only steps pass that stay clear of what stands and of what may move (ours), and the gaze looks
where the robot will step.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from mapping.grid.confidence import ConfidenceLayer
from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.evidence import OCCUPIED
from mapping.grid.world_map import WorldMap
from perception.estimate import Estimate
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2
from planning import footsteps
from planning.commands import GazeCommand, WalkCommand
from planning.exploration import ExplorationMap, Explorer
from planning.gaze.attention import GazeContext
from planning.gaze.policy import GazePolicy
from planning.safety.guard import Guard
from planning.safety.line_of_sight import farthest_visible
from planning.safety.step_filter import StepFilter
from planning.search.route import Route
from planning.univector import motion

from .config.schema import Config
from .goals import Goals
from .planners import Decision
from .run.stopwatch import Stopwatch

CELL_M = 0.05  # half a cell's diagonal and the position error of a track
DEPTH_M = 0.15  # least depth of furniture: how far behind a seen face nobody walks unseen
HIDDEN = np.float32(0.6)  # probability of what is behind a seen face
MOVER_COST = np.float32(0.4)  # probability that the search gives to a mover's cell


@runtime_checkable
class Memory(Protocol):
    """What the navigator asks of a pipeline: the maps, and the landmarks known beforehand."""

    @property
    def grid(self) -> EgocentricGrid | None:
        """The terrain map; None before the first view."""
        ...

    @property
    def confidence(self) -> ConfidenceLayer | None:
        """How fresh its cells are."""
        ...

    @property
    def world(self) -> WorldMap:
        """The map of everything, for who wanders."""
        ...

    @property
    def landmarks(self) -> Sequence[Landmark]:
        """Tags."""
        ...


class Navigator:
    """Walks to one goal after the other, or wanders about and explores."""

    def __init__(
        self,
        config: Config,
        goals: Sequence[tuple[float, float]],
        stepper: StepFilter | None = None,
    ) -> None:
        """Set out.

        Args:
            config: Of everything; `mission.wander` explores instead of going to the goals.
            goals: Where to walk, one after the other, map frame, m.
            stepper: Who has the last word on every step; None: the guard.
        """
        self._config, self._robot = config, config.robot_model
        self._guard = Guard(config.guard, self._robot)
        self._stepper: StepFilter = self._guard if stepper is None else stepper
        self._goals = Goals(goals, config.mission, config.mission.headings_deg)
        self._explorer = (
            Explorer(config.exploration, self._robot) if config.mission.wander else None
        )
        self._route = Route(config.search, config.route, self._robot)
        self._gaze = GazePolicy(config.gaze, self._robot)
        self._speed_mps = 0.0

    @property
    def reached(self) -> int:
        """Goals reached so far; places visited by who wanders."""
        return self._goals.reached if self._explorer is None else self._explorer.visited

    def distance_to_goal(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        return 0.0 if self._explorer else self._goals.distance(estimate)

    def finished(self, estimate: Estimate) -> bool:
        """Whether all goals are reached or the time is up; who wanders has no other end."""
        if self._explorer is not None:
            return estimate.stamp_s >= self._config.mission.time_limit_s
        return self._goals.finished(estimate)

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Memory) -> None:
        """Nothing to be done between footsteps: the pipeline remembers."""

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Memory) -> Decision:
        """The next footstep and gaze; to be asked once per footstep."""
        goal = self._goal(estimate, pipeline)
        if estimate.pose is None or pipeline.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        grid, robot, watch = pipeline.grid, estimate.pose2, Stopwatch(time.thread_time)
        obstacles = _supposed(estimate.obstacles)
        with watch.stage("route"):
            probability, unknown, occupied = _as_ground(grid)
            via = self._route.update(probability, unknown, grid.origin, grid.cell_m, robot, goal)
        with watch.stage("gaze"):
            known = GazeContext(
                estimate.pose,
                grid,
                pipeline.confidence,
                pipeline.landmarks,
                estimate.sightings,
                estimate.clusters,
            )
            expected = self._guard.expected(obstacles, estimate.stamp_s)
            gaze = self._gaze.next(estimate.stamp_s, robot, via, expected, known)
        with watch.stage("field"):
            desired, why = self._wanted(estimate.pose, via, obstacles)
        with watch.stage("guard"):
            standing = _not_movers(grid.centres()[occupied], obstacles)
            here = estimate.pose.mean[:2]
            near_m = self._guard.cell_distance_m
            target = farthest_visible(here, self._route.ahead(here), standing, near_m)
            walk = self._stepper.choose(
                desired, estimate.pose, obstacles, standing, target, estimate.stamp_s
            )
        self._speed_mps = walk.forward_m / self._robot.gait.step_s
        return Decision(walk, gaze, why if walk == desired else "guard", watch.milliseconds)

    def _goal(self, estimate: Estimate, pipeline: Memory) -> Float[np.ndarray, "2"] | None:
        """The place to walk to at present; None if there is none."""
        if self._explorer is None:
            return self._goals.present
        if estimate.pose is None or not pipeline.world.known.any():
            return None
        world = pipeline.world
        known = world.known
        occupied = known & (world.probability >= OCCUPIED)
        ground = ExplorationMap(occupied, known, world.updated_s, world.origin, world.cell_m)
        visited = self._explorer.visited
        goal = self._explorer.goal(ground, estimate.pose.mean[:2], estimate.stamp_s)
        if self._explorer.visited > visited:
            self._gaze.survey()
        return goal

    def _wanted(
        self, pose: Gaussian, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle]
    ) -> tuple[WalkCommand, str]:
        """The step before the guard is asked, and why in a word."""
        if self._gaze.surveying:
            return WalkCommand(), "survey"
        if self._goals.turning and self._goals.heading is not None:
            x, y, yaw = (float(v) for v in pose.mean)
            gait = self._robot.gait
            return footsteps.footstep(self._goals.heading, 0.0, Pose2(x, y, yaw), gait), "walk"
        if self._route.path is None:
            return WalkCommand(), "blocked"
        return self._desired(pose, via, obstacles), "walk"

    def _desired(
        self, pose: Gaussian, via: Float[np.ndarray, "2"], obstacles: Sequence[Obstacle]
    ) -> WalkCommand:
        """The field's step among what moves; what stands is the path's business."""
        config, gait = self._config.univector, self._robot.gait
        x, y, yaw = (float(v) for v in pose.mean)
        arrival = self._goals.heading if _same(via, self._goals.present) else None
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
        return footsteps.footstep(advice.heading_rad, speed, Pose2(x, y, yaw), gait)


def _same(via: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"] | None) -> bool:
    """Whether the way leads straight to the goal."""
    return goal is not None and np.array_equal(via, goal)


def _as_ground(
    grid: EgocentricGrid,
) -> tuple[Float32[np.ndarray, "n n"], Bool[np.ndarray, "n n"], Bool[np.ndarray, "n n"]]:
    """Probability and unknown cells for the search, and the cells that no step may touch.

    What stands has a depth: unseen cells just behind a seen face count as part of it. What moves will be
    elsewhere when the robot comes by: for the search it is dear, not solid; the guard sees to it.
    """
    probability, known, moving = grid.probability, grid.known, grid.moving
    occupied = known & (probability >= OCCUPIED)
    standing = (occupied & ~moving).view(np.uint8)
    near = cv2.dilate(standing, _diamond(round(DEPTH_M / grid.cell_m))).view(np.bool_)
    behind = ~known & near
    probability = np.where(known & moving, np.minimum(probability, MOVER_COST), probability)
    probability = np.where(behind, HIDDEN, probability).astype(np.float32)
    return probability, ~known & ~behind, occupied | behind


def _supposed(obstacles: Sequence[Obstacle]) -> list[Obstacle]:
    """Movers as if gone straight on since they were seen: field, guard and gaze suppose the rest themselves."""
    return [o.gone_straight() if o.moving >= MOVING else o for o in obstacles]


def _not_movers(
    cells: Float[np.ndarray, "n 2"], obstacles: Sequence[Obstacle]
) -> Float[np.ndarray, "m 2"]:
    """Occupied cells that no moving track accounts for; those that one does the guard rolls out."""
    movers = [o for o in obstacles if o.moving >= MOVING]
    places = np.array([o.position for o in movers]).reshape(-1, 2)
    reach = np.array([o.radius_m for o in movers]) + CELL_M
    gaps = np.linalg.norm(cells[:, None] - places, axis=2)
    return cells[(gaps > reach).all(axis=1)]


@cache
def _diamond(cells: int) -> UInt8[np.ndarray, "side side"]:
    """Places that so many steps up, down, left and right lead to."""
    along = np.abs(np.arange(-cells, cells + 1))
    return (along[:, None] + along <= cells).astype(np.uint8)
