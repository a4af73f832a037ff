"""Stop, look about, choose a motion, walk it: the way of seed 004, with a goal to walk to in between.

Straight to the goal until something blocks the way at about a metre; then the robot stands, turns its head
through the views of a panorama, decides side, motion and pivot, and walks the motion's legs.

Source: seed 004; the goal and what is done when a passage proves closed are ours.
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
from perception.estimate import Estimate
from perception.floor import classify
from perception.primitives.frame import Depth, Frame
from perception.primitives.obstacle import MOVING
from perception.primitives.pose import Pose2, Pose3, wrap_angle
from planning import footsteps
from planning.avoidance import primitives
from planning.avoidance.choice import Choice, choose
from planning.avoidance.gap_centre import GapCentre
from planning.avoidance.primitives import Leg
from planning.commands import GazeCommand, WalkCommand
from planning.footsteps import limited_step
from planning.gaze.attention import GazeContext
from planning.gaze.policy import GazePolicy
from planning.safety.guard import Guard

from .avoidance_things import REACH_M, STOP_M, things_of
from .config.schema import Config
from .goals import Goals, GoalSeeker
from .planners import Decision
from .run.pipeline import Pipeline

LOG = logging.getLogger(__name__)

FACING_RAD = math.radians(5.0)  # ours: so nearly towards the goal it begins to look
AIMED_RAD = math.radians(1.5)  # ours: head where it was told to look
LEANS_RAD = math.radians(10.0)  # ours: so far off at most a head may rest, on a trunk that leans
RESTS_RAD = math.radians(0.5)  # ours: a head that has moved less since the last frame rests
BEYOND_M = 0.60  # ours: a carton's depth, and the body clear of it
FARTHEST_M = 5.0  # range that is white in the pictures
PATIENCE_S = 8.0  # ours: after a stop, how long to wait before it looks again
SETTLE_STEPS = 8  # ours: walk on so long before looking again after the panorama showed a free way
LOOKS = 12  # ours: so many are kept for people; where nothing opens it looks about again and again
SAME_M = 0.4  # ours: a carton's depth and a track's error
WAIT_STEPS = 8  # ours: so many steps it waits in a passage for what may move
SURELY = 0.7  # ours: a cell seen once, long ago and at a grazing angle, closes no passage
RETREAT_M = 0.45  # ours: so far back out of a closed passage, to see what closed it
DOWN_RAD = math.radians(17.0)  # seed 004: key pitch
# ours: shows the sides of a gap from 1 m before it until it is entered
INTO_RAD = math.radians(30.0)
LEVEL_DEG = (-60.0, -30.0, 0.0, 30.0, 60.0)  # seed 004: key yaws
DOWN_DEG = (
    -45.0,
    -15.0,
    15.0,
    45.0,
)  # ours: nine views; this head cannot look up, so four look down


@dataclass(frozen=True, eq=False)
class Look:
    """One look about and what came of it, for people.

    Args:
        stamp_s: When it ended.
        picture: Last of the colour camera while looking ahead; None if there was none.
        views: What the panorama is made of.
        panorama: Of these views.
        around: What it lists.
        choice: What was decided; None if the way is free.
    """

    stamp_s: float
    picture: UInt8[np.ndarray, "h w 3"] | None
    views: tuple[View, ...]
    panorama: Panorama
    around: Surroundings
    choice: Choice | None


class AvoidancePlanner(GoalSeeker):
    """Walks to one goal after the other by seed 004's motions."""

    def __init__(self, config: Config, goals: Sequence[tuple[float, float]]) -> None:
        """Set out.

        Args:
            config: Of everything.
            goals: Where to walk, one after the other, map frame, m.
        """
        super().__init__(Goals(goals, config.mission))
        self._config, self._robot = config, config.robot_model
        self._gaze = GazePolicy(config.gaze, self._robot)
        self._guard = Guard(config.guard, self._robot)
        self._rng = np.random.default_rng([config.seed, 41])
        self._phase = "walk"
        self._urged = False
        self._views: list[View] = []
        self._off_rad = math.inf
        self._stand = Pose2()  # where it looks about from, heading to the goal: frame of the views
        self._legs: list[Leg] = []
        self._middle: GapCentre | None = None  # of the gap that the leg leads through
        self._trim = primitives.Trim()
        self._last, self._last_s = WalkCommand(), -math.inf
        self._wait_s = 0.0
        self._settle = 0
        self._faces = np.zeros((0, 2, 2))
        self._waited = 0
        self._closers: list[np.ndarray] = []
        self._picture: np.ndarray | None = None
        self.looks: list[Look] = []
        self.choices: list[Choice] = []

    @property
    def looking(self) -> bool:
        """Whether it stands, to turn to the goal or to look about."""
        return self._urged or self._phase == "scan"

    @property
    def at_it(self) -> bool:
        """Whether it looks about or passes something; else it walks to the goal, or waits that a way opens."""
        return self.looking or self._phase == "pass"

    def look_about(self) -> None:
        """Turn to the goal and look about there, whatever stands how near."""
        self._urged = True

    def notice(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> None:
        """While looking about: keep the view if the head is where it was told to look."""
        if frame.colour is not None and self._phase == "walk":
            self._picture = frame.colour.rgb
        if self._phase != "scan" or len(self._views) >= len(DIRECTIONS):
            return
        depth = next((view.depth for view in estimate.views), None)
        if depth is None or depth.T_body_camera is None:
            return
        if self._aimed(_off_aim(depth, DIRECTIONS[len(self._views)])):
            T_stand_camera = self._as_stood(estimate.pose2, depth.T_body_camera)
            view = view_of_depth(depth, FARTHEST_M, None, T_stand_camera, frame.stamp_s)
            self._views.append(view)

    def _aimed(self, off_rad: float) -> bool:
        """Whether the head is where it was told to look, or rests as near as a leaning trunk lets it."""
        moved, self._off_rad = abs(off_rad - self._off_rad), off_rad
        aimed = off_rad <= AIMED_RAD or (off_rad <= LEANS_RAD and moved <= RESTS_RAD)
        if aimed:
            self._off_rad = math.inf  # the next direction is another
        return aimed

    def decide(self, frame: Frame, estimate: Estimate, pipeline: Pipeline) -> Decision:
        """The next footstep of what is being done."""
        if estimate.stamp_s - self._last_s > 1.5 * self._robot.gait.step_s:
            self._last = WalkCommand()  # others have decided since
        decision = self._decide(estimate, pipeline)
        self._last, self._last_s = decision.walk, estimate.stamp_s
        return decision

    def _decide(self, estimate: Estimate, pipeline: Pipeline) -> Decision:
        goal = self._goals.present
        if estimate.pose is None or pipeline.grid is None or goal is None:
            return Decision(WalkCommand(), GazeCommand(), "blocked")
        robot = estimate.pose2
        if self._phase == "scan" and len(self._views) == len(DIRECTIONS):
            self._conclude(goal, estimate.stamp_s)
        if self._phase == "scan":
            return Decision(WalkCommand(), GazeCommand(*DIRECTIONS[len(self._views)]), "scan")
        if self._phase == "stop":
            if estimate.stamp_s >= self._wait_s:
                self._scan(robot, math.atan2(goal[1] - robot.y, goal[0] - robot.x))
            return Decision(WalkCommand(), GazeCommand(), "ST")
        if self._phase == "pass":
            step = self._pass(estimate, pipeline.grid, goal)
            if step is not None:
                return step
        return self._walk(estimate, pipeline, goal)

    def _walk(
        self, estimate: Estimate, pipeline: Pipeline, goal: Float[np.ndarray, "2"]
    ) -> Decision:
        """Straight to the goal, or stop and look."""
        assert estimate.pose is not None
        assert pipeline.grid is not None
        robot, gait = estimate.pose2, self._robot.gait
        heading = math.atan2(goal[1] - robot.y, goal[0] - robot.x)
        if self._urged:
            return self._face(robot, heading, GazeCommand(0.0, DOWN_RAD))
        known = GazeContext(
            estimate.pose,
            pipeline.grid,
            pipeline.confidence,
            pipeline.landmarks,
            estimate.sightings,
        )
        movers = [o.gone_straight() for o in estimate.obstacles if o.moving >= MOVING]
        gaze = self._gaze.next(estimate.stamp_s, robot, goal, movers, known)
        if self._gaze.surveying:
            return Decision(WalkCommand(), gaze, "survey")
        cells = _cells(pipeline.grid)
        self._settle = max(self._settle - 1, 0)
        if self._settle == 0 and self._blocked(robot, heading, cells, goal):
            return self._face(robot, heading, gaze)
        desired = footsteps.footstep(heading, gait.cruise_mps, robot, gait)
        walk = self._guard.choose(desired, estimate.pose, movers, cells, goal, estimate.stamp_s)
        return Decision(walk, gaze, "walk" if walk == desired else "guard")

    def _face(self, robot: Pose2, heading: float, gaze: GazeCommand) -> Decision:
        """Turn to where the way is blocked; once it does, begin to look about."""
        turn = wrap_angle(heading - robot.yaw)
        if abs(turn) <= FACING_RAD:
            self._scan(robot, heading)
            self._urged = False
        walk = limited_step(self._robot.gait, 0.0, 0.0, turn)
        return Decision(walk, gaze, "blocked")

    def _scan(self, robot: Pose2, heading: float) -> None:
        """Begin to look about from here, towards that heading."""
        self._phase, self._views, self._off_rad = "scan", [], math.inf
        self._stand = Pose2(robot.x, robot.y, heading)

    def _as_stood(self, robot: Pose2, T_body_camera: Pose3) -> Pose3:
        """A camera of the robot of now in the frame of the views.

        Who stands and turns its head is turned by it, by some degrees in nine views.
        """
        return (self._stand.inverse() @ robot).lifted() @ T_body_camera

    def _blocked(
        self,
        robot: Pose2,
        heading: float,
        cells: Float[np.ndarray, "n 2"],
        goal: Float[np.ndarray, "2"],
    ) -> bool:
        """Whether something stands in the corridor to the goal, nearer than the stopping distance."""
        there = Pose2(robot.x, robot.y, heading).inverse().apply(cells)
        reach = min(STOP_M, float(np.hypot(goal[0] - robot.x, goal[1] - robot.y)))
        half = self._robot.passage_width_m / 2 + self._config.avoidance.pivot.clearance_m / 2
        ahead = (there[:, 0] > 0.1) & (there[:, 0] < reach) & (np.abs(there[:, 1]) < half)
        return bool(np.count_nonzero(ahead) >= 2)

    def _conclude(self, goal: Float[np.ndarray, "2"], stamp_s: float) -> None:
        """From the views to what is done next."""
        robot = self._stand
        panorama = stitch(self._views, self._rng)
        around = surroundings(panorama, self._views)
        reach = min(REACH_M, float(np.hypot(goal[0] - robot.x, goal[1] - robot.y)))
        closers = [robot.inverse().apply(points) for points in self._closers]
        things = things_of(panorama, around, reach, closers)
        ahead = np.repeat(things.distance_m[:, None], 2, axis=1)
        faces = np.stack([ahead, things.edges_m], axis=-1)
        self._faces = robot.apply(faces.reshape(-1, 2)).reshape(-1, 2, 2)
        self._waited = 0
        choice = choose(things, self._config.avoidance, self._robot)
        views = tuple(self._views)
        look = Look(stamp_s, self._picture, views, panorama, around, choice)
        self.looks = [*self.looks, look][-LOOKS:]
        if choice is None:
            LOG.info("%.1f s: the panorama shows a free way", stamp_s)
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

    def _pass(
        self, estimate: Estimate, grid: EgocentricGrid, goal: Float[np.ndarray, "2"]
    ) -> Decision | None:
        """The next footstep of the legs; None when they are done or prove closed."""
        assert estimate.pose is not None
        robot, gait = estimate.pose2, self._robot.gait
        while self._legs and primitives.reached(self._legs[0], robot):
            self._legs.pop(0)
            self._middle = None
        if not self._legs:
            self._phase = "walk"
            return None
        leg = self._in_the_middle(self._legs[0], estimate)
        desired = primitives.step(leg, robot, gait, self._trim, self._last)
        if self._closed(leg, robot, grid, estimate.stamp_s):
            return Decision(WalkCommand(), GazeCommand(0.0, DOWN_RAD), "closed")
        others = [o for o in estimate.obstacles if not self._stood_there(o.position)]
        movers = [o.gone_straight() for o in others if o.moving >= MOVING]
        target = np.array([leg.target.x, leg.target.y])
        walk = self._guard.choose(
            desired, estimate.pose, movers, np.zeros((0, 2)), target, estimate.stamp_s
        )
        if walk != desired:  # a passage has no room for another way: wait, but not for ever
            self._waited += 1
            late = self._waited > WAIT_STEPS
            walk = desired if late else limited_step(gait, 0.0, 0.0, 0.0)
        else:
            self._waited = 0
        turned, tilt = (math.pi / 2, INTO_RAD) if leg.gap_m else (math.pi / 4, DOWN_RAD)
        pan = math.copysign(turned, desired.lateral_m) if leg.primitive == "S" else 0.0
        return Decision(walk, GazeCommand(pan, tilt), self.choices[-1].motion)

    def _in_the_middle(self, leg: Leg, estimate: Estimate) -> Leg:
        """A leg through a gap, on the line through where its middle is seen."""
        if not leg.gap_m:
            return leg
        robot = estimate.pose2
        self._middle = self._middle or GapCentre(leg.gap_m)
        for view in estimate.views:
            points = view.upright[view.classes == classify.OBSTACLE, :2]
            self._middle.look(primitives.on_line(leg, robot, points))
        return primitives.beside(leg, robot, self._middle.offset_m)

    def _stood_there(self, place: Float[np.ndarray, "2"]) -> bool:
        """Whether a track is one of the things that stood there while the robot looked about.

        Of a thing that leaves the view bit by bit the middle of what is seen moves; it is no mover for that.
        """
        begin, end = self._faces[:, 0], self._faces[:, 1]
        along = end - begin
        length = np.maximum((along**2).sum(axis=1), 1e-9)
        share = np.clip(((place - begin) * along).sum(axis=1) / length, 0.0, 1.0)
        gaps = np.linalg.norm(begin + share[:, None] * along - place, axis=1)
        return bool(np.any(gaps < SAME_M))

    def _closed(self, leg: Leg, robot: Pose2, grid: EgocentricGrid, stamp_s: float) -> bool:
        """Whether something stands in the passage; then the legs lead back out, and what it was is kept."""
        cells = _cells(grid, SURELY)
        hit = primitives.in_the_way(leg, robot, cells, grid.config.cell_m, self._robot)
        if not hit.any():
            return False
        LOG.info("%.1f s: the passage is closed", stamp_s)
        self._closers.append(cells[hit])
        self._legs = primitives.retreat(leg, robot, RETREAT_M)
        return True


DIRECTIONS = [(math.radians(pan), 0.0) for pan in LEVEL_DEG]
DIRECTIONS += [(math.radians(pan), DOWN_RAD) for pan in DOWN_DEG]
"""The nine views, with no stripe of the ground ahead between them unseen from 0.6 m on."""


def _off_aim(depth: Depth, aim: tuple[float, float]) -> float:
    """Angle between where the camera looks and where it was told to, rad."""
    assert depth.T_body_camera is not None
    axis = depth.T_body_camera.rotation[:, 2]
    pan, tilt = math.atan2(axis[1], axis[0]), -math.asin(min(max(float(axis[2]), -1.0), 1.0))
    return math.hypot(wrap_angle(pan - aim[0]), tilt - aim[1])


def _cells(grid: EgocentricGrid, least: float = OCCUPIED) -> Float[np.ndarray, "n 2"]:
    """Middles of cells at least so probably occupied, world frame, m."""
    return np.asarray(grid.centres()[grid.known & (grid.probability >= least)])
