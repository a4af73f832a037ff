"""Kinematic body: feet and centre of mass follow the gait exactly, plus drawn slip and sway.

Three poses differ. The joint encoders give the body pose in the gait's own dead reckoning, without error. The true
body slips a little against the floor with every step. The trunk sways about the true body, and the encoders do not
measure that. So odometry lacks the slip, and measured camera poses lack the sway.

Source: errors measured on the dynamic body at this size (backlash 0.5 deg, joint offsets 0.3 deg, floor bumps 2 mm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Imu
from perception.primitives.pose import Pose2, Pose3, times
from perception.primitives.settings import setting
from planning.commands import WalkCommand

from ..ground import Ground
from ..ranges import check_ranges
from .body import Advance
from .gait import Gait, GaitConfig, Step
from .head import MovingHead
from .inertial import InertialSensor, TrunkState


@dataclass(frozen=True)
class SlipConfig:
    """True minus commanded motion of one step; a standing body does not slip."""

    forward_mean_m: float = -0.0012  # measured
    forward_sigma_m: float = setting(
        0.0015, "m", "standard deviation of forward slip per step, kinematic body", "measured"
    )
    lateral_sigma_m: float = 0.0006  # measured: 0.4 to 0.8 mm
    turn_bias_deg: float = 0.2  # measured: uniform in +- this, constant within a run
    turn_sigma_deg: float = setting(
        0.6, "deg", "standard deviation of rotational slip per step, kinematic body", "measured"
    )

    def __post_init__(self) -> None:
        check_ranges(
            "slip",
            self,
            forward_mean_m=(-0.1, 0.1),
            forward_sigma_m=(0.0, 0.1),
            lateral_sigma_m=(0.0, 0.1),
            turn_bias_deg=(0.0, 45.0),
            turn_sigma_deg=(0.0, 45.0),
        )


@dataclass(frozen=True)
class SwayConfig:
    """Motion of the trunk that the encoders do not measure: zero mean, independent between frames."""

    roll_deg: float = 0.72  # measured; all are standard deviations
    pitch_deg: float = 0.5  # measured
    yaw_deg: float = 0.4  # measured: backlash of the neck, unseen by the sensor in the trunk
    height_m: float = 0.0003  # measured
    standing_share: float = 0.2  # ours: share that remains while the body stands

    def __post_init__(self) -> None:
        check_ranges(
            "sway",
            self,
            roll_deg=(0.0, 45.0),
            pitch_deg=(0.0, 45.0),
            yaw_deg=(0.0, 45.0),
            height_m=(0.0, 0.1),
            standing_share=(0.0, 1.0),
        )


@dataclass(frozen=True)
class Sway:
    """Deviation of the trunk from its pose by the joints: rad, m."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    height_m: float = 0.0


@dataclass(frozen=True)
class Landing:
    """How a foot came to stand on ground of several levels; truth.

    Args:
        number: Of the landing, from 1 on.
        carried: Share of its length with ground below it.
        middle: Whether its middle has ground below it.
        expected_m: Height above the other foot that was commanded.
        rise_m: The height that it has.
        struck_m: By how much it went below the ground on its way.
    """

    number: int
    carried: float
    middle: bool
    expected_m: float
    rise_m: float
    struck_m: float


class KinematicBody:
    """Walks by footsteps from a start pose; the members of `Body` are documented there.

    Without a command it stands; on several levels with its feet where they are. On flat ground it never falls. On several levels it does where the middle of a sole has no ground below it, or where the
    ground is lower or higher than commanded by more than the lift of a foot.
    """

    up = (0.0, 0.0, 1.0)

    def __init__(
        self,
        start: Pose2,
        gait: GaitConfig,
        slip: SlipConfig,
        sway: SwayConfig,
        inertial: InertialSensor,
        head: MovingHead,
        rng: np.random.Generator,
        ground: Ground | None = None,
    ) -> None:
        self._gait = Gait(gait)
        self._ground = ground
        self.landing: Landing | None = None  # the latest one
        self._floor_m = 0.0 if ground is None else ground.under(start)
        self._inertial, self._head = inertial, head
        self._slip_config, self._sway_config = slip, sway
        self._rng = rng
        bias = math.radians(slip.turn_bias_deg)
        self._turn_bias = float(rng.uniform(-bias, bias))
        self._command: WalkCommand | None = None
        self._ticks = 0
        self._rest = (
            Pose2(),
            np.zeros(2),
            np.zeros(2),
        )  # pose and mass centre where the step began
        self._rest_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
        self.true_pose = start
        self.sway = Sway()
        self._begin_step()
        self._before = self._trunk_state()  # at the last reading of the inertial sensor
        self._since_s = 0.0

    @property
    def fallen(self) -> bool:
        if self.landing is None:
            return False
        off_m = abs(self.landing.rise_m - self.landing.expected_m)
        return not self.landing.middle or off_m > self._gait.config.lift_m

    def walk(self, command: WalkCommand) -> None:
        self._command = command

    def start_due_step(self) -> None:
        if self._tick == self._step.ticks:
            self._begin_step()

    @property
    def ticks_left(self) -> int:
        return self._step.ticks - self._tick

    @property
    def ticks(self) -> int:
        return self._ticks

    def advance(self, ticks: int) -> Advance:
        """Simulate some ticks, turn the head and draw a new sway."""
        before, steps, asked = self.odometry_pose, 0.0, ticks
        low_m = self._body_m
        while ticks > 0:
            self.start_due_step()
            part = min(ticks, self._step.ticks - self._tick)
            steps += self._advance_within(part)
            ticks -= part
        self._ticks += asked
        self.sway = self._draw_sway()
        motion = before.inverse() @ self.odometry_pose
        seconds = asked * self._gait.config.tick_s
        self._head.advance(seconds)
        self._since_s += seconds
        return Advance(motion, steps, seconds, self._body_m - low_m)

    def measure_imu(self) -> Imu:
        before, self._before = self._before, self._trunk_state()
        seconds, self._since_s = self._since_s, 0.0
        return self._inertial.measure(before, self._before, seconds)

    @property
    def odometry_pose(self) -> Pose2:
        """Body pose in the gait's own dead reckoning, as the encoders give it."""
        if self._tick == 0:
            return self._rest[0]
        return _pose(self._step.body[self._tick - 1])

    @property
    def pelvis_pose(self) -> Pose2:
        """Pelvis in the body frame by the joints: the weight shifts from foot to foot."""
        com = self._rest[1] if self._tick == 0 else self._step.com[self._tick - 1]
        body = self.odometry_pose
        offset = times(body.rotation.T, com - np.array([body.x, body.y]))
        return Pose2(float(offset[0]), float(offset[1]), 0.0)

    def trunk_from_encoders(self) -> Pose3:
        """Pelvis, projected on the floor, in the body frame as the encoders give it."""
        pelvis = self.pelvis_pose
        return Pose3((pelvis.x, pelvis.y, 0.0 - self._lowered_m))

    @property
    def velocity_body(self) -> Float[np.ndarray, "2"]:
        """Velocity of the centre of mass, body axes, m/s."""
        velocity = self._rest[2] if self._tick == 0 else self._step.com_velocity[self._tick - 1]
        return times(self.odometry_pose.rotation.T, velocity)

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        index = max(self._tick - 1, 0)
        inverse = self.odometry_pose.inverse()
        lift = float(self._step.lift[index]) if self._tick > 0 else 0.0
        left = inverse @ _pose(self._step.left[index])
        right = inverse @ _pose(self._step.right[index])
        left_m, right_m = self._feet_m
        return (
            (left, left_m + (lift if self._step.swing > 0 else 0.0)),
            (right, right_m + (lift if self._step.swing < 0 else 0.0)),
        )

    def feet_from_encoders(self) -> tuple[tuple[Pose2, bool], tuple[Pose2, bool]]:
        """The feet by the joints, which this body moves exactly."""
        (left, _), (right, _) = self.feet_body
        lifted = self._tick > 0 and float(self._step.lift[self._tick - 1]) > 0.0
        swing = self._step.swing if lifted else 0
        return (left, swing > 0), (right, swing < 0)

    def foot_heights(self) -> tuple[float, float]:
        """Heights of left and right sole in the body frame by the joints, m."""
        (_, left_m), (_, right_m) = self.feet_body
        return left_m, right_m

    @property
    def true_height_m(self) -> float:
        """Height of the true body frame above the floor."""
        return self._floor_m + self._body_m

    @property
    def true_swing(self) -> tuple[int, Float[np.ndarray, "n 4"]]:
        """The foot that swings in this step, 1 left, -1 right, 0 none, and its true x, y, yaw and height, tick by tick."""
        step = self._step
        path = step.left if step.swing > 0 else step.right
        ground_m = step.left_m if step.swing > 0 else step.right_m
        before, origin = self._rest[0].inverse(), self._rest_true
        poses = []
        for k, row in enumerate(path):
            slip = Pose2(*(float(v) for v in self._slip * float(step.progress[k])))
            body = origin @ (before @ _pose(step.body[k])) @ slip
            foot = body @ (_pose(step.body[k]).inverse() @ _pose(row))
            poses.append(foot.vector)
        height = self._floor_m + ground_m + step.lift
        return step.swing, np.column_stack([np.array(poses), height])

    def true_trunk(self) -> Pose3:
        """True pelvis with its sway, projected on the floor, in the true body frame."""
        t = self.sway
        pelvis = self.pelvis_pose
        rotation = _rotation(t.roll_rad, t.pitch_rad, t.yaw_rad)
        height_m = t.height_m - self._lowered_m
        return Pose3.from_rotation(rotation, np.array([pelvis.x, pelvis.y, height_m]))

    def steady_trunk(self) -> Pose3:
        """The pelvis without sway."""
        return self.trunk_from_encoders()

    def close(self) -> None:
        """Nothing to release."""

    def _trunk_state(self) -> TrunkState:
        sway = self.sway
        return TrunkState(self.true_pose.yaw, self.velocity_body, sway.roll_rad, sway.pitch_rad)

    def _begin_step(self) -> None:
        if self._ticks > 0:
            last = self._step
            self._rest = (_pose(last.body[-1]), last.com[-1], last.com_velocity[-1])
            self._rest_m = (last.body_m[-1], last.lowered_m[-1], last.left_m[-1], last.right_m[-1])
        command = self._command or WalkCommand(stay=self._ground is not None)
        self._command = None
        self._tick = 0
        self._rest_true = self.true_pose
        config = self._slip_config
        forward, lateral, turn = self._rng.standard_normal(3)
        self._slip = np.array(
            [
                config.forward_mean_m + config.forward_sigma_m * forward,
                config.lateral_sigma_m * lateral,
                self._turn_bias + math.radians(config.turn_sigma_deg) * turn,
            ]
        )
        self._rise_m = command.rise_m
        self._step: Step = self._gait.step(command, height_m=self._landing_m(command))

    def _landing_m(self, command: WalkCommand) -> float | None:
        """Height of the ground where the swing foot will land, above that of the start; None on flat ground."""
        if self._ground is None:
            return None
        body, foot = self._gait.landing(command)
        slip = Pose2(*(float(v) for v in self._slip))
        lands = self.true_pose @ (self._rest[0].inverse() @ body) @ slip @ (body.inverse() @ foot)
        return self._ground.under(lands) - self._floor_m

    @property
    def _body_m(self) -> float:
        """Height of the body in the gait's own dead reckoning."""
        return float(self._rest_m[0] if self._tick == 0 else self._step.body_m[self._tick - 1])

    @property
    def _lowered_m(self) -> float:
        return float(self._rest_m[1] if self._tick == 0 else self._step.lowered_m[self._tick - 1])

    @property
    def _feet_m(self) -> tuple[float, float]:
        """Heights of the ground of both feet above the body frame, without the lift."""
        if self._tick == 0:
            return float(self._rest_m[2] - self._rest_m[0]), float(
                self._rest_m[3] - self._rest_m[0]
            )
        step, k = self._step, self._tick - 1
        return float(step.left_m[k] - step.body_m[k]), float(step.right_m[k] - step.body_m[k])

    def _advance_within(self, ticks: int) -> float:
        """Advance within one step; return the share of the step made."""
        before = self.odometry_pose
        done = float(self._step.progress[self._tick - 1]) if self._tick > 0 else 0.0
        self._tick += ticks
        share = float(self._step.progress[self._tick - 1]) - done
        slip = Pose2(*(float(v) for v in self._slip * share))
        self.true_pose = self.true_pose @ (before.inverse() @ self.odometry_pose) @ slip
        if self._ground is not None and self._step.swing and self._tick == self._step.ticks:
            self.landing = self._landed(self._ground)
        return share

    def _landed(self, ground: Ground) -> Landing:
        """How the foot stands that has just landed."""
        swing, path = self.true_swing
        foot, _ = self.feet_body[0 if swing > 0 else 1]
        carried, middle = ground.carried(self.true_pose @ foot)
        left_m, right_m = self.foot_heights()
        number = 1 if self.landing is None else self.landing.number + 1
        rise_m = (left_m - right_m) * swing
        return Landing(number, carried, middle, self._rise_m, rise_m, ground.struck(path))

    def _draw_sway(self) -> Sway:
        config = self._sway_config
        share = 1.0 if self._step.stepping else config.standing_share
        roll, pitch, yaw, height = (float(v) * share for v in self._rng.standard_normal(4))
        return Sway(
            math.radians(config.roll_deg) * roll,
            math.radians(config.pitch_deg) * pitch,
            math.radians(config.yaw_deg) * yaw,
            config.height_m * height,
        )


def _pose(row: Float[np.ndarray, "3"]) -> Pose2:
    x, y, yaw = (float(v) for v in row)
    return Pose2(x, y, (yaw + math.pi) % (2 * math.pi) - math.pi)


def _rotation(roll: float, pitch: float, yaw: float) -> Float[np.ndarray, "3 3"]:
    """Rotation by roll about x, then pitch about y, then yaw about z, fixed axes."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return times(times(about_z, about_y), about_x)
