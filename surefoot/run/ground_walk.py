"""A walk over ground of several levels, by depth images and joints alone: camera, regions, map, footholds, body.

The map is kept in the frame of the foot that stands, whose ground has height 0. Once a step, while both feet stand, the frame
moves on to the foot that has just landed, an image is fused, and the next footsteps are planned anew. The pose towards the
goal is that of the steps, with their mean slip.

The gaze goes to where the next feet will land. Where no step leads on, the robot stands and looks about, then gives up:
"unknown" is a reason to stop.

Source: ours.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from mapping.ground.ground_map import GroundMap
from mapping.ground.surface import Surface
from perception.depth.sources import DepthSources
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame
from perception.primitives.own_body import OwnBody
from perception.primitives.pose import Pose2, Pose3
from perception.terrain import segmentation
from planning.commands import GazeCommand, WalkCommand
from planning.footholds.foothold import Foothold, FootNoise
from planning.footholds.search import FootstepPlan, PlanEnd, Stance, plan
from planning.planners.planner import Decision

from ..config.schema import Config
from .bodies import Feet

START_M = 0.5  # ours: the robot is put on level ground, which it cannot see for its own legs
NEAR_M = 0.25  # ours: of the goal
RISE_SIGMA_M = 0.002  # ours: of a step, by the joints
SWAY_M, SWAY_RAD = (
    0.005,
    math.radians(0.5),
)  # ours: of the trunk, beside tilt and height of the prior
LOOKS = ((0.0, 0.0), (0.0, 0.25), (0.35, 0.1), (-0.35, 0.1), (0.0, -0.2), (0.0, 0.1))
"""Ours: gaze of a robot that stands and looks about, pan and tilt from its usual one, rad."""
TURNS = 3  # ours: times that it looks about before it gives up
LEAST_GAIN = (
    0.5  # ours: of a longest step, for which a step to the border of what is known is worth it
)
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
        goal: (x, y) in the body frame of the start, m.
    """

    config: Config
    own_body: OwnBody | None
    goal: Float[np.ndarray, "2"]
    latest: FootstepPlan | None = None

    def __post_init__(self) -> None:
        config = self.config
        self.ground = GroundMap(replace(config.ground, start_m=START_M))
        self._depths = DepthSources(
            config.tof, config.structured_light, config.stereo, ("tof", "depth"), self.own_body
        )
        self._foot = -1  # that stands; the gait begins with the left one
        self._stands: Pose2 | None = None  # of the standing foot in the body frame before
        self._motion, self._steps = Pose2(), 0.0
        self._idle = 0
        noise, prior = config.localiser, config.prior
        self.noise = FootNoise(
            math.hypot(noise.step_x_sigma_m, noise.slip_sigma_m),
            math.hypot(noise.step_y_sigma_m, noise.lateral_slip_sigma_m),
            math.hypot(noise.step_yaw_sigma_rad, noise.drift_sigma_rad),
        )
        tilt = math.radians(prior.joints_tilt_deg)
        sigma = [SWAY_M, SWAY_M, prior.joints_height_m, tilt, tilt, SWAY_RAD]
        self._camera_covariance = np.diag(np.square(sigma))
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
        self._motion = self._motion @ frame.odometry.motion
        self._steps += frame.odometry.steps
        if not frame.footstep_due:
            return None
        self._follow(feet)
        T_foot_body = feet.sole(self._foot).inverse()
        for sensor, depth in self._depths.images(frame):
            assert depth.T_body_camera is not None
            regions = segmentation.find(
                depth, self.config.reach.of(sensor), self.config.floor_of(True), sensor
            )
            pose = T_foot_body @ depth.T_body_camera
            self.ground.observe(regions, pose, self._camera_covariance, depth.camera)
        surfaces, began_s = self.surfaces, time.thread_time()
        decision = self._decided(surfaces)
        return replace(decision, timing_ms={"plan": 1e3 * (time.thread_time() - began_s)})

    def _follow(self, feet: FeetReading) -> None:
        """Move the frame of the map and the goal to the foot that has landed."""
        now = -self._foot if self._steps > 0.5 else self._foot
        there = feet.sole(now)
        if self._stands is None:
            self._stands = _flat(there)
            self.goal = self._stands.inverse().apply(self.goal)
        elif now != self._foot:
            slip = Pose2(self.config.localiser.slip_m * self._steps, 0.0, 0.0)
            motion = self._stands.inverse() @ self._motion @ slip @ _flat(there)
            rise_m = there.translation[2] - feet.sole(-now).translation[2]
            self.ground.move(motion, rise_m, self._step_covariance)
            self.goal = motion.inverse().apply(self.goal)
            self._stands = _flat(there)
        self._foot, self._motion, self._steps = now, Pose2(), 0.0

    def _decided(self, surfaces: tuple[Surface, ...]) -> Decision:
        robot = self.config.robot_model
        found = plan(
            surfaces, Stance(self._foot, Pose2()), self.goal, NEAR_M, robot,
            self.noise, self.config.footholds,
        )  # fmt: skip
        self.latest = found
        middle = np.array([0.0, -self._foot * robot.stance_m / 2])
        if np.linalg.norm(self.goal - middle) <= NEAR_M:
            return Decision(WalkCommand(), self._gaze(self.goal), "arrived")
        least_m = LEAST_GAIN * robot.gait.max_speed_mps * robot.gait.step_s
        onward = found.end is not PlanEnd.BORDER or found.gain_m > least_m
        if not onward:
            self._idle += 1
            if self._idle > TURNS * len(LOOKS):
                return Decision(WalkCommand(stay=True), self._gaze(self.goal), "unknown")
            pan, tilt = LOOKS[self._idle % len(LOOKS)]
            away = self.goal / max(float(np.linalg.norm(self.goal)), 1e-9)
            usual = self._gaze(0.6 * robot.hip_m * away)
            return Decision(
                WalkCommand(stay=True),
                GazeCommand(usual.pan_rad + pan, usual.tilt_rad + tilt),
                "look",
            )
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
