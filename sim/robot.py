"""The simulated robot: a body in a world, a head, and sensors.

It delivers two frames per step: 0.2 s before the end of single support, and at its end, when the gait takes the next
command. Colour and stereo cameras take images at the end only, unless image pairs are enabled. A `Frame` holds sensor
readings only: `T_body_camera` comes from the encoders, odometry from the joints. The body is kinematic (exact
footsteps with drawn slip and sway) or dynamic (`sim.body.dynamic`: servos and soles in a physics engine). A robot that
is described by a URDF (`sim.robots`) has a kinematic body, or a dynamic one (`sim.body.humanoid`) where its description says
how it walks; its cameras see its own links.

Source: seed 000, section 2.1.1 (image times); seeds 003 and 004 (cameras).
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.frame import (
    ColourView,
    DepthView,
    FeetReading,
    Frame,
    RangeView,
    StepOdometry,
    StereoView,
)
from perception.primitives.own_body import OwnBody
from perception.primitives.pose import Pose3
from planning.commands import GazeCommand, WalkCommand

from .body.body import Advance, Body, true_frame
from .body.dynamic.walker import DynamicBody
from .body.head import Head
from .body.humanoid.joints import EngineJoints
from .body.humanoid.walker import HumanoidBody
from .body.inertial import InertialSensor
from .body.jointed import JointedHead, JointedLegs, solids_of
from .body.kinematic import KinematicBody
from .ground import Ground
from .rendering.motion import STATIONARY, Motion, motion_between
from .robot_config import RobotConfig, grown
from .robots.jointed import JointedRobot, jointed
from .sensors.cameras import colour_picture, stereo_pair
from .sensors.depth_camera import DepthCamera
from .sensors.tof_camera import TofCamera
from .world import World

BEFORE_END_S = 0.20  # seed 000, dT: first of the two images, before the end of single support


class SimulatedRobot:
    """A robot to drive: `read` a frame, `walk`, `look`."""

    def __init__(self, world: World, config: RobotConfig, seed: int = 0) -> None:
        self.world, self.config = world, grown(config)
        config = self.config
        streams = np.random.SeedSequence([seed, 30]).spawn(7)
        body, head, imu, tof, colour, stereo, depth = (np.random.default_rng(s) for s in streams)
        self.body: Body
        self._head: Head | JointedHead
        self._legs: JointedLegs | EngineJoints | None = None
        found = config.described
        pieces, foot = world.scene.ground, config.measures.foot_m
        self.ground = Ground(pieces, (foot[0], foot[1])) if pieces else None
        if found is not None:
            self._head = JointedHead(jointed(found), config.head, head)
        else:
            self._head = Head(config.head, head)
        if config.body == "dynamic" and isinstance(self._head, JointedHead):
            if self.ground is not None:
                raise ConfigError(
                    f"robot: the dynamic body of model={config.model!r} walks on one level only; set body='kinematic'"
                )
            self.body = HumanoidBody(
                world, config.gait, config.dynamic, config.imu, self._head, body
            )
        elif config.body == "dynamic":
            assert isinstance(self._head, Head)
            self.body = DynamicBody(
                world, config.gait, config.dynamic, config.imu, self._head, body, self.ground
            )
        else:
            inertial = InertialSensor(config.imu, imu)
            self.body = KinematicBody(
                world.scene.start, config.gait, config.slip, config.sway, inertial, self._head, body,
                self.ground,
            )  # fmt: skip
        if isinstance(self._head, JointedHead):
            self._legs = (
                EngineJoints(self.body)
                if isinstance(self.body, HumanoidBody)
                else JointedLegs(self._head, self.body)
            )
            own = self._own_body(self._head.robot)
            solids = solids_of(self._head.robot, own)
            self._shown = tuple(solids)
            world.carry(tuple(solids.values()))
            self.own_body: OwnBody | None = own
        else:
            self.own_body = None
        self._tof = TofCamera(config.tof_camera, tof) if config.tof else None
        self._depth = DepthCamera(config.depth_camera, depth) if config.depth else None
        self._colour_rng, self._stereo_rng = colour, stereo
        self._motions: dict[tuple[float, float, float], Motion] = {}  # of cameras with an exposure
        self._began_s = world.stamp_s

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen, by its own inertial sensor; it does not get up."""
        return self.body.fallen

    @property
    def up(self) -> tuple[float, float, float]:
        """Unit vector against gravity, world frame."""
        return self.body.up

    def close(self) -> None:
        """Close the physics engine, if there is one; a second call does nothing."""
        self.body.close()

    def __enter__(self) -> SimulatedRobot:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def read(self) -> Frame:
        """Advance the world to the next sensor time and return the frame."""
        self.body.start_due_step()
        advance = self._advance_to_frame(self._ticks_to_frame())
        imu = self.body.measure_imu()
        ends = self.body.ticks_left == 0
        looks = ends or self.config.image_pairs
        if self._legs is not None:
            poses = self._legs.true_links()
            self.world.pose_links([poses[link] for link in self._shown])
        return Frame(
            stamp_s=self.world.stamp_s,
            tof=self._range_view(),
            depth=self._depth_view(),
            stereo=self._stereo_view() if looks else None,
            colour=self._colour_view() if looks else None,
            odometry=StepOdometry(advance.motion, advance.steps, advance.rise_m),
            imu=imu,
            footstep_due=ends,
            joints=None if self._legs is None else self._legs.reading(),
            feet=self._feet(),
        )

    def walk(self, command: WalkCommand) -> None:
        """Set the command of the next step; without a new one the robot stands.

        Commands beyond the limits of `GaitConfig` are clipped, and the odometry reports the clipped step.
        """
        self.body.walk(command)

    def look(self, gaze: GazeCommand) -> None:
        """Set the gaze; the head moves there within its speed and range."""
        self._head.look(gaze)

    def cameras(self) -> dict[str, tuple[float, float, float]]:
        """Enabled cameras and their positions in the head."""
        config = self.config
        mounts = {
            "tof": (config.tof, config.tof_mount_m),
            "depth": (config.depth, config.tof_mount_m),
            "stereo": (config.stereo, config.stereo_camera.mount_m),
            "colour": (config.colour, config.colour_camera.mount_m),
        }
        return {name: mount for name, (on, mount) in mounts.items() if on}

    def camera_in_world(self, mount: tuple[float, float, float]) -> Pose3:
        """True pose of a camera, from which it is rendered; not for estimators."""
        trunk = true_frame(self.body) @ self.body.true_trunk()
        return trunk @ self._head.true_camera(mount)

    def measured_camera(self, mount: tuple[float, float, float]) -> Pose3:
        """Camera in the body frame as the encoders give it."""
        return self.body.trunk_from_encoders() @ self._head.camera_from_encoders(mount)

    def _ticks_to_frame(self) -> int:
        """To the next sensor time; a long shift of the weight out of standing has a frame of its own."""
        if isinstance(self.body, HumanoidBody) and self.body.shift_ticks_left > 0:
            return self.body.shift_ticks_left
        first = round(BEFORE_END_S / self.config.gait.tick_s)
        left = self.body.ticks_left
        return left - first if left > first else left

    def _own_body(self, robot: JointedRobot) -> OwnBody:
        """What its cameras may see of it, with the errors of joints and trunk."""
        head, sway = self.config.head, self.config.sway
        joint = math.hypot(head.offset_deg, head.encoder_deg / math.sqrt(12.0))
        trunk = math.hypot(sway.roll_deg, sway.pitch_deg, sway.yaw_deg)
        mounts = list(self.cameras().values())
        return robot.own_body(math.radians(joint), math.radians(trunk), mounts)

    def _advance_to_frame(self, ticks: int) -> Advance:
        """Advance body, head and world; with an exposure time the last tick on its own, to measure camera motion."""
        config = self.config
        exposing = [
            mount
            for mount, seconds in (
                (config.tof_mount_m, config.tof_camera.integration_s),
                (config.colour_camera.mount_m, config.colour_camera.exposure_s),
                (config.stereo_camera.mount_m, config.stereo_camera.exposure_s),
            )
            if seconds > 0.0
        ]
        if not exposing:
            return self._advance(ticks)
        rest = self._advance(ticks - 1) if ticks > 1 else None
        before = [self._steady_camera(mount) for mount in exposing]
        last = self._advance(1)
        self._motions = {
            mount: motion_between(pose, self._steady_camera(mount), last.seconds)
            for mount, pose in zip(exposing, before, strict=True)
        }
        if rest is None:
            return last
        motion, steps = rest.motion @ last.motion, rest.steps + last.steps
        return Advance(motion, steps, rest.seconds + last.seconds, rest.rise_m + last.rise_m)

    def _steady_camera(self, mount: tuple[float, float, float]) -> Pose3:
        """Camera without the kinematic body's sway, which is drawn anew in every frame."""
        trunk = true_frame(self.body) @ self.body.steady_trunk()
        return trunk @ self._head.true_camera(mount)

    def _advance(self, ticks: int) -> Advance:
        advance = self.body.advance(ticks)
        at, seconds = self.body.true_pose, round(self.body.ticks * self.config.gait.tick_s, 9)
        self.world.advance_to(self._began_s + seconds, (at.x, at.y))
        return advance

    def _feet(self) -> FeetReading:
        """The feet by the joint encoders."""
        (left, left_lifted), (right, right_lifted) = self.body.feet_from_encoders()
        return FeetReading(left, right, *self.body.foot_heights(), (left_lifted, right_lifted))

    def _range_view(self) -> RangeView | None:
        fails_s = self.config.tof_fails_at_s
        if self._tof is None or 0.0 < fails_s <= self.world.stamp_s - self._began_s:
            return None
        mount, source = self.config.tof_mount_m, self.config.tof_source
        true = self.camera_in_world(mount)
        if self._tof.config.integration_s > 0.0:
            motion = self._motions.get(mount, STATIONARY)
            range_m, amplitude = self._tof.measure_moving(
                (self.world.ranges(source, s), motion.pose_after(true, s))
                for s in self._tof.instants
            )
        else:
            range_m, amplitude = self._tof.measure(self.world.ranges(source), true)
        return RangeView(range_m, amplitude, self._tof.camera, self.measured_camera(mount))

    def _depth_view(self) -> DepthView | None:
        if self._depth is None:
            return None
        config = self.config
        true = self.camera_in_world(config.tof_mount_m)
        depth = self._depth.measure(self.world.ranges(config.tof_source), true)
        return DepthView(depth, self._depth.camera, self.measured_camera(config.tof_mount_m))

    def _colour_view(self) -> ColourView | None:
        if not self.config.colour:
            return None
        config = self.config.colour_camera
        true = self.camera_in_world(config.mount_m)
        motion = self._motions.get(config.mount_m, STATIONARY)
        rgb = colour_picture(self.world, config, true, self._colour_rng, motion)
        return ColourView(rgb, config.camera, self.measured_camera(config.mount_m))

    def _stereo_view(self) -> StereoView | None:
        if not self.config.stereo:
            return None
        config, baseline = self.config.stereo_camera, self.config.baseline_m
        true = self.camera_in_world(config.mount_m)
        motion = self._motions.get(config.mount_m, STATIONARY)
        left, right = stereo_pair(self.world, config, baseline, true, self._stereo_rng, motion)
        return StereoView(
            left, right, baseline, config.camera, self.measured_camera(config.mount_m)
        )
