"""Planner of seed 004: walk to the goal, stop before an obstacle, scan a panorama, choose a motion, walk it.

The robot walks straight to the goal until an obstacle blocks the path at about 1 m. Then it stands, turns its head
through the views of a panorama, chooses side, motion and pivot, and walks the legs of that motion. Where a passage is
blocked, it goes back and scans again.

Source: seed 004; the goal, and the retreat from a blocked passage, are ours.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from mapping.grid.egocentric_grid import EgocentricGrid
from mapping.grid.evidence import OCCUPIED
from mapping.panorama.obstacles import Surroundings
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, stitch
from mapping.panorama.views import View, view_of_depth
from perception.floor import classify
from perception.primitives.frame import Depth
from perception.primitives.obstacle import MOVING
from perception.primitives.pose import Pose2, Pose3, wrap_angle
from perception.primitives.robot_model import HeadLimits

from .. import footsteps
from ..avoidance import primitives
from ..avoidance.choice import Choice, choose
from ..avoidance.gap_centre import GapCentre
from ..avoidance.primitives import Leg
from ..commands import GazeCommand, WalkCommand
from ..footsteps import limited_step
from ..gaze.attention import GazeContext
from ..gaze.policy import GazeControl
from ..safety.guard import Guard
from ..world_model import WorldModel
from .goals import Goals, GoalSeeker
from .panorama_obstacles import REACH_M, STOP_M, obstacle_table
from .planner import Decision, Plan
from .settings import PlanningConfig

LOG = logging.getLogger(__name__)

FACING_RAD = math.radians(5.0)  # ours: heading error at which the scan begins
AIMED_RAD = math.radians(1.5)  # ours: error at which the head has reached its direction
LEANS_RAD = math.radians(10.0)  # ours: largest error of a resting head on a tilted trunk
RESTS_RAD = math.radians(0.5)  # ours: largest motion per frame of a resting head
BEYOND_M = 0.60  # ours: depth of a carton plus clearance of the body
FARTHEST_M = 5.0  # seed 004: range that is white in the range pictures
PATIENCE_S = 8.0  # ours: time between a stop and the next scan
SETTLE_STEPS = 8  # ours: steps before the next scan after a panorama without obstacles
LOOKS = 12  # ours: scans kept for the report
SAME_M = 0.4  # ours: depth of a carton plus error of a track
WAIT_STEPS = 8  # ours: steps to wait in a passage for a moving obstacle
SURELY = 0.7  # ours: occupancy at which a cell blocks a passage
RETREAT_M = 0.45
"""Ours: longest retreat from a blocked passage, enough to see the obstacle; a shorter leg is gone back to its beginning."""
DOWN_RAD = math.radians(17.0)  # seed 004: key pitch
INTO_RAD = math.radians(30.0)  # ours: tilt that shows the sides of a gap from 1 m on
LEVEL_DEG = (-60.0, -30.0, 0.0, 30.0, 60.0)  # seed 004: key yaws
DOWN_DEG = (-45.0, -15.0, 15.0, 45.0)  # ours: nine views; the head cannot look up


@dataclass(frozen=True, eq=False)
class Look:
    """One panoramic scan and its result, for the report.

    Args:
        stamp_s: When it ended.
        picture: Last colour picture while walking; None without a colour camera.
        views: Views of the panorama.
        panorama: Stitched from these views.
        around: Obstacles and gaps in it.
        choice: The chosen motion; None if the path is free.
    """

    stamp_s: float
    picture: UInt8[np.ndarray, "h w 3"] | None
    views: tuple[View, ...]
    panorama: Panorama
    around: Surroundings
    choice: Choice | None


class AvoidancePlanner(GoalSeeker):
    """Walks to goals in order by the motions of seed 004."""

    def __init__(self, config: PlanningConfig, goals: Sequence[tuple[float, float]]) -> None:
        """Begin with the first goal.

        Args:
            config: Settings of planning.
            goals: In order, map frame, m.
        """
        super().__init__(Goals(goals, config.mission))
        self._config, self._robot = config, config.robot
        self._gaze = GazeControl(config.gaze, self._robot)
        self._guard = Guard(config.guard, self._robot, config.cell_m)
        self._rng = np.random.default_rng([config.seed, 41])
        self._phase = "walk"
        self._urged = False
        self._directions = directions(self._robot.head)
        self._views: list[View] = []
        self._off_rad = math.inf
        self._stand = Pose2()  # frame of the views: where the scan began, x to the goal
        self._legs: list[Leg] = []
        self._begun = Pose2()  # of the present leg
        self._middle: GapCentre | None = None  # of the gap on the present leg
        self._trim = primitives.Trim()
        self._last, self._last_s = WalkCommand(), -math.inf
        self._wait_s = 0.0
        self._settle = 0
        self._faces = np.zeros((0, 2, 2))
        self._waited = 0
        self._closers: list[np.ndarray] = []
        self._retreats = False
        self._picture: np.ndarray | None = None
        self.looks: list[Look] = []
        self.choices: list[Choice] = []

    @property
    def looking(self) -> bool:
        """Whether the robot stands to turn to the goal or to scan."""
        return self._urged or self._phase == "scan"

    @property
    def active(self) -> bool:
        """Whether a scan or a motion is under way; otherwise the robot walks to the goal or waits."""
        return self.looking or self._phase == "pass"

    def look_about(self) -> None:
        """Turn to the goal and scan, whether or not an obstacle is near."""
        self._urged = True

    def observe(self, world: WorldModel) -> None:
        """During a scan: keep the view once the head has reached its direction."""
        colour = world.estimate.colour
        if colour is not None and self._phase == "walk":
            self._picture = colour.rgb
        if self._phase != "scan" or len(self._views) >= len(self._directions):
            return
        depth = next((view.depth for view in world.estimate.views), None)
        if depth is None or depth.T_body_camera is None:
            return
        if self._aimed(_off_aim(depth, self._directions[len(self._views)])):
            T_stand_camera = self._as_stood(world.pose2, depth.T_body_camera)
            view = view_of_depth(depth, FARTHEST_M, prior=T_stand_camera, stamp_s=world.stamp_s)
            self._views.append(view)

    def _aimed(self, off_rad: float) -> bool:
        """Whether the head has reached its direction, or rests as near to it as a tilted trunk allows."""
        moved, self._off_rad = abs(off_rad - self._off_rad), off_rad
        aimed = off_rad <= AIMED_RAD or (off_rad <= LEANS_RAD and moved <= RESTS_RAD)
        if aimed:
            self._off_rad = math.inf  # the next direction is another
        return aimed

    def decide(self, world: WorldModel) -> Decision:
        """The next footstep of the present phase."""
        if world.stamp_s - self._last_s > 1.5 * self._robot.gait.step_s:
            self._last = WalkCommand()  # another planner has decided since
        decision = self._decide(world)
        self._last, self._last_s = decision.walk, world.stamp_s
        return decision

    def _decide(self, world: WorldModel) -> Decision:
        goal = self.goal
        if world.pose is None or world.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot = world.pose2
        if self._phase == "scan" and len(self._views) == len(self._directions):
            self._conclude(goal, world.stamp_s)
        if self._phase == "scan":
            return Decision(WalkCommand(), GazeCommand(*self._directions[len(self._views)]), "scan")
        if self._phase == "stop":
            if world.stamp_s >= self._wait_s:
                self._scan(robot, math.atan2(goal[1] - robot.y, goal[0] - robot.x))
            return Decision(WalkCommand(), GazeCommand(), "ST")
        if self._phase == "pass":
            step = self._pass(world, world.grid, goal)
            if step is not None:
                return step
        return self._walk(world, goal)

    def _walk(self, world: WorldModel, goal: Float[np.ndarray, "2"]) -> Decision:
        """Straight to the goal, or stop and scan."""
        assert world.pose is not None
        assert world.grid is not None
        robot, gait = world.pose2, self._robot.gait
        heading = math.atan2(goal[1] - robot.y, goal[0] - robot.x)
        if self._urged:
            return self._face(robot, heading, GazeCommand(0.0, DOWN_RAD))
        movers = [o.gone_straight() for o in world.tracks if o.moving >= MOVING]
        gaze = self._gaze.next(world.stamp_s, robot, goal, movers, GazeContext.of(world))
        if self._gaze.surveying:
            return Decision(WalkCommand(), gaze, "survey")
        cells = _cells(world.grid)
        self._settle = max(self._settle - 1, 0)
        if self._settle == 0 and self._blocked(robot, heading, cells, goal):
            return self._face(robot, heading, gaze)
        away_m = math.hypot(goal[0] - robot.x, goal[1] - robot.y)
        desired = footsteps.footstep(heading, gait.cruise_mps, robot, gait, away_m)
        unseen = world.grid.centres()[~world.grid.known]
        walk = self._guard.choose(desired, world.pose, movers, cells, goal, world.stamp_s, unseen)
        plan = Plan(
            goal,
            steps=self._guard.ahead,
            risk=self._guard.risk,
            gaze_map=self._gaze.valued,
        )
        return Decision(walk, gaze, "walk" if walk == desired else self._guard.word, plan=plan)

    def _face(self, robot: Pose2, heading: float, gaze: GazeCommand) -> Decision:
        """Turn towards the blocked path; once there, begin to scan."""
        turn = wrap_angle(heading - robot.yaw)
        if abs(turn) <= FACING_RAD:
            self._scan(robot, heading)
            self._urged = False
        walk = limited_step(self._robot.gait, 0.0, 0.0, turn)
        return Decision(walk, gaze, "blocked")

    def _scan(self, robot: Pose2, heading: float) -> None:
        """Begin a scan from here, about that heading."""
        self._phase, self._views, self._off_rad = "scan", [], math.inf
        self._stand = Pose2(robot.x, robot.y, heading)

    def _as_stood(self, robot: Pose2, T_body_camera: Pose3) -> Pose3:
        """The camera of the robot's present pose in the frame of the views.

        Turning the head turns the standing robot too, by some degrees in nine views.
        """
        return (self._stand.inverse() @ robot).lifted() @ T_body_camera

    def _blocked(
        self,
        robot: Pose2,
        heading: float,
        cells: Float[np.ndarray, "n 2"],
        goal: Float[np.ndarray, "2"],
    ) -> bool:
        """Whether an obstacle in the corridor to the goal is nearer than the stopping distance."""
        there = Pose2(robot.x, robot.y, heading).inverse().apply(cells)
        reach = min(STOP_M, float(np.hypot(goal[0] - robot.x, goal[1] - robot.y)))
        half = self._robot.passage_width_m / 2 + self._config.avoidance.pivot.clearance_m / 2
        ahead = (there[:, 0] > 0.1) & (there[:, 0] < reach) & (np.abs(there[:, 1]) < half)
        return bool(np.count_nonzero(ahead) >= 2)

    def _conclude(self, goal: Float[np.ndarray, "2"], stamp_s: float) -> None:
        """Choose the motion from the views."""
        robot = self._stand
        panorama = stitch(self._views, self._rng)
        around = surroundings(panorama, self._views)
        reach = min(REACH_M, float(np.hypot(goal[0] - robot.x, goal[1] - robot.y)))
        closers = [robot.inverse().apply(points) for points in self._closers]
        things = obstacle_table(panorama, around, reach, closers)
        ahead = np.repeat(things.distance_m[:, None], 2, axis=1)
        faces = np.stack([ahead, things.edges_m], axis=-1)
        self._faces = robot.apply(faces.reshape(-1, 2)).reshape(-1, 2, 2)
        self._waited = 0
        choice = choose(things, self._config.avoidance, self._robot)
        views = tuple(self._views)
        look = Look(stamp_s, self._picture, views, panorama, around, choice)
        self.looks = [*self.looks, look][-LOOKS:]
        if choice is None:
            LOG.info("%.1f s: the panorama shows a free path", stamp_s)
            self._phase, self._settle = "walk", SETTLE_STEPS
            return
        LOG.info("%.1f s: %s", stamp_s, choice.why)
        self.choices.append(choice)
        if choice.motion == "ST":
            self._phase, self._wait_s = "stop", stamp_s + PATIENCE_S
            return
        self._phase = "pass"
        beyond = choice.distance_m + BEYOND_M
        centred = choice.gap_m / 2 <= self._config.avoidance.pivot.half_m(
            self._robot.passage_width_m
        )
        gap = choice.gap_m if centred else 0.0
        self._legs = primitives.passage(choice.motion, choice.pivot, robot, beyond, gap)
        self._begun = robot

    def _pass(
        self, world: WorldModel, grid: EgocentricGrid, goal: Float[np.ndarray, "2"]
    ) -> Decision | None:
        """The next footstep of the legs; None when they are done."""
        assert world.pose is not None
        robot, gait = world.pose2, self._robot.gait
        while self._legs and primitives.reached(self._legs[0], robot):
            self._legs.pop(0)
            self._middle, self._begun = None, robot
        if not self._legs:
            self._phase = "walk"
            self._urged, self._retreats = self._retreats, False  # what blocked it is known now
            return None
        leg = self._in_the_middle(self._legs[0], world)
        desired = primitives.step(leg, robot, gait, self._trim, self._last)
        if self._closed(leg, robot, grid, world.stamp_s):
            return Decision(WalkCommand(), GazeCommand(0.0, DOWN_RAD), "blocked passage")
        others = [o for o in world.tracks if not self._was_scanned(o.position)]
        movers = [o.gone_straight() for o in others if o.moving >= MOVING]
        target = np.array([leg.target.x, leg.target.y])
        walk = self._guard.choose(
            desired, world.pose, movers, np.zeros((0, 2)), target, world.stamp_s
        )
        if walk != desired:  # a passage leaves no room to evade: wait, but not forever
            self._waited += 1
            late = self._waited > WAIT_STEPS
            walk = desired if late else limited_step(gait, 0.0, 0.0, 0.0)
        else:
            self._waited = 0
        turned, tilt = (math.pi / 2, INTO_RAD) if leg.gap_m else (math.pi / 4, DOWN_RAD)
        pan = math.copysign(turned, desired.lateral_m) if leg.primitive == "S" else 0.0
        legs = [[robot.x, robot.y], *([one.target.x, one.target.y] for one in self._legs)]
        plan = Plan(goal, np.array(legs), risk=self._guard.risk)
        return Decision(walk, GazeCommand(pan, tilt), self.choices[-1].motion, plan=plan)

    def _in_the_middle(self, leg: Leg, world: WorldModel) -> Leg:
        """A leg through a gap, shifted to the middle of the gap as seen now."""
        if not leg.gap_m:
            return leg
        robot = world.pose2
        self._middle = self._middle or GapCentre(leg.gap_m)
        for view in world.estimate.views:
            points = view.upright[view.classes == classify.OBSTACLE, :2]
            self._middle.look(primitives.on_line(leg, robot, points))
        return primitives.beside(leg, robot, self._middle.offset_m)

    def _was_scanned(self, place: Float[np.ndarray, "2"]) -> bool:
        """Whether a track is one of the static obstacles of the scan.

        The centre of a static obstacle seems to move while it leaves the field of view.
        """
        begin, end = self._faces[:, 0], self._faces[:, 1]
        along = end - begin
        length = np.maximum((along**2).sum(axis=1), 1e-9)
        share = np.clip(((place - begin) * along).sum(axis=1) / length, 0.0, 1.0)
        gaps = np.linalg.norm(begin + share[:, None] * along - place, axis=1)
        return bool(np.any(gaps < SAME_M))

    def _closed(self, leg: Leg, robot: Pose2, grid: EgocentricGrid, stamp_s: float) -> bool:
        """Whether an obstacle blocks the passage; then the legs lead back, and the obstacle is remembered."""
        cells = _cells(grid, SURELY)
        hit = primitives.in_the_way(leg, robot, cells, grid.config.cell_m, self._robot)
        if not hit.any():
            return False
        LOG.info("%.1f s: the passage is blocked", stamp_s)
        self._closers.append(cells[hit])
        gone_m = math.hypot(robot.x - self._begun.x, robot.y - self._begun.y)
        self._legs = primitives.retreat(leg, robot, min(RETREAT_M, gone_m))
        self._begun, self._retreats = robot, True
        return True


def directions(head: HeadLimits) -> list[tuple[float, float]]:
    """Pan and tilt of the nine views, rad, fewer where the limits of the head make some the same.

    From 0.6 m on they overlap on the ground ahead.
    """
    highest, lowest = (math.radians(tilt) for tilt in head.tilt_deg)
    wanted = [(pan, 0.0) for pan in LEVEL_DEG] + [(pan, DOWN_RAD) for pan in DOWN_DEG]
    return list(
        dict.fromkeys(
            (
                math.radians(min(max(pan, -head.pan_deg), head.pan_deg)),
                min(max(tilt, highest), lowest),
            )
            for pan, tilt in wanted
        )
    )


def _off_aim(depth: Depth, aim: tuple[float, float]) -> float:
    """Angle between the camera axis and its commanded direction, rad."""
    assert depth.T_body_camera is not None
    axis = depth.T_body_camera.rotation[:, 2]
    pan, tilt = math.atan2(axis[1], axis[0]), -math.asin(min(max(float(axis[2]), -1.0), 1.0))
    return math.hypot(wrap_angle(pan - aim[0]), tilt - aim[1])


def _cells(grid: EgocentricGrid, least: float = OCCUPIED) -> Float[np.ndarray, "n 2"]:
    """Centres of cells with at least that occupancy, world frame, m."""
    return np.asarray(grid.centres()[grid.known & (grid.probability >= least)])
