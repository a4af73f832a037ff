"""A walk over ground of several levels, by depth images and joints alone: camera, regions, map, footholds, body.

The map is kept in the frame of the foot that stands, whose ground has height 0. Once a step, while both feet stand, the frame
moves on to the foot that has just landed, an image is fused, and the next footsteps are planned anew. The pose towards the
goal is that of the walk on flat ground: steps and gyro, corrected by scans of the steep surfaces in view; the height is that of the
joints. The maps move by steps and gyro alone, so that no correction makes them jump. What stands above the ground keeps the body
away.

The gaze goes to where the next feet will land. Where no step leads on, the robot stands and looks about, then gives up:
"unknown" is a reason to stop.

Source: ours.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from mapping.ground.ground_map import GroundMap
from mapping.ground.obstacles import ObstacleMap
from mapping.ground.surface import Surface
from perception.depth import points
from perception.depth.sources import DepthSources
from perception.localisation.filter import PoseFilter
from perception.localisation.legged_poses import LeggedLocaliser
from perception.localisation.plane_scan import plane_scan
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.own_body import OwnBody
from perception.primitives.pose import Pose2, Pose3
from perception.terrain import segmentation
from planning.commands import GazeCommand, WalkCommand
from planning.footholds import room
from planning.footholds.foothold import Foothold, FootNoise
from planning.footholds.search import NODES, FootstepPlan, PlanEnd, Stance, plan
from planning.planners.planner import Decision
from planning.search.path import Terrain

from ..config.schema import Config
from .bodies import Feet

START = (
    5 / 12
)  # ours: of the height of its camera; the robot is put on level ground, which it cannot see so near
NEAR_M = 0.10  # ours: of the goal; half of a long step
GROUND_M = 2.2  # ours: depth to which edges are believed; farther ones, seen often, are surer than they are right
RISE_SIGMA_M = 0.002  # ours: of a step, by the joints
# Ours: of the trunk, beside tilt and height of the prior.
SWAY_M, SWAY_RAD = 0.005, math.radians(0.5)
LOOKS = ((0.0, 0.0), (0.0, 0.25), (0.35, 0.1), (-0.35, 0.1), (0.0, -0.2), (0.0, 0.1))
"""Ours: gaze of a robot that stands and looks about, pan and tilt from its usual one, rad."""
PATIENCE = 2  # ours: steps more than a turn about takes that lead nowhere before it looks about, and again before it gives up
SOMEWHERE_M = 0.5  # ours: from where it was, of a step that leads somewhere
LINGERS, THOROUGH = (
    6,
    20 * NODES,
)  # ours: steps that lead nowhere, after which a search may take so many nodes
# Ours: of a longest step, for which a step to the border of what is known is worth it.
LEAST_GAIN = 0.5
AHEAD = 3  # ours: footsteps at which the gaze is directed


@dataclass(frozen=True)
class FeetReading:
    """What the joints tell of the feet: left and right, in the body frame, and their heights there, m."""

    feet: Feet
    heights_m: tuple[float, float]

    def sole(self, foot: int) -> Pose3:
        """A foot in the body frame."""
        pose, _ = self.feet[0 if foot > 0 else 1]
        height_m = self.heights_m[0 if foot > 0 else 1]
        flat = pose.lifted()
        return Pose3((pose.x, pose.y, height_m), flat.quat_xyzw)


@dataclass
class GroundWalker:
    """Decides on footsteps and gaze, frame by frame.

    Args:
        config: Sensors, prior, robot, footholds.
        own_body: What the cameras see of the robot; None for nothing.
        goal: (x, y) in the world, m.
        start: Pose of the body in the world (x, y, yaw), m and rad; by default the world is the body frame of the start.
        latest: The plan of the last step.
        space: The room of the body that it was made with, frame of the standing foot.
    """

    config: Config
    own_body: OwnBody | None
    goal: Float[np.ndarray, "2"]
    start: Gaussian = field(default_factory=lambda: Gaussian(np.zeros(3), 1e-8 * np.eye(3)))
    latest: FootstepPlan | None = None
    space: Terrain | None = None

    def __post_init__(self) -> None:
        config = self.config
        self.ground = GroundMap(
            replace(config.ground, start_m=START * config.robot_model.eye_m, forgets=False)
        )
        self.obstacles = ObstacleMap()
        self.localiser = LeggedLocaliser(
            PoseFilter(self.start, (), config.localiser), config.prior, config.registration
        )
        self._walked = Pose2()  # the body by steps and gyro alone, which no scan makes jump
        self._depths = DepthSources(
            config.tof, config.structured_light, config.stereo, ("tof", "depth"), self.own_body
        )
        self._foot = -1  # that stands; the gait begins with the left one
        self._stands: Pose2 | None = None  # the standing foot in the world
        self._stood: Pose2 | None = None  # and by steps and gyro alone
        self._steps = 0.0
        self._idle = self._surveyed = 0
        self._from, self._lingered = np.full(2, math.inf), 0  # a place, and steps near it
        self._height_m = self._height_m2 = 0.0  # of the ground of the standing foot; variance
        noise, prior = config.localiser, config.prior
        self.noise = FootNoise(
            math.hypot(noise.step_x_sigma_m, noise.slip_sigma_m),
            math.hypot(noise.step_y_sigma_m, noise.lateral_slip_sigma_m),
            math.hypot(noise.step_yaw_sigma_rad, noise.drift_sigma_rad),
        )
        tilt = math.radians(prior.joints_tilt_deg)
        sigma = [SWAY_M, SWAY_M, prior.joints_height_m, tilt, tilt, SWAY_RAD]
        self._camera_covariance = np.diag(np.square(sigma))
        model = config.robot_model
        steps = replace(model.steps, up_m=min(model.steps.up_m, model.steps.down_m))
        self._robot = replace(model, steps=steps)  # no step up that cannot be taken back
        self._patience = PATIENCE + math.ceil(math.pi / model.gait.max_turn_rad)
        self._step_covariance = np.diag([*self.noise.variances, RISE_SIGMA_M**2])

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """The map, frame of the standing foot."""
        return self.ground.surfaces

    @property
    def next_foothold(self) -> Foothold | None:
        """Where the next foot is to land by the latest plan, frame of the standing foot."""
        return (
            self.latest.footholds[0] if self.latest is not None and self.latest.footholds else None
        )

    @property
    def stance(self) -> int:
        """The standing foot, 1 left, -1 right."""
        return self._foot

    def cycle(self, frame: Frame, feet: FeetReading) -> Decision | None:
        """Take in a frame; the next footstep and gaze where one is due.

        Raises:
            InputError: The frame has no odometry.
        """
        if frame.odometry is None:
            raise InputError("ground walk: the frame has no odometry; expected that of the steps")
        before = self.localiser.pose2
        self.localiser.update(frame, ())
        self._walked = self._walked @ before.inverse() @ self.localiser.pose2
        self._steps += frame.odometry.steps
        if not frame.footstep_due:
            return None
        self._follow(feet)
        T_body_foot = feet.sole(self._foot)
        self._observe(frame, T_body_foot)
        self._stands = self.localiser.pose2 @ _flat(T_body_foot)
        surfaces, began_s = self.surfaces, time.thread_time()
        robot = self._robot
        middle = np.array([0.0, -self._foot * robot.stance_m / 2])
        ground = room.reachable(surfaces, robot.steps.down_m)
        self.space = room.terrain(ground, self.obstacles.voxels, robot, middle)
        roomed_s = time.thread_time()
        decision = self._decided(surfaces, middle)
        times = {"room": roomed_s - began_s, "plan": time.thread_time() - roomed_s}
        return replace(decision, timing_ms={name: 1e3 * s for name, s in times.items()})

    def _observe(self, frame: Frame, T_body_foot: Pose3) -> None:
        """Fuse the depth images of a frame into the maps and the pose."""
        T_foot_body = T_body_foot.inverse()
        for sensor, depth in self._depths.images(frame):
            assert depth.T_body_camera is not None
            reach = self.config.reach.of(sensor)
            near = replace(
                reach, farthest_m=min(reach.farthest_m, GROUND_M)
            )  # risers farther off would be walls
            regions = segmentation.find(depth, near, self.config.floor_of(True), sensor)
            pose = T_foot_body @ depth.T_body_camera
            level = self.ground.observe(regions, pose, self._camera_covariance, depth.camera)
            self.localiser.register_scan(
                plane_scan(regions, T_body_foot @ level), depth.T_body_camera
            )
            cloud = points.from_depth(depth, near.nearest_m, near.farthest_m, near.stride)
            self.obstacles.observe(cloud, depth, pose, self._camera_covariance)

    def height(self, feet: FeetReading) -> tuple[float, float]:
        """Height of the body frame above the ground of the start, and its standard deviation, m."""
        sole_m = float(feet.sole(self._foot).translation[2])
        return self._height_m - sole_m, math.sqrt(self._height_m2)

    @property
    def stands(self) -> tuple[Pose2, float]:
        """The standing foot in the world, and the height of its ground above that of the start, m."""
        return (self.localiser.pose2 if self._stands is None else self._stands), self._height_m

    def _follow(self, feet: FeetReading) -> None:
        """Move the frame of the maps to the foot that has landed."""
        now = -self._foot if self._steps > 0.5 else self._foot
        there = feet.sole(now)
        stands = self._walked @ _flat(there)
        if self._stood is None:
            self._stood = stands
        elif now != self._foot:
            motion = self._stood.inverse() @ stands
            rise_m = float(there.translation[2] - feet.sole(-now).translation[2])
            self.ground.move(motion, rise_m, self._step_covariance)
            self.obstacles.move(motion, rise_m, self._step_covariance)
            self._stood = stands
            self._height_m += rise_m
            self._height_m2 += RISE_SIGMA_M**2
            self._lingered += 1
        self._foot, self._steps = now, 0.0

    def _decided(self, surfaces: tuple[Surface, ...], middle: Float[np.ndarray, "2"]) -> Decision:
        """The decision from the surfaces, and the middle between the feet."""
        robot = self._robot
        goal = self.stands[0].inverse().apply(self.goal)
        least_m = LEAST_GAIN * robot.gait.max_speed_mps * robot.gait.step_s
        here = self.stands[0].apply(middle)
        if np.linalg.norm(here - self._from) > SOMEWHERE_M:
            self._from, self._lingered = here, 0
        lingers = self._idle > 0 or self._lingered > LINGERS
        found = plan(
            surfaces, Stance(self._foot, Pose2()), goal, NEAR_M, robot,
            self.noise, self.config.footholds, self.space, THOROUGH if lingers else NODES,
        )  # fmt: skip
        self.latest = found
        if np.linalg.norm(goal - middle) <= NEAR_M:
            here = self.localiser.pose2.inverse().apply(self.goal)
            joined = np.linalg.norm(here) <= NEAR_M
            return Decision(WalkCommand(), self._gaze(goal), "arrived" if joined else "walk")
        if self._surveyed < len(LOOKS):
            self._surveyed += 1
            return self._look(goal, self._surveyed - 1, "survey")
        onward = found.end is not PlanEnd.BORDER or found.gain_m > least_m
        if not onward or self._lingered > self._patience:
            self._idle += 1
            tries = self._idle - len(LOOKS)
            if tries > self._patience or (tries > len(LOOKS) and not found.footholds):
                return Decision(WalkCommand(stay=True), self._gaze(goal), "unknown")
            if tries <= 0 or not found.footholds:
                return self._look(goal, self._idle % len(LOOKS), "look")
        else:
            self._idle = 0
        command = found.commands[0]
        walk = WalkCommand(
            command.forward_m - self.config.localiser.slip_m,
            command.lateral_m,
            command.turn_rad,
            command.single_support_s,
            command.double_support_s,
            command.rise_m,
        )
        why = "walk" if abs(walk.rise_m) < 0.01 else ("up" if walk.rise_m > 0.0 else "down")
        target = found.footholds[min(AHEAD, len(found.footholds)) - 1].pose.vector[:2]
        return Decision(walk, self._gaze(target), why)

    def _look(self, goal: Float[np.ndarray, "2"], number: int, why: str) -> Decision:
        """Stand and look about: towards the goal, and beside and above that."""
        pan, tilt = LOOKS[number]
        away = goal / max(float(np.linalg.norm(goal)), 1e-9)
        usual = self._gaze(0.6 * self._robot.hip_m * away)
        gaze = GazeCommand(usual.pan_rad + pan, usual.tilt_rad + tilt)
        return Decision(WalkCommand(stay=True), gaze, why)

    def _gaze(self, target: Float[np.ndarray, "2"]) -> GazeCommand:
        """The gaze at a place on the ground."""
        robot = self.config.robot_model
        x, y = (float(v) for v in target)
        high, low = (math.radians(v) for v in robot.head.tilt_deg)
        tilt = math.atan2(robot.eye_m, max(math.hypot(x, y), 1e-3))
        return GazeCommand(math.atan2(y, max(x, 0.1)), min(max(tilt, high), low))


def _flat(pose: Pose3) -> Pose2:
    """A level pose without its height."""
    r = pose.rotation
    return Pose2(pose.translation[0], pose.translation[1], math.atan2(r[1, 0], r[0, 0]))
