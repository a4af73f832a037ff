"""Planner by one colour camera, without a map: from the floor by colour and the pose to the next footstep.

The floor that tracked obstacles will cover by the end of the next step is removed, the best pixel of the rest is
searched, and the footstep leads there. The seed ends here, and its slow robot is hit from the side. So the guard
checks the step against the tracks and the contacts of obstacles with the floor.

Source: seed 000, sections 2 to 5; tracks and guard are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.monocular import contact_detections
from perception.monocular.colour_floor import ColourFloor
from perception.monocular.result import Picture
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2, wrap_angle

from ..commands import GazeCommand, WalkCommand
from ..safety.guard import Guard
from ..safety.line_of_sight import farthest_visible
from ..swarm import command, search
from ..swarm.corners import Corners
from ..swarm.glances import Glances
from ..swarm.ground_memory import GroundMemory
from ..swarm.objective import Objective
from ..world_model import WorldModel
from .goals import Goals, GoalSeeker
from .planner import Decision, ImageTarget, Plan
from .settings import PlanningConfig
from .timed_goals import NEAR_GOAL_M, Schedule, TimedGoals

DOUBTED = 0.05
"""Ours: probability of moving above which the gaze follows a track; low, since an obstacle that reverses seems at rest."""
BESIDE_M = 0.05  # ours: a contact this near to a moving track belongs to it
GLANCE_RAD = math.radians(10.0)  # ours: with the head turned further the picture is a glance
WAITS = 0.6  # ours: share of the cruising step below which the robot counts as waiting


class SwarmPlanner(GoalSeeker):
    """Walks to goals in order, or to the one that is valid at the time."""

    def __init__(self, config: PlanningConfig, goals: Sequence[tuple[float, float]]) -> None:
        """Begin with the first goal.

        Args:
            config: Settings of planning.
            goals: Map frame, m.
        """
        times, mission = config.swarm.goal_times_s, config.mission
        super().__init__(TimedGoals(goals, times, mission) if times else Goals(goals, mission))
        self._config, self._settings = config, config.swarm.as_walked
        self._robot = config.robot
        self._published = config.swarm.version != "ours"
        self._corners = Corners(config.swarm.version)
        self._guard = Guard(config.guard, self._robot)
        self._standing = GroundMemory(self._robot.breadth)
        self._rng = np.random.default_rng([config.seed, 40])
        self._seen: ColourFloor | None = None  # in the last picture
        self._best: search.Best | None = None  # pixel chosen in this picture
        self._movable: np.ndarray | None = None  # where it was searched
        self._schedule = Schedule(self._robot.gait)
        self._glances = Glances(self._robot, self._settings.glances)
        self._place: Float[np.ndarray, "2"] | None = None  # of that pixel on the floor
        self._waits = False  # whether the guard shortened the last step

    def observe(self, world: WorldModel) -> None:
        """Remember the contacts with the floor in this frame's picture."""
        if world.estimate.colour is None or world.pose is None:
            return
        self._seen = seen = world.colour_floor
        if seen is None:
            return
        contacts = seen.contacts
        self._standing.update(
            world.stamp_s,
            np.array([seen.robot.x, seen.robot.y]),
            np.concatenate([np.empty((0, 2)), *contacts.points_world]),
            contacts.shows_floor,
        )

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep; the head stays tilted down, and glances sideways for lost obstacles."""
        decision = self._decide(world)
        if self._seen is None:
            return decision
        movable = self._seen.result.movable if self._movable is None else self._movable
        pixel = None if self._best is None else self._best.pixel
        return replace(decision, image_target=ImageTarget(movable, pixel))

    def _decide(self, world: WorldModel) -> Decision:
        self._best = self._movable = None
        gaze = GazeCommand(0.0, math.radians(self._settings.tilt_deg))
        goal = self.goal
        colour, seen = world.estimate.colour, self._seen
        if goal is None or colour is None or colour.T_body_camera is None or seen is None:
            return Decision(WalkCommand(), gaze, "blocked")
        result = seen.result
        if abs(_tilt(result.current) - gaze.tilt_rad) > math.radians(10.0):
            return Decision(WalkCommand(), gaze, "survey")  # the head is not yet tilted down
        robot = world.pose2
        gait = self._robot.gait
        ahead = abs(_pan(result.current, robot)) < GLANCE_RAD
        if ahead:
            unseen_m = result.nearest_m + _ahead_m(result.current, robot)
            step_m = command.PRINTED_STEP_M if self._published else gait.cruise_mps * gait.step_s
            self._corners.update(result.corners_blocked, unseen_m, step_m)
        tracks = world.tracks
        movers = [o.gone_straight() for o in tracks if o.moving >= MOVING]
        if self._settings.guarded:
            expected = self._guard.expected(movers, world.stamp_s)
            expected += [o for o in tracks if DOUBTED <= o.moving < MOVING]
            pan_rad = self._glances.next(robot, expected, world.stamp_s, self._waits)
            gaze = GazeCommand(pan_rad, gaze.tilt_rad)
        movable = (
            result.movable
            if self._settings.prediction == "flow"
            else contact_detections.subtract_moving_obstacles(
                seen.contacts.ground, result.current, movers, result.horizon_s
            )
        )
        self._movable = movable
        objective = Objective.of(
            movable,
            colour.camera,
            colour.T_body_camera,
            robot,
            goal,
            self._settings.objective,
            self._corners.blocked,
            self._robot,
        )
        if ahead:
            self._best = search.find(objective, self._settings.search, self._rng)
            self._place = None if self._best is None else objective.place(self._best.pixel)
        place = self._place
        desired, target, why = self._wish(place, robot, goal)
        if not self._settings.guarded:
            return Decision(desired, gaze, why, plan=Plan(goal))
        desired = self._schedule.make_up(desired, goal, robot, world.stamp_s)
        walk = self._guarded(desired, target, goal if why == "walk" else target, world, movers)
        step_m = math.hypot(walk.forward_m, walk.lateral_m)
        self._waits = walk != desired and step_m < WAITS * gait.cruise_mps * gait.step_s
        plan = Plan(goal, steps=self._guard.ahead, risk=self._guard.risk)
        return Decision(walk, gaze, why if walk == desired else self._guard.word, plan=plan)

    def _wish(
        self, place: Float[np.ndarray, "2"] | None, robot: Pose2, goal: Float[np.ndarray, "2"]
    ) -> tuple[WalkCommand, Float[np.ndarray, "2"], str]:
        """The desired step, its target and why; `place` is the best pixel on the floor, if there is one."""
        gait = self._robot.gait
        if self._published:
            literal = self._settings.objective.literal
            if place is None:
                return command.turning(goal, robot, gait, literal), goal, "blocked"
            step = command.printed if literal else command.published
            return step(place, robot, gait), place, "walk"
        here = np.array([robot.x, robot.y])
        if abs(command.angle_to(goal, robot)) > self._settings.objective.window_rad(gait):
            return command.turning(goal, robot, gait), goal, "turn"
        if float(np.hypot(*(goal - here))) < NEAR_GOAL_M:
            return command.towards(goal, robot, gait), goal, "walk"
        if place is None:
            floor = self._seen is not None and bool(self._seen.result.ground.any())
            return command.turning(goal, robot, gait), goal if floor else here, "blocked"
        return command.towards(place, robot, gait), place, "walk"

    def _guarded(
        self,
        desired: WalkCommand,
        target: Float[np.ndarray, "2"],
        beyond: Float[np.ndarray, "2"],
        world: WorldModel,
        movers: Sequence[Obstacle],
    ) -> WalkCommand:
        """The step as the guard allows it, with contacts as static obstacles.

        The guard rates plans by the goal beyond the target, unless a static obstacle blocks the line of sight to it.
        """
        assert world.pose is not None
        here = world.pose.mean[:2]
        standing = self._standing.apart_from(
            np.array([o.position for o in movers]).reshape(-1, 2),
            np.array([o.radius_m + BESIDE_M for o in movers]),
        )
        unknown = self._standing.never_seen(world.stamp_s, here)
        target = farthest_visible(
            here, np.stack([target, beyond]), standing, self._guard.cell_distance_m
        )
        return self._guard.choose(
            desired,
            world.pose,
            movers,
            np.concatenate([standing, unknown]),
            target,
            world.stamp_s,
        )


def _pan(picture: Picture, robot: Pose2) -> float:
    axis = picture.T_world_camera.rotation[:2, 2]
    return wrap_angle(math.atan2(axis[1], axis[0]) - robot.yaw)


def _ahead_m(picture: Picture, robot: Pose2) -> float:
    """Distance of the camera ahead of the body, m."""
    return float(robot.inverse().apply(picture.T_world_camera.position[:2])[0])


def _tilt(picture: Picture) -> float:
    return math.asin(max(-1.0, min(1.0, -float(picture.T_world_camera.rotation[2, 2]))))
