"""The simulated robot: a body that walks in a world, a head that looks, and sensors that say what they see.

Frames come twice a step, 0.2 s before the end of single support and at its end, when the gait asks for
its next command; the cameras that take pictures look at its end only, unless pairs are wanted. Everything
in a `Frame` is what sensors give: `T_body_camera` is what the encoders say, the odometry what the joints
say. The body is kinematic (footsteps exact, slip and sway drawn) or dynamic (`sim.body.dynamic`: servos and
soles in a physical world); nothing that is driven by frames can tell which.

Source: seed 000, section 2.1.1 (instants of the images); seeds 003, 004 (cameras).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import TracebackType

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.frame import ColourView, Frame, RangeView, StepOdometry, StereoView
from perception.primitives.pose import Pose3
from planning.commands import GazeCommand, WalkCommand

from .body.body import Advance, Body
from .body.dynamic.anatomy import DARWIN, gait_for, head_for
from .body.dynamic.walker import DynamicBody, DynamicConfig
from .body.gait import GaitConfig
from .body.head import Head, HeadConfig
from .body.inertial import ImuConfig, InertialSensor
from .body.kinematic import KinematicBody, SlipConfig, SwayConfig
from .ranges import check_ranges
from .rendering.motion import STATIONARY, Motion, motion_between
from .sensors.cameras import ImageConfig, colour_picture, stereo_pair
from .sensors.tof_camera import TofCamera, TofConfig
from .world import World

BODIES = ("kinematic", "dynamic")

BEFORE_END_S = 0.20  # dT of seed 000: the first of the two images, before the end of single support


@dataclass(frozen=True)
class RobotConfig:
    """Which sensors the robot has, and how good they and the body are.

    A camera that is switched off is not rendered; its part of the frame is None.

    Args:
        body: "kinematic" or "dynamic"; slip and sway are the first one's, dynamic the second's, of which
            anatomy and scale hold for both. Mounts, baseline, gait and head are those of a DARwIn-OP, and
            grow with the body.
    """

    body: str = "kinematic"
    tof: bool = True
    tof_fails_at_s: float = 0.0  # ours, a fault to try: from then on it is silent; 0: never
    stereo: bool = True
    colour: bool = True
    image_pairs: bool = (
        False  # seed 000 looks twice a step; else colour and stereo look once, at its end
    )
    tof_mount_m: tuple[float, float, float] = (0.035, 0.0, 0.035)  # DARwIn-OP's camera
    baseline_m: float = 0.04  # seed 003
    gait: GaitConfig = field(default_factory=GaitConfig)
    slip: SlipConfig = field(default_factory=SlipConfig)
    sway: SwayConfig = field(default_factory=SwayConfig)
    dynamic: DynamicConfig = field(default_factory=DynamicConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    imu: ImuConfig = field(default_factory=ImuConfig)
    tof_camera: TofConfig = field(default_factory=TofConfig)
    colour_camera: ImageConfig = field(
        default_factory=lambda: ImageConfig(720, 720, 90.0, (0.035, 0.0, 0.035))
    )  # seed 000: f = 360 px
    stereo_camera: ImageConfig = field(
        default_factory=lambda: ImageConfig(640, 480, 60.0, (0.035, 0.02, 0.035))
    )  # left one; ours: f = 554 px

    def __post_init__(self) -> None:
        if self.body not in BODIES:
            raise ConfigError(f"robot: body={self.body!r} is unknown; choose {', '.join(BODIES)}")
        if not self.tof_fails_at_s >= 0.0:
            raise ConfigError(
                f"robot: tof_fails_at_s={self.tof_fails_at_s} must not be negative; 0 is never"
            )
        if not self.baseline_m > 0.0:
            raise ConfigError(f"robot: baseline_m={self.baseline_m} must be positive")
        check_ranges("robot", self, tof_mount_m=(-2.0, 2.0), baseline_m=(0.0, 1.0))


def grown(config: RobotConfig) -> RobotConfig:
    """The same with gait, head and cameras where this body has them."""
    body = config.dynamic.body
    factor = body.hip_m / DARWIN.hip_m
    if factor == 1.0:
        return config

    def times(mount_m: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = mount_m
        return factor * x, factor * y, factor * z

    colour, stereo = config.colour_camera, config.stereo_camera
    return replace(
        config,
        gait=gait_for(body, config.gait),
        head=head_for(body, config.head),
        tof_mount_m=times(config.tof_mount_m),
        colour_camera=replace(colour, mount_m=times(colour.mount_m)),
        stereo_camera=replace(stereo, mount_m=times(stereo.mount_m)),
        baseline_m=factor * config.baseline_m,
    )


class SimulatedRobot:
    """Drives like a real one: read, walk, look."""

    def __init__(self, world: World, config: RobotConfig, seed: int = 0) -> None:
        self.world, self.config = world, grown(config)
        config = self.config
        streams = np.random.SeedSequence([seed, 30]).spawn(6)
        body, head, imu, tof, colour, stereo = (np.random.default_rng(s) for s in streams)
        self.body: Body
        self._head = Head(config.head, head)
        if config.body == "dynamic":
            self.body = DynamicBody(
                world, config.gait, config.dynamic, config.imu, self._head, body
            )
        else:
            self.body = KinematicBody(
                world.scene.start,
                config.gait,
                config.slip,
                config.sway,
                InertialSensor(config.imu, imu),
                self._head,
                body,
            )
        self._tof = TofCamera(config.tof_camera, tof) if config.tof else None
        self._colour_rng, self._stereo_rng = colour, stereo
        self._motions: dict[tuple[float, float, float], Motion] = {}  # of cameras that take time
        self._began_s = world.stamp_s

    @property
    def fallen(self) -> bool:
        """Whether the robot lies on the floor, by its own inertial sensor: nothing goes on from there."""
        return self.body.fallen

    @property
    def up(self) -> tuple[float, float, float]:
        """Against gravity, unit vector in the world."""
        return self.body.up

    def close(self) -> None:
        """Give the physics back, where there is one; a second time does nothing."""
        self.body.close()

    def __enter__(self) -> SimulatedRobot:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def read(self) -> Frame:
        """Let the world go on to the next instant of the sensors, and look."""
        self.body.start_due_step()
        first = round(BEFORE_END_S / self.config.gait.tick_s)
        left = self.body.ticks_left
        advance = self._pass(left - first if left > first else left)
        imu = self.body.measure_imu()
        ends = self.body.ticks_left == 0
        looks = ends or self.config.image_pairs
        return Frame(
            stamp_s=self.world.stamp_s,
            tof=self._range_view(),
            stereo=self._stereo_view() if looks else None,
            colour=self._colour_view() if looks else None,
            odometry=StepOdometry(advance.motion, advance.steps),
            imu=imu,
            footstep_due=ends,
        )

    def walk(self, command: WalkCommand) -> None:
        """Taken up at the start of the coming double support; without a new one the robot stands.

        What lies beyond the limits of `GaitConfig` is clipped, and the odometry says so.
        """
        self.body.walk(command)

    def look(self, gaze: GazeCommand) -> None:
        """Turn the head there, as fast as it can; clipped to its reach."""
        self._head.look(gaze)

    def cameras(self) -> dict[str, tuple[float, float, float]]:
        """The cameras that are on, and their places in the head."""
        config = self.config
        mounts = {
            "tof": (config.tof, config.tof_mount_m),
            "stereo": (config.stereo, config.stereo_camera.mount_m),
            "colour": (config.colour, config.colour_camera.mount_m),
        }
        return {name: mount for name, (on, mount) in mounts.items() if on}

    def camera_in_world(self, mount: tuple[float, float, float]) -> Pose3:
        """Where a camera really is: through it the world is rendered. No estimate may ask."""
        trunk = self.body.true_pose.lifted() @ self.body.true_trunk()
        return trunk @ self._head.true_camera(mount)

    def _measured_camera(self, mount: tuple[float, float, float]) -> Pose3:
        return self.body.trunk_from_encoders() @ self._head.camera_from_encoders(mount)

    def _pass(self, ticks: int) -> Advance:
        """Body, head and world go on together; for cameras that take time the last tick on its own."""
        config = self.config
        taking = [
            mount
            for mount, seconds in (
                (config.tof_mount_m, config.tof_camera.integration_s),
                (config.colour_camera.mount_m, config.colour_camera.exposure_s),
                (config.stereo_camera.mount_m, config.stereo_camera.exposure_s),
            )
            if seconds > 0.0
        ]
        if not taking:
            return self._go_on(ticks)
        rest = self._go_on(ticks - 1) if ticks > 1 else None
        before = [self._steady_camera(mount) for mount in taking]
        last = self._go_on(1)
        self._motions = {
            mount: motion_between(pose, self._steady_camera(mount), last.seconds)
            for mount, pose in zip(taking, before, strict=True)
        }
        if rest is None:
            return last
        motion, steps = rest.motion @ last.motion, rest.steps + last.steps
        return Advance(motion, steps, rest.seconds + last.seconds)

    def _steady_camera(self, mount: tuple[float, float, float]) -> Pose3:
        """Where a camera is without the kinematic body's sway, which is drawn anew at every look."""
        trunk = self.body.true_pose.lifted() @ self.body.steady_trunk()
        return trunk @ self._head.true_camera(mount)

    def _go_on(self, ticks: int) -> Advance:
        advance = self.body.advance(ticks)
        self.world.advance_to(self._began_s + round(self.body.ticks * self.config.gait.tick_s, 9))
        return advance

    def _range_view(self) -> RangeView | None:
        fails_s = self.config.tof_fails_at_s
        if self._tof is None or 0.0 < fails_s <= self.world.stamp_s - self._began_s:
            return None
        mount = self.config.tof_mount_m
        true = self.camera_in_world(mount)
        if self._tof.config.integration_s > 0.0:
            motion = self._motions.get(mount, STATIONARY)
            range_m, amplitude = self._tof.measure_moving(
                (self.world.rays_after(s), motion.pose_after(true, s)) for s in self._tof.instants
            )
        else:
            range_m, amplitude = self._tof.measure(self.world.rays, true)
        return RangeView(range_m, amplitude, self._tof.camera, self._measured_camera(mount))

    def _colour_view(self) -> ColourView | None:
        if not self.config.colour:
            return None
        config = self.config.colour_camera
        true = self.camera_in_world(config.mount_m)
        motion = self._motions.get(config.mount_m, STATIONARY)
        rgb = colour_picture(self.world, config, true, self._colour_rng, motion)
        return ColourView(rgb, config.camera, self._measured_camera(config.mount_m))

    def _stereo_view(self) -> StereoView | None:
        if not self.config.stereo:
            return None
        config, baseline = self.config.stereo_camera, self.config.baseline_m
        true = self.camera_in_world(config.mount_m)
        motion = self._motions.get(config.mount_m, STATIONARY)
        left, right = stereo_pair(self.world, config, baseline, true, self._stereo_rng, motion)
        return StereoView(
            left, right, baseline, config.camera, self._measured_camera(config.mount_m)
        )
