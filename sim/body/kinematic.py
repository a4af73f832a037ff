"""A kinematic body: feet and weight go exactly where the gait puts them, plus what reality adds.

Three poses must be told apart. The joints know the body in the gait's own dead reckoning, exactly. The
true body slips against the floor a little with every step. The trunk trembles about the true body, and
the encoders do not feel it. So the joints report motion without slip, and camera poses without tremble.

A body with dynamics would offer the same questions: where are feet, pelvis and trunk, what do the joints
say. Source: figures measured on a dynamic walker of this size (servo play 0.5 deg, joint offsets 0.3
deg, floor bumps 2 mm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, Pose3
from planning.commands import WalkCommand

from ..ranges import check_ranges
from .gait import Gait, GaitConfig, Step


@dataclass(frozen=True)
class SlipConfig:
    """True minus commanded motion of one step; a body that stands does not slip."""

    forward_mean_m: float = -0.0012  # measured
    forward_sigma_m: float = 0.0015  # measured
    lateral_sigma_m: float = 0.0006  # measured: 0.4 to 0.8 mm
    turn_bias_deg: float = (
        0.2  # measured: one value a run, even in +- this; 6 to 14 deg in 60 steps
    )
    turn_sigma_deg: float = 0.6  # measured

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
class TrembleConfig:
    """What the trunk does that the encoders do not feel; zero mean, independent from frame to frame."""

    roll_deg: float = 0.72  # measured, deviation
    pitch_deg: float = 0.5  # measured
    yaw_deg: float = (
        0.4  # measured; play in the neck, which an inertial sensor in the trunk does not feel
    )
    height_m: float = 0.0003  # measured
    standing_share: float = 0.2  # ours: a standing body trembles less

    def __post_init__(self) -> None:
        check_ranges(
            "tremble",
            self,
            roll_deg=(0.0, 45.0),
            pitch_deg=(0.0, 45.0),
            yaw_deg=(0.0, 45.0),
            height_m=(0.0, 0.1),
            standing_share=(0.0, 1.0),
        )


@dataclass(frozen=True)
class Tremble:
    """The trunk at one instant against where its joints put it: rad, m."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    height_m: float = 0.0


@dataclass(frozen=True)
class Advance:
    """What happened between two instants.

    Args:
        motion: Body now in the body before, by the joints.
        steps: Share of a footstep.
        seconds: Time passed.
    """

    motion: Pose2
    steps: float
    seconds: float


class KinematicBody:
    """Walks by footsteps from a start pose; advanced in whole ticks of the gait."""

    def __init__(
        self,
        start: Pose2,
        gait: GaitConfig,
        slip: SlipConfig,
        tremble: TrembleConfig,
        rng: np.random.Generator,
    ) -> None:
        self._gait = Gait(gait)
        self._slip_config, self._tremble_config = slip, tremble
        self._rng = rng
        bias = math.radians(slip.turn_bias_deg)
        self._turn_bias = float(rng.uniform(-bias, bias))
        self._command: WalkCommand | None = None
        self._ticks = 0
        self._rest = (Pose2(), np.zeros(2), np.zeros(2))  # pose and weight where the step began
        self.true_pose = start
        self.tremble = Tremble()
        self._begin_step()

    def walk(self, command: WalkCommand) -> None:
        """Taken up at the start of the coming double support; the last one counts."""
        self._command = command

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
        """Move on, and let the trunk tremble anew.

        Args:
            ticks: At least 1; may reach into the following steps.
        """
        before, steps, asked = self.joint_pose, 0.0, ticks
        while ticks > 0:
            self.take_up()
            part = min(ticks, self._step.ticks - self._tick)
            steps += self._advance_within(part)
            ticks -= part
        self._ticks += asked
        self.tremble = self._draw_tremble()
        motion = before.inverse() @ self.joint_pose
        return Advance(motion, steps, asked * self._gait.config.tick_s)

    @property
    def joint_pose(self) -> Pose2:
        """The body by the joints, in the gait's own dead reckoning."""
        if self._tick == 0:
            return self._rest[0]
        return _pose(self._step.body[self._tick - 1])

    @property
    def pelvis_joints(self) -> Pose2:
        """The pelvis in the body frame by the joints: the sway of the weight from foot to foot."""
        com = self._rest[1] if self._tick == 0 else self._step.com[self._tick - 1]
        body = self.joint_pose
        away = body.rotation.T @ (com - np.array([body.x, body.y]))
        return Pose2(float(away[0]), float(away[1]), 0.0)

    def trunk_by_joints(self) -> Pose3:
        """The pelvis, on the floor below it, in the body frame as the joints have it."""
        pelvis = self.pelvis_joints
        return Pose3((pelvis.x, pelvis.y, 0.0))

    @property
    def velocity_body(self) -> Float[np.ndarray, "2"]:
        """Of the centre of mass, in body axes, m/s."""
        velocity = self._rest[2] if self._tick == 0 else self._step.com_velocity[self._tick - 1]
        return np.asarray(self.joint_pose.rotation.T @ velocity)

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        """Left and right foot in the body frame, each with its height above the floor, m."""
        index = max(self._tick - 1, 0)
        inverse = self.joint_pose.inverse()
        lift = float(self._step.lift[index]) if self._tick > 0 else 0.0
        left = inverse @ _pose(self._step.left[index])
        right = inverse @ _pose(self._step.right[index])
        return (
            (left, lift if self._step.swing > 0 else 0.0),
            (right, lift if self._step.swing < 0 else 0.0),
        )

    @property
    def stepping(self) -> bool:
        """Whether a foot swings in this step."""
        return self._step.stepping

    def true_trunk(self) -> Pose3:
        """The trembling pelvis, on the floor below it, in the true body frame."""
        t = self.tremble
        pelvis = self.pelvis_joints
        rotation = _rotation(t.roll_rad, t.pitch_rad, t.yaw_rad)
        return Pose3.from_rotation(rotation, np.array([pelvis.x, pelvis.y, t.height_m]))

    def _begin_step(self) -> None:
        if self._ticks > 0:
            last = self._step
            self._rest = (_pose(last.body[-1]), last.com[-1], last.com_velocity[-1])
        self._step: Step = self._gait.step(self._command or WalkCommand())
        self._command = None
        self._tick = 0
        config = self._slip_config
        forward, lateral, turn = self._rng.standard_normal(3)
        self._slip = np.array(
            [
                config.forward_mean_m + config.forward_sigma_m * forward,
                config.lateral_sigma_m * lateral,
                self._turn_bias + math.radians(config.turn_sigma_deg) * turn,
            ]
        )

    def _advance_within(self, ticks: int) -> float:
        """Some ticks of one step: the joints' motion, and the slip's share of it, on the true pose."""
        before = self.joint_pose
        done = float(self._step.progress[self._tick - 1]) if self._tick > 0 else 0.0
        self._tick += ticks
        share = float(self._step.progress[self._tick - 1]) - done
        slip = Pose2(*(float(v) for v in self._slip * share))
        self.true_pose = self.true_pose @ (before.inverse() @ self.joint_pose) @ slip
        return share

    def _draw_tremble(self) -> Tremble:
        config = self._tremble_config
        activity = 1.0 if self._step.stepping else config.standing_share
        roll, pitch, yaw, height = (float(v) * activity for v in self._rng.standard_normal(4))
        return Tremble(
            math.radians(config.roll_deg) * roll,
            math.radians(config.pitch_deg) * pitch,
            math.radians(config.yaw_deg) * yaw,
            config.height_m * height,
        )


def _pose(row: Float[np.ndarray, "3"]) -> Pose2:
    x, y, yaw = (float(v) for v in row)
    return Pose2(x, y, (yaw + math.pi) % (2 * math.pi) - math.pi)


def _rotation(roll: float, pitch: float, yaw: float) -> Float[np.ndarray, "3 3"]:
    """Roll about x, then pitch about y, then yaw about z, fixed axes."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)
