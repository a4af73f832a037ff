"""The map-free walker of seed 000: from the colour picture and the pose alone to the next footstep.

Each picture tells where floor is and where things touch it. What the tracks say will be taken by the end of
the next step is cut out of the floor, the best pixel of what is left is searched, and the footstep goes
there. The seed stops here; its robot, as slow as those it meets, is run into from the side. So the step
passes the guard, which knows the tracks and the places where things were seen to touch the floor.

Source: seed 000, sections 2 to 5; tracks and guard are ours.
"""

from __future__ import annotations

import bisect
import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from perception.estimate import Estimate
from perception.monocular.cycle import Monocular
from perception.monocular.result import MonocularResult, Picture
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame
from perception.primitives.obstacle import MOVING, Obstacle
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import GaitLimits
from planning.commands import GazeCommand, WalkCommand
from planning.footsteps import limited_step
from planning.safety.guard import Guard
from planning.safety.line_of_sight import farthest_visible
from planning.swarm import command, search
from planning.swarm.corners import Corners
from planning.swarm.glances import Glances
from planning.swarm.ground_memory import GroundMemory
from planning.swarm.objective import Objective

from . import monocular_tracks
from .config.schema import Config
from .goals import Goals, GoalSeeker
from .planners import Decision
from .run.pipeline import Pipeline

LOG = logging.getLogger(__name__)

DOUBTED = 0.05  # ours: from here on the eyes look for it: who has just turned seems to stand
BESIDE_M = 0.05  # ours: a contact this near to a mover's disc is the mover's own
GLANCE_RAD = math.radians(10.0)  # ours: the head this far aside, the picture is one of a glance
FOLLOWING_COST = 0.04  # ours: three times that, it goes along with who crosses its way
GLANCE_EVERY = (
    2  # steps: one camera that looks ahead as well notices a turn beside it so much later
)
WAITS = 0.6  # ours: share of the cruising step below which who gives way waits
STRAIGHT = 0.9  # ours: share of the cruising step from which a step goes about straight ahead
AROUND_M = 0.10 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Ours: floor must show this far round a track's place before the track counts as not there."""
MADE_UP_S = 5.0  # ours: what giving way has cost is made up in about this long
NEAR_GOAL_M = (
    0.25  # ours: a goal this near lies before the picture's lowest rows, or the feet there do
)


class SwarmPlanner(GoalSeeker):
    """Walks to one goal after the other, or to the one that holds at the time."""

    def __init__(self, config: Config, goals: Sequence[tuple[float, float]]) -> None:
        """Set out.

        Args:
            config: Of everything.
            goals: Where to walk, map frame, m.
        """
        by_clock = bool(config.swarm.goal_times_s)
        super().__init__(MovingGoals(goals, config) if by_clock else Goals(goals, config.mission))
        self._config, self._settings = config, config.swarm.as_walked
        self._robot = config.robot_model
        self._monocular = Monocular(config.monocular)
        self._corners = Corners(self._settings.objective.literal)
        react_s = config.guard.react_s + GLANCE_EVERY * self._robot.gait.step_s
        self._guard = Guard(
            replace(config.guard, react_s=react_s, following_cost=FOLLOWING_COST), self._robot
        )
        self._standing = GroundMemory()
        self._rng = np.random.default_rng([config.seed, 40])
        self.result: MonocularResult | None = None
        """Of the last picture."""
        self.sight: monocular_tracks.Sight | None = None
        """What was made of it."""
        self._previous: Picture | None = None
        self._best: search.Best | None = None  # the pixel chosen in this picture, turned upright
        self._movable: np.ndarray | None = None  # what was searched for it
        self._schedule = Schedule(self._robot.gait)
        self._glances = Glances(self._robot, self._settings.glances)
        self._place: Float[np.ndarray, "2"] | None = None  # of that pixel
        self._waits = False  # whether the guard let it hardly move

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """See where floor and obstacles are, tell the tracker, remember contacts."""
        colour = frame.colour
        if colour is None or colour.T_body_camera is None or estimate.pose is None:
            return
        robot = estimate.pose2
        try:
            placed = robot.lifted() @ colour.T_body_camera
            picture = Picture(colour.rgb, colour.camera, placed, frame.stamp_s)
        except InputError as error:
            LOG.warning("%.1f s: picture not used: %s", frame.stamp_s, error)
            self.result = None  # what was seen before is no ground to walk on
            return
        paired = self._settings.prediction == "flow" and self._previous is not None
        self.result = self._monocular.cycle(self._previous if paired else None, picture)
        self._previous = picture
        self.sight = seen = monocular_tracks.sight(self.result)
        found = monocular_tracks.detections(seen, robot, self._settings.detect_to_m)
        here = np.array([robot.x, robot.y])

        def in_view(places: Float[np.ndarray, "n 2"]) -> np.ndarray:
            near = np.hypot(*(places - here).T) < self._settings.detect_to_m
            bare = seen.shows_floor(places)
            for offset in AROUND_M:  # partly out of the picture it is not missed
                bare &= seen.shows_floor(places + offset)
            return np.asarray(bare & near)

        pipeline.tracker.update(frame.stamp_s, found, estimate.pose, in_view)
        self._standing.update(
            frame.stamp_s,
            here,
            np.concatenate([np.empty((0, 2)), *seen.contacts]),
            seen.shows_floor,
        )

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The next footstep; the head stays bowed, and looks aside for who is lost there."""
        decision = self._decide(frame, estimate, pipeline)
        return decision if self.result is None else replace(decision, drawn=self._drawn)

    def _drawn(self) -> UInt8[np.ndarray, "h w 3"]:
        """The stages of the last cycle, with what may be walked on as it was searched, and the pixel found."""
        assert self.result is not None
        from .report.plots.monocular import stages  # only who draws needs it

        result = (
            self.result if self._movable is None else replace(self.result, movable=self._movable)
        )
        return stages(result, chosen_px=None if self._best is None else self._best.pixel)

    def _decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        self._best = self._movable = None
        gaze = GazeCommand(0.0, math.radians(self._settings.tilt_deg))
        goal = self._goals.present
        colour, result = frame.colour, self.result
        if goal is None or colour is None or colour.T_body_camera is None:
            return Decision(WalkCommand(), gaze, "blocked")
        if result is None or self.sight is None:
            return Decision(WalkCommand(), gaze, "blocked")
        if abs(_tilt(result.current) - gaze.tilt_rad) > math.radians(10.0):
            return Decision(WalkCommand(), gaze, "survey")  # the head is not yet bowed
        robot = estimate.pose2
        gait = self._robot.gait
        ahead = abs(_pan(result.current, robot)) < GLANCE_RAD
        if ahead:
            unseen_m = result.nearest_m + _ahead_m(result.current, robot)
            self._corners.update(result.corners_blocked, unseen_m, gait.cruise_mps * gait.step_s)
        tracks = pipeline.tracker.obstacles
        movers = [o.gone_straight() for o in tracks if o.moving >= MOVING]
        if self._settings.guarded:
            expected = self._guard.expected(movers, frame.stamp_s)
            expected += [o for o in tracks if DOUBTED <= o.moving < MOVING]
            pan_rad = self._glances.next(robot, expected, frame.stamp_s, self._waits)
            gaze = GazeCommand(pan_rad, gaze.tilt_rad)
        movable = (
            result.movable
            if self._settings.prediction == "flow"
            else monocular_tracks.without_movers(
                self.sight.ground, result.current, movers, result.horizon_s
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
        if self._settings.guarded:
            desired = self._schedule.make_up(desired, goal, robot, frame.stamp_s)
        if not self._settings.guarded:
            return Decision(desired, gaze, why)
        walk = self._guarded(desired, target, goal if why == "walk" else target, estimate, movers)
        step_m = math.hypot(walk.forward_m, walk.lateral_m)
        self._waits = walk != desired and step_m < WAITS * gait.cruise_mps * gait.step_s
        return Decision(walk, gaze, why if walk == desired else "guard")

    def _wish(
        self, place: Float[np.ndarray, "2"] | None, robot: Pose2, goal: Float[np.ndarray, "2"]
    ) -> tuple[WalkCommand, Float[np.ndarray, "2"], str]:
        """The step that is wanted, where to, and why; place is that of the best pixel, if there is one."""
        gait = self._robot.gait
        if self._settings.objective.literal:
            if place is None:
                return command.turning(goal, robot, gait, literal=True), goal, "blocked"
            return command.printed(place, robot, gait), place, "walk"
        here = np.array([robot.x, robot.y])
        if abs(command.angle_to(goal, robot)) > self._settings.objective.window_rad(gait):
            return command.turning(goal, robot, gait), goal, "turn"
        if float(np.hypot(*(goal - here))) < NEAR_GOAL_M:
            return command.towards(goal, robot, gait), goal, "walk"
        if place is None:
            seen = self.result is not None and bool(self.result.ground.any())
            return command.turning(goal, robot, gait), goal if seen else here, "blocked"
        return command.towards(place, robot, gait), place, "walk"

    def _guarded(
        self,
        desired: WalkCommand,
        target: Float[np.ndarray, "2"],
        beyond: Float[np.ndarray, "2"],
        estimate: Estimate,
        movers: Sequence[Obstacle],
    ) -> WalkCommand:
        """The step that the guard lets pass; what stands it knows by the places of contact.

        Plans are judged by the goal beyond the target, unless something that stands bars the straight way there.
        """
        assert estimate.pose is not None
        here = estimate.pose.mean[:2]
        standing = self._standing.apart_from(
            np.array([o.position for o in movers]).reshape(-1, 2),
            np.array([o.radius_m + BESIDE_M for o in movers]),
        )
        unknown = self._standing.never_seen(estimate.stamp_s, here)
        target = farthest_visible(
            here, np.stack([target, beyond]), standing, self._guard.cell_distance_m
        )
        return self._guard.choose(
            desired,
            estimate.pose,
            movers,
            np.concatenate([standing, unknown]),
            target,
            estimate.stamp_s,
        )


class Schedule:
    """When the walker should be how near to its goal, cruising straight there; what it is behind it makes up.

    Giving way costs time, and a goal that holds by the clock does not wait. The mean speed of approach never
    gets above cruising.
    """

    def __init__(self, gait: GaitLimits) -> None:
        self._gait = gait
        self._goal: np.ndarray | None = None
        self._from_m, self._since_s = 0.0, 0.0

    def make_up(
        self, desired: WalkCommand, goal: Float[np.ndarray, "2"], robot: Pose2, stamp_s: float
    ) -> WalkCommand:
        """The desired step, longer if it goes about straight ahead and the walker is behind its schedule.

        Args:
            desired: At cruising speed.
            goal: That holds now, world frame, m; a new one begins a new schedule.
            robot: Where it stands.
            stamp_s: Now.
        """
        gait = self._gait
        away = float(np.hypot(*(goal - np.array([robot.x, robot.y]))))
        if self._goal is None or not np.array_equal(goal, self._goal):
            self._goal, self._from_m, self._since_s = goal.copy(), away, stamp_s
        behind = away - (self._from_m - gait.cruise_mps * (stamp_s - self._since_s))
        cruise = gait.cruise_mps * gait.step_s
        if behind <= cruise or desired.forward_m < STRAIGHT * cruise or away < NEAR_GOAL_M:
            return desired
        faster = min(
            gait.max_speed_mps / gait.cruise_mps, 1.0 + behind / MADE_UP_S / gait.cruise_mps
        )
        return limited_step(gait, faster * desired.forward_m / gait.step_s, 0.0, desired.turn_rad)


class MovingGoals:
    """One goal at a time, each from a stamp on, reached or not; only the last one ends the mission.

    Source: seed 000, section 6.5.1.
    """

    def __init__(self, goals: Sequence[tuple[float, float]], config: Config) -> None:
        """Set out.

        Args:
            goals: One for each of `config.swarm.goal_times_s`; more of them never hold.
            config: Times, tolerance, time limit.
        """
        self._times = config.swarm.goal_times_s[: len(goals)]
        self._goals = [np.array(goal) for goal in goals[: len(self._times)]]
        self._mission = config.mission
        self._reached: set[int] = set()
        self._index = 0

    @property
    def reached(self) -> int:
        """Goals reached while they held."""
        return len(self._reached)

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The goal that holds, map frame, m."""
        return self._goals[self._index] if self._goals else None

    def distance(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m."""
        if self.present is None or estimate.pose is None:
            return 0.0
        return float(np.linalg.norm(self.present - estimate.pose.mean[:2]))

    def finished(self, estimate: Estimate) -> bool:
        """Note what is reached, move on by the clock; whether the last goal is reached or the time is up."""
        self._index = max(0, bisect.bisect_right(self._times, estimate.stamp_s) - 1)
        if estimate.pose is not None and self.distance(estimate) <= self._mission.tolerance_m:
            self._reached.add(self._index)
        done = len(self._goals) - 1 in self._reached
        return done or not self._goals or estimate.stamp_s >= self._mission.time_limit_s


def _pan(picture: Picture, robot: Pose2) -> float:
    axis = picture.T_world_camera.rotation[:2, 2]
    return wrap_angle(math.atan2(axis[1], axis[0]) - robot.yaw)


def _ahead_m(picture: Picture, robot: Pose2) -> float:
    """How far the camera stands ahead of the body."""
    return float(robot.inverse().apply(picture.T_world_camera.position[:2])[0])


def _tilt(picture: Picture) -> float:
    return math.asin(max(-1.0, min(1.0, -float(picture.T_world_camera.rotation[2, 2]))))
