"""Gait: the linear inverted pendulum walks over the commanded footprints.

The body is a pendulum over the zero moment point (`pendulum`). Its capture point xi is computed backwards from the end of a
preview that repeats the step, and the centre of mass follows it: c' = w (xi - c). Between knots the ZMP is linear in time, so
both have closed forms.

A step starts with its double support: the command moves the walking frame, the weight shifts onto the stance foot
(T_DS), then the swing foot moves to its side of the frame (T_SS). To another level it rises first, above the higher of both
levels, then moves ahead, then comes down. The trajectories are exact; slip, backlash and sway
belong to the bodies.

Source: Han et al. 2018 (seed 000), section 2.1 (footstep command); Kajita et al. 2001 (pendulum).
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
from .pendulum import GRAVITY_MPS2, Phase, capture_point_before

EDGE = 0.25
"""Ours: on the way to another level, share of the swing before and after the forward motion of the foot."""
PREVIEW_STEPS = 4  # ours: the fourth step ahead moves the centre of mass by less than 0.1 mm


@dataclass(frozen=True)
class GaitConfig:
    """Dimensions of the walk and limits of a footstep.

    A command beyond a limit is clipped, and the odometry reports the clipped step. Lengths scale with the body.
    """

    tick_s: float = 0.005  # seed 001: control period 5 ms
    stance_width_m: float = 0.090  # DARwIn-OP: hips 37 mm from the middle, feet 8 mm further out
    narrowest_m: float = 0.070  # ours: soles of 66 mm must not touch
    lift_m: float = 0.022  # ours: clears bumps of 1 cm
    com_height_m: float = 0.215  # DARwIn-OP, walking posture
    zmp_inward_m: float = 0.004  # ours: 10 mm was worse in dynamic walking
    backward_limit_m: float = 0.03  # ours: heels
    forward_limit_m: float = 0.08  # ours: longest stable step in dynamic walking trials
    reach_m: float = 0.15  # ours: longest step to another level; with 0.17 the dynamic body falls
    lateral_limit_m: float = 0.04  # ours
    slow: float = 2.0  # ours: how many times as long a step from, or to, another level takes; in the time of a level one the dynamic body falls
    rescue_back_m: float = 0.10  # ours: limits of a recovery step after a push
    rescue_forward_m: float = 0.10  # ours
    turn_limit_deg: float = 14.0  # seed 000: theta_safety
    single_support_s: tuple[float, float] = (
        0.25,
        0.60,
    )  # ours: the image interval of seed 000, 0.2 s, must fit; shortest and longest single support that the body executes
    double_support_s: tuple[float, float] = (
        0.10,
        0.80,
    )  # ours; shortest and longest double support that the body executes

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
            backward_limit_m=(0.0, 1.0),
            forward_limit_m=(0.0, 1.0),
            reach_m=(0.0, 1.0),
            slow=(0.1, 10.0),
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
    """Both feet on the floor, the side that swings next (+1 left, -1 right), and the heights of their ground, m."""

    left: Pose2
    right: Pose2
    swing: int = 1
    left_m: float = 0.0
    right_m: float = 0.0

    def of(self, side: int) -> Pose2:
        """The left foot for +1, the right foot for -1."""
        return self.left if side > 0 else self.right

    def height_of(self, side: int) -> float:
        """Height of the ground below the left foot for +1, the right foot for -1."""
        return self.left_m if side > 0 else self.right_m

    def placed(self, pose: Pose2, height_m: float = 0.0) -> Feet:
        """The feet after the swing foot landed at a pose and height."""
        if self.swing > 0:
            return Feet(pose, self.right, -1, height_m, self.right_m)
        return Feet(self.left, pose, 1, self.left_m, height_m)


@dataclass(frozen=True, eq=False)
class Step:
    """Trajectories of one step, one row per tick, the last row at its end.

    Args:
        stepping: Whether a foot swings; False for standing.
        double_support_ticks: Ticks of double support.
        left, right: Feet, (x, y, yaw), frame of the gait's own dead reckoning, m and rad.
        lift: Height of the swing foot above `left_m` or `right_m`, m.
        swing: Swing foot, +1 left, -1 right, 0 none.
        com: Centre of mass projected on the floor, m.
        com_velocity: Its velocity, m/s.
        body: Body frame midway between the feet, (x, y, yaw).
        progress: Completed share of the step's motion, 0 to 1.
        left_m, right_m: Heights of the feet without the lift: from one ground to the next with the progress, m.
        body_m: Height of the body frame, midway between these.
        lowered_m: By how much the pelvis is lower than on flat ground, so that the lower leg is no longer.
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
    left_m: Float[np.ndarray, "n"]
    right_m: Float[np.ndarray, "n"]
    body_m: Float[np.ndarray, "n"]
    lowered_m: Float[np.ndarray, "n"]

    @property
    def ticks(self) -> int:
        """Number of ticks of the step."""
        return len(self.progress)


def smooth(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Minimum-jerk profile from 0 to 1 for a share of time from 0 to 1."""
    t = np.clip(share, 0.0, 1.0)
    return np.asarray(t * t * t * (10.0 - 15.0 * t + 6.0 * t * t))


def behind(
    capture: Float[np.ndarray, "m 2"], com: Float[np.ndarray, "2"], omega: float, tick_s: float
) -> Float[np.ndarray, "n 2"]:
    """Centre of mass behind a capture point given at the m = n + 1 edges of n ticks, from its place before them.

    Exact for a capture point that moves linearly within a tick.
    """
    decay = math.exp(-omega * tick_s)
    lag = np.diff(capture, axis=0) / (tick_s * omega)
    drive = capture[1:] - lag - (capture[:-1] - lag) * decay
    x, y = com.tolist()
    places = []
    for push_x, push_y in drive.tolist():
        x, y = push_x + x * decay, push_y + y * decay
        places.append((x, y))
    return np.array(places)


class Gait:
    """Generates step after step from the origin of its own dead reckoning, starting with the feet side by side."""

    def __init__(self, config: GaitConfig, start_s: float = 0.0) -> None:
        """Stand.

        Args:
            config: Dimensions and limits.
            start_s: Double support of a step out of standing; 0: as commanded.
        """
        self.config = config
        self._start = round(start_s / config.tick_s)
        self._stood = True
        half = config.stance_width_m / 2
        self._frame = Pose2()
        self._feet = Feet(Pose2(0.0, half), Pose2(0.0, -half))
        self._zmp = np.zeros(2)
        self._com = np.zeros(2)
        self._capture = np.zeros(2)
        self._omega = math.sqrt(GRAVITY_MPS2 / config.com_height_m)

    def landing(self, command: WalkCommand) -> tuple[Pose2, Pose2]:
        """The body frame and the swing foot after a command, frame of the gait's own dead reckoning."""
        target = self._next(self._frame, self._feet, command)[1]
        x, y, yaw = _middle(self._feet.of(-self._feet.swing).vector[None], target.vector[None])[0]
        return Pose2(float(x), float(y), float(yaw)), target

    def step(
        self, command: WalkCommand, extension_m: float = 0.0, height_m: float | None = None
    ) -> Step:
        """Execute a command from the start of a double support to the end of the step.

        A zero command with the feet side by side means standing: no foot swings. Commands beyond the limits are
        clipped; a lateral step towards the stance foot ends where the feet would touch.

        Args:
            command: Footstep command.
            extension_m: Forward extension of the step after a push.
            height_m: Of the ground where the foot lands, dead reckoning; None: as commanded.
        """
        config = self.config
        before = self._feet
        wanted = before.height_of(-before.swing) + command.rise_m
        lands = wanted if height_m is None else height_m
        level = before.left_m == before.right_m == wanted == lands
        slow = 1.0 if level else config.slow
        if not level:
            extension_m = 0.0  # to another level a foot lands where it is told
        double, single = (
            max(1, round(min(max(slow * seconds, low), high) / config.tick_s))
            for seconds, (low, high) in (
                (command.double_support_s, config.double_support_s),
                (command.single_support_s, config.single_support_s),
            )
        )
        frame, target, stepping = self._next(self._frame, self._feet, command, extension_m)
        rhythm = double
        if self._start and stepping and self._stood:
            double = self._start
        self._stood = not stepping
        phases = self._preview(command, double, rhythm, single, extension_m)
        capture = self._capture_points(phases, double, single)
        com, velocity = self._follow(capture)
        swing = before.swing if stepping else 0
        left, right, lift, progress = self._swing(before, target, stepping, double, single, level)
        self._frame = frame
        if stepping:
            self._feet = before.placed(target, lands)
        heights = _heights(before, self._feet, progress)
        if stepping and not level:
            lift = _over(
                before.height_of(before.swing),
                max(wanted, lands),
                lands,
                single,
                double,
                config.lift_m,
            )
            lift -= heights[0 if swing > 0 else 1]
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
            *heights,
        )

    def land(self, step: Step, tick: int) -> None:
        """Register that the swing foot of the last step landed early, at this tick."""
        x, y, yaw = (float(v) for v in (step.left if step.swing > 0 else step.right)[tick])
        height_m = self._feet.height_of(step.swing)
        self._feet = replace(self._feet, swing=step.swing).placed(Pose2(x, y, yaw), height_m)

    def _next(
        self, frame: Pose2, feet: Feet, command: WalkCommand, extension_m: float = 0.0
    ) -> tuple[Pose2, Pose2, bool]:
        """Walking frame after a command, target of the swing foot, and whether that foot has to move."""
        config = self.config
        if command.stay:
            return frame, feet.of(feet.swing), False
        longest = config.reach_m if command.rise_m else config.forward_limit_m
        forward = min(max(command.forward_m, -config.backward_limit_m), longest)
        if extension_m:
            forward = min(
                max(forward + extension_m, -config.rescue_back_m), config.rescue_forward_m
            )
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
        self, command: WalkCommand, double: int, rhythm: int, single: int, extension_m: float
    ) -> list[Phase]:
        """Motion of the ZMP over this step and the previewed ones, which repeat the command in their rhythm."""
        tick = self.config.tick_s
        phases: list[Phase] = []
        frame, feet, zmp = self._frame, self._feet, self._zmp
        for _ in range(PREVIEW_STEPS):
            frame, target, stepping = self._next(frame, feet, command, extension_m)
            extension_m = 0.0
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
            zmp, double = there, rhythm
        return phases

    def _capture_points(
        self, phases: list[Phase], double: int, single: int
    ) -> Float[np.ndarray, "n 2"]:
        """Capture point at the start of each tick and at the end of the last, from the end of the preview backwards.

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
        """Centre of mass behind a capture point, and its velocity."""
        com = behind(capture, self._com, self._omega, self.config.tick_s)
        self._com, self._capture = com[-1], capture[-1]
        return com, self._omega * (capture[1:] - com)

    def _swing(
        self, feet: Feet, target: Pose2, stepping: bool, double: int, single: int, level: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Left foot, right foot, height of the swing foot and completed share at the end of every tick."""
        share = np.maximum(np.arange(1, double + single + 1) - double, 0) / single
        ahead = share if level else (share - EDGE) / (1.0 - 2.0 * EDGE)
        progress = smooth(ahead) if stepping else np.zeros(double + single)
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
    """Midway between the feet: mean position and mean heading."""
    between = right - left
    between[:, 2] = (between[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return np.asarray(left + between / 2)


def _heights(
    before: Feet, after: Feet, progress: Float[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Heights of left and right foot and of the body, and by how much the pelvis is lowered."""
    left = before.left_m + progress * (after.left_m - before.left_m)
    right = before.right_m + progress * (after.right_m - before.right_m)
    first, last = abs(before.left_m - before.right_m), abs(after.left_m - after.right_m)
    return left, right, (left + right) / 2, (first + progress * (last - first)) / 2


def _over(
    start_m: float, edge_m: float, end_m: float, single: int, double: int, lift_m: float
) -> Float[np.ndarray, "n"]:
    """Height of a foot that goes from one level to another, clear of the higher one."""
    share = np.maximum(np.arange(1, double + single + 1) - double, 0) / single
    top_m = max(start_m, edge_m) + lift_m
    up, down = smooth(share / 0.45), smooth((share - 0.55) / 0.45)
    return np.asarray(start_m + (top_m - start_m) * up - (top_m - end_m) * down)
