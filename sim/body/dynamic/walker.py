"""A body that really walks: the same gait as the kinematic one, made by servos in a physical world.

Every tick the plan becomes joint angles, the balance adds what the inertial sensor asks for, the servos do
what play and askew zeros let them, and the physics decides. What the joints report comes from encoders;
what is true is asked of the physics.

Source: seed 000, section 2.1 (command); seed 001, section V-A (period 5 ms); gains: walking trials.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.frame import Imu
from perception.primitives.pose import Pose2, Pose3
from planning.commands import WalkCommand

from ...ranges import check_ranges
from ...world import World
from ..gait import Gait, GaitConfig, Step
from ..head import Head
from ..inertial import ImuConfig
from ..kinematic import Advance
from ._legs_kernels import engage
from .anatomy import ANATOMIES, DARWIN, Anatomy
from .balance import Ankles, Attitude, BalanceConfig, Landing
from .capture import CapturePoint
from .hip_strategy import Hips
from .legs import Legs, tilted
from .odometry import Footprints, FootToFoot, body_over
from .physics import Physics
from .urdf import bumps

SETTLE_S = 1.0
NECK = ("pan", "tilt")
TOP_M = 1.0  # nothing higher can be touched
FALLEN = math.cos(math.radians(50.0))


@dataclass(frozen=True)
class DynamicConfig:
    """What the walking body is, and how imperfect it and its floor are.

    Args:
        anatomy: "darwin" or "tall" (seed 004); contacts are judged by its measures, the kinematic body's too.
        scale: All lengths of it times this.
        play_deg: Of the gears, from flank to flank.
        offset_deg: Deviation of each joint's zero, one value a run.
        encoder_deg: Grain of the legs' encoders.
        bump_m: Highest bump of the floor.
        slope_rad: How the floor rises along x and y of the world.
        balance: Gains.
    """

    anatomy: str = "darwin"
    scale: float = 1.0
    play_deg: float = 0.5  # hobby servos; without it the walk is unrealistically smooth
    offset_deg: float = 0.3  # ours: zeros set by eye
    encoder_deg: float = 360.0 / 4096.0  # MX-28: 4096 to the turn
    bump_m: float = 0.002  # ours: floorboards, seams of carpets
    slope_rad: tuple[float, float] = (0.0, 0.0)
    balance: BalanceConfig = field(default_factory=BalanceConfig)

    def __post_init__(self) -> None:
        if self.anatomy not in ANATOMIES:
            raise ConfigError(
                f"dynamic: anatomy={self.anatomy!r} is unknown; choose {', '.join(ANATOMIES)}"
            )
        ANATOMIES[self.anatomy].scaled(self.scale)
        check_ranges(
            "dynamic",
            self,
            play_deg=(0.0, 10.0),
            offset_deg=(0.0, 10.0),
            encoder_deg=(0.0, 10.0),
            bump_m=(0.0, 0.05),
        )
        if not all(abs(value) < 0.3 for value in self.slope_rad):
            raise ConfigError(f"dynamic: slope_rad={self.slope_rad} must be below 0.3 rad")

    @property
    def body(self) -> Anatomy:
        """The measures meant."""
        return ANATOMIES[self.anatomy].scaled(self.scale)

    @property
    def up(self) -> tuple[float, float, float]:
        """Against gravity, unit vector in the world, whose floor is z = 0 on a slope too."""
        x, y = (math.sin(rise) for rise in self.slope_rad)
        return x, y, math.sqrt(1.0 - x * x - y * y)


class DynamicBody:
    """Walks by footsteps from a start pose; advanced in whole ticks of the gait.

    Answers what `KinematicBody` answers.
    """

    def __init__(
        self,
        world: World,
        gait: GaitConfig,
        config: DynamicConfig,
        imu: ImuConfig,
        head: Head,
        rng: np.random.Generator,
    ) -> None:
        """Put the robot down, and let it settle.

        Args:
            world: Whose scene it stands in; its things are solid.
            gait: For this body, see `anatomy.gait_for`.
            config: Body and floor.
            imu: Noise of the means over a fifth of a second.
            head: Turned along, tick by tick.
            rng: Of zeros, bumps and noise.
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
        self._offset = np.append(offset * rng.standard_normal(count), np.array(head.zeros))
        self._half_play = np.full(count + 2, math.radians(config.play_deg) / 2)
        self._angles = self._legs.stand(np.zeros(2), gait.stance_width_m)
        self._planned = self._angles.copy()
        self._steered = (*Legs.joints, *NECK)
        stance = dict(zip(Legs.joints, self._angles.tolist(), strict=True))
        pelvis = self._legs.footprints(self._angles)
        ahead = Pose2(-(pelvis[0].x + pelvis[1].x) / 2, 0.0)
        self.physics = Physics(
            body,
            world.scene.start @ ahead,
            stance,
            body.hip_m + config.bump_m,
            tick_s,
            config.up,
        )
        rough = bumps(world.scene.extent, config.bump_m, rng) if config.bump_m > 0.0 else []
        self._world = world
        low = [
            part for thing in world.scene.things for part in thing.parts if part.bottom_m < TOP_M
        ]
        self.physics.furnish(rough, low, [mover.parts for mover in world.scene.movers])
        self._imu = imu
        self._gyro_bias = imu.gyro_bias_radps * rng.standard_normal(3)
        self._force_bias = imu.force_bias_mps2 * rng.standard_normal(3)
        self._attitude = Attitude(config.balance, tick_s)
        self._ankles = Ankles(config.balance, tick_s)
        self._landing = Landing(config.balance, tick_s, self._scale)
        self._weight = CapturePoint(config.balance, gait.com_height_m, self._scale)
        self._hips = Hips(config.balance, tick_s, self._scale)
        self._encoders = self._rounded(self._angles)
        self._command: WalkCommand | None = None
        self._push: tuple[np.ndarray, int] = (np.zeros(3), 0)
        self._sums: tuple[np.ndarray, np.ndarray, int] = (np.zeros(3), np.zeros(3), 0)
        self._rate = np.zeros(3)
        self._velocity = np.zeros(2)
        self.fallen = False
        self._ticks = -round(SETTLE_S / tick_s)
        self._last = np.append(self._angles, [0.0, 0.0])
        self._tick = 0
        self._odometry = FootToFoot(self._footprints)
        self._begin_step()
        while self._ticks < 0:
            self._settle()
        self._odometry = FootToFoot(self._footprints)
        self._begin_step()

    def walk(self, command: WalkCommand) -> None:
        """Taken up at the start of the coming double support; the last one counts."""
        self._command = command

    def push(self, force: Float[np.ndarray, "3"], seconds: float) -> None:
        """Somebody pushes at the pelvis from now on, world axes, N."""
        self._push = (force, round(seconds / self._tick_s))

    def take_up(self) -> None:
        """Begin the next step with the command given, if this one is over."""
        if self._tick == self._step.ticks:
            self._begin_step()

    @property
    def ticks_left(self) -> int:
        """To the end of the step, which is the end of its single support."""
        return self._step.ticks - self._tick

    @property
    def ticks(self) -> int:
        """Since the beginning."""
        return self._ticks

    def advance(self, ticks: int) -> Advance:
        """Move on; waiting for a foot to land takes longer than planned.

        Args:
            ticks: Of the plan, at least 1; may reach into the following steps.
        """
        before, steps, began = self._odometry.body(self._footprints), 0.0, self._ticks
        movers = self._world.movers()
        while ticks > 0:
            self.take_up()
            late = (self._ticks + 1 - began) * self._tick_s
            self.physics.place([(x + vx * late, y + vy * late) for x, y, vx, vy in movers])
            tick, done = self._tick, self._done
            self._advance_tick()
            ticks -= self._tick - tick
            steps += self._done - done
        motion = before.inverse() @ self._odometry.body(self._footprints)
        return Advance(motion, steps, (self._ticks - began) * self._tick_s)

    def trunk_by_joints(self) -> Pose3:
        """The pelvis in the body frame as the robot has it, lowered by the height it has while walking.

        Encoders know legs without play on a level sole. What the inertial sensor finds tilted, and the
        hips have not bent, is taken to lean about the foot that stands.
        """
        prints = self._footprints
        pelvis, sole = self._odometry.pelvis(prints), self._odometry.sole(prints)
        hip = np.array([0.0, 0.0, self.config.body.hip_m])
        level, leaning = self._attitude.level(), tilted(self._attitude.tilt - self._hips.bend)
        foot = np.array([sole.x, sole.y, 0.0])  # below the pelvis, pelvis axes
        place = pelvis.lifted().translation + foot + leaning @ (hip - foot) - level @ hip
        return Pose3.from_rotation(level, place)

    @property
    def stepping(self) -> bool:
        """Whether a foot swings in this step."""
        return self._step.stepping

    @property
    def swinging(self) -> int:
        """The side that is in the air by plan, +1 left, -1 right, 0 none."""
        aloft = self._step.stepping and self._tick > self._step.double_support_ticks
        return self._step.swing if aloft else 0

    @property
    def true_pose(self) -> Pose2:
        """Midway between the true feet, heading with the true pelvis."""
        left, right = (
            _below(self.physics.link(f"{side}_ankle_roll")) for side in ("left", "right")
        )
        return body_over(left, right, _below(self.physics.pelvis()).yaw)

    def true_trunk(self) -> Pose3:
        """The pelvis in the true body frame, lowered by the height it has while walking."""
        pelvis = self.true_pose.inverse().lifted() @ self.physics.pelvis()
        return pelvis @ Pose3((0.0, 0.0, -self.config.body.hip_m))

    def head_pose(self) -> Pose3:
        """The true head in the world, at the tilt joint."""
        return self.physics.link("tilt")

    @property
    def planned_pose(self) -> Pose2:
        """The body where the gait's own dead reckoning has it: what was commanded."""
        x, y, yaw = (float(v) for v in self._step.body[max(self._tick - 1, 0)])
        return Pose2(x, y, yaw)

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        """Left and right foot in the true body frame, each with its height above the floor, m."""
        inverse = self.true_pose.inverse()
        ankle = self.config.body.ankle_m
        left, right = (self.physics.link(f"{side}_ankle_roll") for side in ("left", "right"))
        return (
            (inverse @ _below(left), max(left.translation[2] - ankle, 0.0)),
            (inverse @ _below(right), max(right.translation[2] - ankle, 0.0)),
        )

    def feel(self) -> Imu:
        """Means of the inertial sensor since it was last asked, levelled by its own vertical."""
        rate, force, count = self._sums
        self._sums = (np.zeros(3), np.zeros(3), 0)
        return Imu(rate / max(count, 1), force / max(count, 1))

    def close(self) -> None:
        """Give the physics back."""
        self.physics.close()

    @property
    def _footprints(self) -> Footprints:
        """Left and right foot as the robot has them, from an upright pelvis."""
        return self._legs.footprints(self._encoders, self._hips.bend)

    @property
    def _done(self) -> float:
        """Share of the step's motion that is planned to be done by now."""
        return float(self._step.progress[self._tick - 1]) if self._tick > 0 else 0.0

    def _begin_step(self) -> None:
        self._walking = self._tick > 0 and self._step.stepping
        astray = self._weight.ahead if self._tick > 0 else 0.0
        self._step: Step = self._gait.step(self._command or WalkCommand(), astray)
        self._command = None
        self._tick = 0
        self._pelvis = self._legs.carry(self._step, self._planned)
        self._left, self._right = self._legs.ankles(self._step)
        # what the walk itself will make the accelerometer feel, along and across the body
        velocity = np.vstack([self._velocity, self._step.com_velocity])
        self._velocity = velocity[-1]
        push = np.diff(velocity, axis=0) / self._tick_s
        c, s = np.cos(self._step.body[:, 2]), np.sin(self._step.body[:, 2])
        self._planned_push = np.column_stack(
            [c * push[:, 0] + s * push[:, 1], c * push[:, 1] - s * push[:, 0]]
        )
        noise = self._rng.standard_normal((self._step.ticks, 6))
        scale = math.sqrt(0.2 / self._tick_s)  # the config's noise is that of means over 0.2 s
        noise[:, :3] *= scale * self._imu.gyro_sigma_radps
        noise[:, 3:] *= scale * self._imu.force_sigma_mps2
        self._noise = noise

    def _settle(self) -> None:
        """One tick of standing before time begins."""
        self.take_up()
        self._advance_tick()

    def _advance_tick(self) -> None:
        """Plan, balance, servos, physics, sensors."""
        step, tick = self._step, self._tick
        physics = self.physics
        tilt, rate = self._attitude.tilt - self._hips.bend, self._rate[:2] - self._hips.rate
        self._weight.feel(tilt, rate)
        self._hips.advance(self._weight.error)
        if self.swinging and self._weight.tips_to(self.swinging):
            self._landing.hurry()
        asked = self._landing.asks(step, tick)
        load = 0.0
        if asked:
            load = physics.load_on(f"{'left' if asked > 0 else 'right'}_ankle_roll")
        stood = self._landing.stays(step)
        self._landing.advance(step, tick, load)
        if self._landing.stays(step) and not stood:
            swung = self._left if step.swing > 0 else self._right
            swung[tick:, (0, 1, 3)] = swung[tick, (0, 1, 3)]
            self._gait.land(step, tick)
        waits = self._walking and self._landing.waits(step, tick, load)
        left, right = self._left[tick].copy(), self._right[tick].copy()
        left[2] += self._landing.heights[0]
        right[2] += self._landing.heights[1]
        bend = self._hips.bend
        pelvis = self._pelvis[tick].copy()
        pelvis[:2] -= _turned(pelvis[3]) @ self._legs.aside(bend)
        angles = self._legs.solve(pelvis, left, right, bend)
        self._planned[:] = angles
        self._tick += 0 if waits else 1
        self._ticks += 1
        self._ankles.correct(angles, tilt, rate, self.swinging, self._step.stepping)
        self._head.advance(self._tick_s)
        self._drive(np.append(angles, self._head.aims))
        strength, left_over = self._push
        if left_over > 0:
            physics.push(strength)
            self._push = (strength, left_over - 1)
        physics.go_on()
        self._follow(tick)

    def _drive(self, wanted: Float[np.ndarray, "14"]) -> None:
        """Servos: askew zeros, and play that the motor has to take up first."""
        rates = (wanted - self._last) / self._tick_s
        self._last = wanted
        askew = wanted + self._offset
        found = self.physics.angles(self._steered)
        setpoint = np.empty_like(askew)
        engage(askew, found, self._half_play, setpoint)
        self._wanted = askew
        self.physics.steer(self._steered, setpoint, rates)

    def _follow(self, tick: int) -> None:
        """After a tick: encoders on the motors' side of the gears, the foot that stands, the fall."""
        found = self.physics.angles(self._steered)
        motor = np.clip(self._wanted, found - self._half_play, found + self._half_play)
        self._encoders = self._rounded((motor - self._offset)[:12])
        pan, tilt = (found - self._wanted)[12:].tolist()
        self._head.deflected((pan, tilt), tuple((motor - self._wanted)[12:].tolist()))
        step = self._step
        weighed = step.stepping and 2 * tick >= step.double_support_ticks
        if weighed and self._odometry.standing != -step.swing:
            self._odometry.read(self._footprints, -step.swing)
        self._sense(tick)
        if tilted(self._attitude.tilt - self._hips.bend)[2, 2] < FALLEN:
            self.fallen = True

    def _rounded(self, angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """To the grain of the encoders."""
        grain = math.radians(self.config.encoder_deg)
        return np.round(angles / grain) * grain if grain > 0.0 else angles

    def _sense(self, tick: int) -> None:
        """The inertial sensor in the trunk, with bias and noise."""
        rate, force = self.physics.felt()
        rate = rate + self._gyro_bias + self._noise[tick, :3]
        force = force + self._force_bias + self._noise[tick, 3:]
        self._rate = rate
        attitude = self._attitude
        attitude.feel(rate, force, self._planned_push[tick])
        level = attitude.level()
        upright = level @ rate
        upright[2] = attitude.turning(rate)
        turned, pushed, count = self._sums
        self._sums = (turned + upright, pushed + level @ force, count + 1)


def _turned(yaw: float) -> Float[np.ndarray, "2 2"]:
    """Rotation from the body's axes to those in which it is planned."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])


def _below(pose: Pose3) -> Pose2:
    """Seen from above."""
    x, y, _ = pose.translation
    ahead = pose.rotation[:, 0]
    return Pose2(x, y, math.atan2(ahead[1], ahead[0]))
