"""The dynamic body: it follows the same gait as the kinematic one, with servos in a physics engine.

Every tick the planned trajectories become joint angles, the balance control corrects them, and the servos, with
backlash and joint offsets, drive the simulated links. Odometry comes from the encoders; the truth from the engine.

Source: seed 000, section 2.1 (command); seed 001, section V-A (period 5 ms); gains: walking trials.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, Pose3, times
from planning.commands import WalkCommand

from ...ground import Ground
from ...scene import Scene
from ...shapes import Box, Shape
from ...world import World
from ..gait import Gait, GaitConfig
from ..head import Head
from ..inertial import ImuConfig
from ._legs_kernels import apply_backlash
from .anatomy import DARWIN
from .balance import AnkleFeedback, LandingControl
from .capture import CapturePoint
from .config import DynamicConfig
from .engines import begin
from .hip_strategy import HipStrategy
from .legs import Legs, tilt_rotation
from .odometry import Footprints, body_between_feet
from .physics import Stage
from .sensing import TrunkSensor
from .servo_body import ServoBody
from .urdf import floor_bumps

NECK = ("pan", "tilt")
TOP_M = 1.0  # ours: higher objects cannot be touched
FALLEN = math.cos(math.radians(50.0))  # ours: tilt beyond which the body has fallen
BUMP_M = 0.005  # ours: lower steps are left to the control of the landing, as on bumps


class DynamicBody(ServoBody):
    """Walks by footsteps from a start pose; the members of `Body` are documented there."""

    def __init__(
        self,
        world: World,
        gait: GaitConfig,
        config: DynamicConfig,
        imu: ImuConfig,
        head: Head,
        rng: np.random.Generator,
        ground: Ground | None = None,
    ) -> None:
        """Place the robot and let it settle.

        Args:
            world: Its scene; all objects in it are solid.
            gait: Gait scaled to this body, see `anatomy.gait_for`.
            config: Body and floor.
            imu: Noise of means over 0.2 s.
            head: Moved along with every tick.
            rng: Source of joint offsets, bumps and noise.
            ground: Levels of the scene; None for a floor.
        """
        body = config.body
        self._scale = body.hip_m / DARWIN.hip_m
        inward = gait.zmp_inward_m + config.balance.inward_m * self._scale
        gait = replace(gait, zmp_inward_m=inward)
        self.config, self._head = config, head
        self._rng = rng
        self._legs = Legs(body)
        self._gait = Gait(gait)
        tick_s = self._tick_s = gait.tick_s
        count = len(Legs.joints)
        offset = math.radians(config.offset_deg)
        self._offset = np.append(offset * rng.standard_normal(count), np.array(head.joint_offsets))
        self._half_backlash = np.full(count + 2, math.radians(config.backlash_deg) / 2)
        self._angles = self._legs.stand(np.zeros(2), gait.stance_width_m)
        self._planned = self._angles.copy()
        self._commanded = (*Legs.joints, *NECK)
        stance = dict(zip(Legs.joints, self._angles.tolist(), strict=True))
        pelvis = self._legs.footprints(self._angles)
        ahead = Pose2(-(pelvis[0].x + pelvis[1].x) / 2, 0.0)
        bumps = floor_bumps(world.scene.extent, config.bump_m, rng) if config.bump_m > 0.0 else []
        levels = [part for part in world.scene.ground if isinstance(part, Box)]
        start = world.scene.start @ ahead
        self._floor_m = 0.0 if ground is None else ground.under(start)
        self._world = world
        stage = Stage(
            body,
            start,
            stance,
            self._floor_m + body.hip_m + config.bump_m,
            tick_s,
            config.up,
            [*bumps, *levels],
            still_parts(world.scene, self._floor_m + TOP_M),
            [parts for _, parts, _ in world.scene.moving_bodies],
        )
        self.physics = begin(config.engine, stage)
        self._sensor = TrunkSensor(imu, config.balance, tick_s, rng)
        self._attitude = self._sensor.attitude
        self._ankles = AnkleFeedback(tick_s)
        self._landing = LandingControl(config.balance, tick_s, self._scale)
        self._capture = CapturePoint(config.balance, gait.com_height_m, self._scale)
        self._hips = HipStrategy(config.balance, tick_s, self._scale)
        self._encoders = self._rounded(self._angles)
        self._push: tuple[np.ndarray, int] = (np.zeros(3), 0)
        self._last = np.append(self._angles, [0.0, 0.0])
        self._pelvis = np.array([[0.0, 0.0, body.hip_m, 0.0]])
        self._settle()

    def push(self, force: Float[np.ndarray, "3"], seconds: float) -> None:
        """Apply a force at the pelvis from now on, world axes, N."""
        self._push = (force, round(seconds / self._tick_s))

    def trunk_from_encoders(self) -> Pose3:
        """Pelvis in the body frame as the robot estimates it, lowered by its height while walking.

        The encoders give legs without backlash on a level sole. The tilt that the inertial sensor measures, less the
        bend of the hips, is taken as a rotation about the stance foot.
        """
        feet = self._footprints
        pelvis, sole = self._odometry.pelvis(feet), self._odometry.sole(feet)
        hip = np.array([0.0, 0.0, self.config.body.hip_m])
        level, leaning = (
            self._attitude.level(),
            tilt_rotation(self._attitude.tilt - self._hips.bend),
        )
        pelvis_m, (_, ground_m) = float(self._pelvis[max(self._tick - 1, 0), 2]), self._planned_m
        lower_m = self.config.body.hip_m - (pelvis_m - ground_m)  # than on level ground
        foot = np.array([sole.x, sole.y, lower_m])  # below the pelvis, pelvis axes
        place = pelvis.lifted().translation + np.array([sole.x, sole.y, self._standing_m])
        return Pose3.from_rotation(level, place + times(leaning, hip - foot) - times(level, hip))

    @property
    def up(self) -> tuple[float, float, float]:
        return self.config.up

    @property
    def stepping(self) -> bool:
        """Whether a foot swings in this step."""
        return self._step.stepping

    @property
    def true_pose(self) -> Pose2:
        left, right = (
            self.physics.link(f"{side}_ankle_roll").flattened() for side in ("left", "right")
        )
        return body_between_feet(left, right, self.physics.pelvis().flattened().yaw)

    @property
    def true_height_m(self) -> float:
        """By the standing sole, and by the plan relative to that."""
        if not self._world.scene.ground:
            return 0.0
        standing = "left" if self._odometry.standing > 0 else "right"
        sole_m = self.physics.link(f"{standing}_ankle_roll").translation[2]
        return float(sole_m) - self.config.body.ankle_m - self._standing_m

    def foot_heights(self) -> tuple[float, float]:
        left_m, right_m = self._legs.heights(self._encoders, self._hips.bend)
        standing_m = left_m if self._odometry.standing > 0 else right_m
        return left_m - standing_m + self._standing_m, right_m - standing_m + self._standing_m

    @property
    def _body_m(self) -> float:
        return self._planned_m[0]

    @property
    def _planned_m(self) -> tuple[float, float]:
        """Heights of the body frame and of the ground of the standing foot by the plan, above the start, m."""
        step, k = self._step, max(self._tick - 1, 0)
        feet_m = step.left_m if self._odometry.standing > 0 else step.right_m
        return float(step.body_m[k]), float(feet_m[k])

    @property
    def _standing_m(self) -> float:
        """Height of the standing foot above the body frame, by the plan, m."""
        body_m, standing_m = self._planned_m
        return standing_m - body_m

    def true_trunk(self) -> Pose3:
        pelvis = self.true_pose.inverse().lifted() @ self.physics.pelvis()
        trunk = pelvis @ Pose3((0.0, 0.0, -self.config.body.hip_m))
        x, y, z = trunk.translation
        return replace(trunk, translation=(x, y, z - self.true_height_m))

    def head_pose(self) -> Pose3:
        """True head in the world, at the tilt joint."""
        return self.physics.link("tilt")

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        inverse = self.true_pose.inverse()
        ankle = self.config.body.ankle_m
        left, right = (self.physics.link(f"{side}_ankle_roll") for side in ("left", "right"))
        return (
            (
                inverse @ left.flattened(),
                max(left.translation[2] - ankle, 0.0) - self.true_height_m,
            ),
            (
                inverse @ right.flattened(),
                max(right.translation[2] - ankle, 0.0) - self.true_height_m,
            ),
        )

    @property
    def _footprints(self) -> Footprints:
        """Left and right foot as the robot estimates them, from a level pelvis."""
        return self._legs.footprints(self._encoders, self._hips.bend)

    def _begin_step(self) -> None:
        self._walking = self._tick > 0 and self._step.stepping
        extension = self._capture.step_extension_m if self._tick > 0 else 0.0
        command = self._command or WalkCommand()
        if abs(command.rise_m) < BUMP_M * self._scale:
            command = replace(command, rise_m=0.0)
        self._step = self._gait.step(command, extension)
        self._command = None
        self._tick = 0
        before_m = float(self._pelvis[-1, 2])
        self._pelvis = self._legs.pelvis_trajectory(
            self._step, self._planned, self._tick_s, before_m
        )
        self._left, self._right = self._legs.ankles(self._step)
        self._sensor.begin_step(self._step.com_velocity, self._step.body[:, 2])

    def _advance_tick(self) -> None:
        """Plan, balance, servos, physics, sensors."""
        step, tick = self._step, self._tick
        physics = self.physics
        tilt, rate = self._attitude.tilt - self._hips.bend, self._sensor.rate[:2] - self._hips.rate
        self._capture.update(tilt, rate)
        self._hips.update(self._capture.error)
        if self.swinging and self._capture.is_falling_to(self.swinging):
            self._landing.land_now()
        side = self._landing.side_to_check(step, tick)
        load = 0.0
        if side:
            load = physics.sole_force(f"{'left' if side > 0 else 'right'}_ankle_roll")
        landed = self._landing.landed_early(step)
        self._landing.update(step, tick, load)
        if self._landing.landed_early(step) and not landed:
            swung = self._left if step.swing > 0 else self._right
            swung[tick:, (0, 1, 3)] = swung[tick, (0, 1, 3)]
            self._gait.land(step, tick)
        wait = self._walking and self._landing.must_wait(step, tick, load)
        left, right = self._left[tick].copy(), self._right[tick].copy()
        left[2] += self._landing.heights[0]
        right[2] += self._landing.heights[1]
        bend = self._hips.bend
        pelvis = self._pelvis[tick].copy()
        pelvis[:2] -= times(_turned(pelvis[3]), self._legs.com_shift(bend))
        angles = self._legs.solve(pelvis, left, right, bend)
        self._planned[:] = angles
        self._tick += 0 if wait else 1
        self._ticks += 1
        self._ankles.correct(angles, tilt, rate, self.swinging, self._step.stepping)
        self._head.advance(self._tick_s)
        self._drive(np.append(angles, self._head.setpoints))
        force, ticks_left = self._push
        if ticks_left > 0:
            physics.push(force)
            self._push = (force, ticks_left - 1)
        physics.step()
        self._follow(tick)

    def _drive(self, wanted: Float[np.ndarray, "14"]) -> None:
        """Servo setpoints, with joint offsets and backlash."""
        rates = (wanted - self._last) / self._tick_s
        self._last = wanted
        motor = wanted + self._offset
        joints = self.physics.angles(self._commanded)
        setpoint = np.empty_like(motor)
        apply_backlash(motor, joints, self._half_backlash, setpoint)
        self._wanted = motor
        self.physics.command_joints(self._commanded, setpoint, rates)

    def _follow(self, tick: int) -> None:
        """Update encoders, which sit on the motors' side of the gears, the stance foot and the fall detection."""
        found = self.physics.angles(self._commanded)
        motor = np.clip(self._wanted, found - self._half_backlash, found + self._half_backlash)
        self._encoders = self._rounded((motor - self._offset)[:12])
        pan, tilt = (found - self._wanted)[12:].tolist()
        self._head.set_deflection((pan, tilt), tuple((motor - self._wanted)[12:].tolist()))
        self._shift_weight(tick)
        self._sensor.sense(tick, self.physics.imu_reading())
        if tilt_rotation(self._attitude.tilt - self._hips.bend)[2, 2] < FALLEN:
            self.fallen = True

    def _rounded(self, angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Round to the resolution of the encoders."""
        count = math.radians(self.config.encoder_deg)
        return np.round(angles / count) * count if count > 0.0 else angles


def still_parts(scene: Scene, top_m: float) -> list[Shape]:
    """What a body can touch of the static objects, up to a height; levels of the ground are not among it."""
    return [
        part
        for item in scene.static_objects
        for part in item.parts
        if part.bottom_m < top_m and not (item.ground and isinstance(part, Box))
    ]


def _turned(yaw: float) -> Float[np.ndarray, "2 2"]:
    """Rotation from body axes to the axes of the plan."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])
