"""Footsteps to motion: the linear inverted pendulum walks over the footprints it is given.

The body's weight is a pendulum of constant height above the zero moment point (ZMP) p. Its divergent
part, the capture point xi = c + c'/w, obeys xi' = w (xi - p), and is planned backwards from the end of a
preview in which the step is repeated; the centre of mass follows it, c' = w (xi - c). Between knots the
ZMP is linear in time, so both have closed forms.

One step begins with its double support: a command moves the walking frame, the swing foot is due at its
side of the frame, the weight is shifted onto the other foot (T_DS), and the swing foot flies (T_SS).
Feet and weight are exact here; slip, play and tremble belong to `body`.

Source: seed 000, section 2.1 (footstep command); Kajita et al. 2001 (pendulum); capture point: Pratt 2006.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import WalkCommand

from ..ranges import check_ranges

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True)
class GaitConfig:
    """Measures of the walk and limits of a footstep.

    A command beyond a limit is not refused: the body does what it can of it, and its joints report that.
    """

    tick_s: float = 0.005  # seed 001: control period 5 ms
    stance_width_m: float = 0.090  # DARwIn-OP: two hips of 37 mm, feet set 8 mm wider each
    narrowest_m: float = 0.070  # ours: feet of 66 mm must not touch
    lift_m: float = 0.022  # ours: clears bumps of 1 cm
    com_height_m: float = 0.215  # DARwIn-OP, walking posture
    zmp_inward_m: float = 0.004  # ours: 10 mm was worse in dynamic walking
    preview_steps: int = 4  # ours: the fourth step ahead moves the weight by less than 0.1 mm
    backward_limit_m: float = 0.03  # ours: heels
    forward_limit_m: float = 0.08  # ours: longest step seen stable in dynamic walking
    lateral_limit_m: float = 0.04  # ours
    rescue_back_m: float = 0.10  # ours: limits of a step that answers a push ...
    rescue_forward_m: float = 0.10  # ... which may fail where not to make it would
    turn_limit_deg: float = 14.0  # seed 000: theta_safety
    single_support_s: tuple[float, float] = (
        0.25,
        0.60,
    )  # ours: shortest, longest; dT = 0.2 must fit
    double_support_s: tuple[float, float] = (0.10, 0.80)  # ours

    def __post_init__(self) -> None:
        if not 0.0 < self.tick_s <= 0.02:
            raise ConfigError(f"gait: tick_s={self.tick_s} must lie in (0, 0.02]; 0.005 is usual")
        if not 0.0 < self.narrowest_m <= self.stance_width_m:
            raise ConfigError(
                f"gait: narrowest_m={self.narrowest_m} must lie between 0 and "
                f"stance_width_m={self.stance_width_m}"
            )
        check_ranges(
            "gait",
            self,
            stance_width_m=(0.0, 1.0),
            lift_m=(0.0, 0.3),
            com_height_m=(0.02, 3.0),
            preview_steps=(2.0, 50.0),
            backward_limit_m=(0.0, 1.0),
            forward_limit_m=(0.0, 1.0),
            lateral_limit_m=(0.0, 1.0),
            rescue_back_m=(0.0, 1.0),
            rescue_forward_m=(0.0, 1.0),
            turn_limit_deg=(0.0, 90.0),
            single_support_s=(self.tick_s, 10.0),
            double_support_s=(self.tick_s, 10.0),
        )
        if not abs(self.zmp_inward_m) < self.narrowest_m / 2:
            raise ConfigError(
                f"gait: zmp_inward_m={self.zmp_inward_m} must be less than half of "
                f"narrowest_m={self.narrowest_m}"
            )
        for name in ("single_support_s", "double_support_s"):
            shortest, longest = getattr(self, name)
            if not 0.0 < shortest <= longest:
                raise ConfigError(f"gait: {name}={(shortest, longest)} must be (shortest, longest)")


@dataclass(frozen=True)
class Feet:
    """Both feet on the floor, and the side whose turn it is to swing (+1 left, -1 right)."""

    left: Pose2
    right: Pose2
    swing: int = 1

    def of(self, side: int) -> Pose2:
        """The left foot for +1, the right one for -1."""
        return self.left if side > 0 else self.right

    def placed(self, pose: Pose2) -> Feet:
        """After the swing foot came down there: the other one is next."""
        if self.swing > 0:
            return Feet(pose, self.right, -1)
        return Feet(self.left, pose, 1)


@dataclass(frozen=True, eq=False)
class Step:
    """One step, tick by tick, as the joints make it; arrays of n ticks, the last one at its end.

    Args:
        stepping: Whether a foot swings; False for standing still.
        double_support_ticks: How many of the ticks are double support.
        left, right: Feet, (x, y, yaw), frame of the gait's own dead reckoning, m and rad.
        lift: Height of the swing foot, m.
        swing: Which foot swings, +1 left, -1 right.
        com: Centre of mass on the floor, m.
        com_velocity: m/s.
        body: Body frame, (x, y, yaw): the middle of the feet.
        progress: Share of the step's motion of the body that is done, 0 to 1.
    """

    stepping: bool
    double_support_ticks: int
    left: Float[np.ndarray, "n 3"]
    right: Float[np.ndarray, "n 3"]
    lift: Float[np.ndarray, "n"]
    swing: int
    com: Float[np.ndarray, "n 2"]
    com_velocity: Float[np.ndarray, "n 2"]
    body: Float[np.ndarray, "n 3"]
    progress: Float[np.ndarray, "n"]

    @property
    def ticks(self) -> int:
        """Length of the step."""
        return len(self.progress)


@dataclass(frozen=True, eq=False)
class Phase:
    """A stretch of time over which the ZMP moves evenly from start to end, m."""

    start: Float[np.ndarray, "2"]
    end: Float[np.ndarray, "2"]
    duration_s: float


def capture_point_before(
    after: Float[np.ndarray, "2"],
    phase: Phase,
    remaining_s: float | Float[np.ndarray, "n"],
    omega: float,
) -> Float[np.ndarray, "*n 2"]:
    """The capture point some time before the end of a phase: xi' = w (xi - p) solved backwards.

    Args:
        after: xi at the end of the phase, m.
        phase: How the ZMP moves.
        remaining_s: Time to the end; or times, and the answer has a row for each.
        omega: w = sqrt(g / height), 1/s.
    """
    speed = (phase.end - phase.start) / phase.duration_s
    left = np.asarray(remaining_s)[..., None]
    zmp = phase.end - speed * left
    away = after - phase.end - speed / omega
    return np.asarray(zmp + speed / omega + away * np.exp(-omega * left))


def pendulum(
    position: float, velocity: float, zmp: float, seconds: float, height_m: float
) -> tuple[float, float]:
    """The pendulum over a resting ZMP: position and velocity after some time.

    Source: seed 000, section 3 (x(t) and x'(t), T_c = sqrt(z_c / g)).
    """
    T_c = math.sqrt(height_m / GRAVITY_MPS2)
    c, s = math.cosh(seconds / T_c), math.sinh(seconds / T_c)
    return (
        (position - zmp) * c + T_c * velocity * s + zmp,
        (position - zmp) / T_c * s + velocity * c,
    )


def smooth(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Minimum jerk from 0 to 1 while the share of time goes from 0 to 1."""
    t = np.clip(share, 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


class Gait:
    """Walks step by step from the origin of its own dead reckoning, feet side by side."""

    def __init__(self, config: GaitConfig) -> None:
        self.config = config
        half = config.stance_width_m / 2
        self._frame = Pose2()
        self._feet = Feet(Pose2(0.0, half), Pose2(0.0, -half))
        self._zmp = np.zeros(2)
        self._com = np.zeros(2)
        self._capture = np.zeros(2)
        self._omega = math.sqrt(GRAVITY_MPS2 / config.com_height_m)

    def step(self, command: WalkCommand, astray_m: float = 0.0) -> Step:
        """Take up a command at the start of a double support, and make the whole step.

        A zero command with the feet side by side is standing still: no foot swings. Beyond the limits
        the command is clipped; a sideways step towards the standing foot ends where the feet would touch.

        Args:
            command: Of the footstep.
            astray_m: How far ahead of the plan the weight is being carried: the step goes so much further.
        """
        config = self.config
        double, single = (
            max(1, round(min(max(seconds, low), high) / config.tick_s))
            for seconds, (low, high) in (
                (command.double_support_s, config.double_support_s),
                (command.single_support_s, config.single_support_s),
            )
        )
        frame, target, stepping = self._next(self._frame, self._feet, command, astray_m)
        phases = self._preview(command, double, single, astray_m)
        capture = self._capture_points(phases, double, single)
        com, velocity = self._follow(capture)
        swing = self._feet.swing if stepping else 0
        left, right, lift, progress = self._swing(self._feet, target, stepping, double, single)
        self._frame = frame
        if stepping:
            self._feet = self._feet.placed(target)
        self._zmp = phases[1].end
        return Step(
            stepping,
            double,
            left,
            right,
            lift,
            swing,
            com,
            velocity,
            _middle(left, right),
            progress,
        )

    def land(self, step: Step, tick: int) -> None:
        """The swing foot of this step, the last one made, was put down early, at this tick of it."""
        x, y, yaw = (float(v) for v in (step.left if step.swing > 0 else step.right)[tick])
        self._feet = replace(self._feet, swing=step.swing).placed(Pose2(x, y, yaw))

    def _next(
        self, frame: Pose2, feet: Feet, command: WalkCommand, astray_m: float = 0.0
    ) -> tuple[Pose2, Pose2, bool]:
        """The walking frame after a command, where the swing foot goes, and whether it has to move."""
        config = self.config
        forward = min(max(command.forward_m, -config.backward_limit_m), config.forward_limit_m)
        if astray_m:
            forward = min(max(forward + astray_m, -config.rescue_back_m), config.rescue_forward_m)
        lateral = min(max(command.lateral_m, -config.lateral_limit_m), config.lateral_limit_m)
        limit = math.radians(config.turn_limit_deg)
        turn = min(max(command.turn_rad, -limit), limit)
        side = feet.swing
        stance = feet.of(-side)
        place = Pose2(0.0, side * config.stance_width_m / 2)
        moved = frame @ Pose2(forward, lateral, turn)
        gap = side * (stance.inverse() @ moved @ place).y
        if gap < config.narrowest_m:
            moved = frame @ Pose2(forward, lateral + side * (config.narrowest_m - gap), turn)
        target = moved @ place
        offset = feet.of(side).inverse() @ target
        still = max(abs(offset.x), abs(offset.y), abs(offset.yaw)) < 1e-9
        apart = stance.inverse() @ target @ Pose2(0.0, -side * config.stance_width_m)
        square = max(abs(apart.x), abs(apart.y), abs(apart.yaw)) < 1e-9
        return moved, target, not (still and square)

    def _preview(
        self, command: WalkCommand, double: int, single: int, astray_m: float
    ) -> list[Phase]:
        """How the ZMP moves over this step and the ones after it, the command repeated."""
        tick = self.config.tick_s
        phases: list[Phase] = []
        frame, feet, zmp = self._frame, self._feet, self._zmp
        for _ in range(self.config.preview_steps):
            frame, target, stepping = self._next(frame, feet, command, astray_m)
            astray_m = 0.0
            if stepping:
                side = -feet.swing
                inward = Pose2(0.0, -side * self.config.zmp_inward_m)
                support = feet.of(side) @ inward
                feet = feet.placed(target)
            else:
                support = Pose2(
                    (feet.left.x + feet.right.x) / 2, (feet.left.y + feet.right.y) / 2, frame.yaw
                )
            there = np.array([support.x, support.y])
            phases.append(Phase(zmp, there, double * tick))
            phases.append(Phase(there, there, single * tick))
            zmp = there
        return phases

    def _capture_points(
        self, phases: list[Phase], double: int, single: int
    ) -> Float[np.ndarray, "n 2"]:
        """xi at the start of each tick and at the end of the last, from the end of the preview back.

        A new command makes the plan jump; the difference fades out over the double support.
        """
        tick = self.config.tick_s
        xi = phases[-1].end
        for phase in reversed(phases[2:]):
            xi = capture_point_before(xi, phase, phase.duration_s, self._omega)
        single_xi = capture_point_before(
            xi, phases[1], tick * np.arange(single, -1, -1), self._omega
        )
        double_xi = capture_point_before(
            single_xi[0], phases[0], tick * np.arange(double, 0, -1), self._omega
        )
        capture = np.concatenate([double_xi, single_xi])
        fade = 1.0 - smooth(np.arange(len(capture)) / double)
        return np.asarray(capture + fade[:, None] * (self._capture - capture[0]))

    def _follow(
        self, capture: Float[np.ndarray, "m 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """The centre of mass behind the capture point, given at the m = n + 1 edges of n ticks.

        Exact for a capture point that moves evenly over a tick.
        """
        tick, omega = self.config.tick_s, self._omega
        decay = math.exp(-omega * tick)
        lag = np.diff(capture, axis=0) / (tick * omega)
        drive = capture[1:] - lag - (capture[:-1] - lag) * decay
        x, y = self._com.tolist()
        places = []
        for push_x, push_y in drive.tolist():
            x, y = push_x + x * decay, push_y + y * decay
            places.append((x, y))
        com = np.array(places)
        self._com, self._capture = com[-1], capture[-1]
        return com, omega * (capture[1:] - com)

    def _swing(
        self, feet: Feet, target: Pose2, stepping: bool, double: int, single: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Both feet, the swing foot's height and the share done, at the end of every tick."""
        share = np.maximum(np.arange(1, double + single + 1) - double, 0) / single
        progress = smooth(share) if stepping else np.zeros(double + single)
        rise = smooth(share / 0.45) - smooth((share - 0.55) / 0.45)  # 45 % up, 10 % hold, 45 % down
        start = feet.of(feet.swing)
        change = np.array(
            [target.x - start.x, target.y - start.y, wrap_angle(target.yaw - start.yaw)]
        )
        swinging = start.vector + progress[:, None] * change
        standing = np.tile(feet.of(-feet.swing).vector, (double + single, 1))
        left, right = (swinging, standing) if feet.swing > 0 else (standing, swinging)
        return left, right, self.config.lift_m * rise * float(stepping), progress


def _middle(
    left: Float[np.ndarray, "n 3"], right: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Between the feet: mean position, mean heading the short way round."""
    between = right - left
    between[:, 2] = (between[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return np.asarray(left + between / 2)
