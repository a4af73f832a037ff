"""The robot as planning and perception need it: sizes of the body, limits of gait and head.

The defaults are those of a DARwIn-OP, the robot of seeds 000, 001 and 003. Distances that planning keeps were tuned
on it; they stand as constants beside their use and grow with `RobotModel.breadth` or `RobotModel.leg_scale`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from .errors import ConfigError
from .settings import setting

RADIUS_M, HIP_M = 0.15, 0.2055  # DARwIn-OP: S_r of seed 001; height of the pelvis while walking


@dataclass(frozen=True)
class GaitLimits:
    """Limits of one footstep."""

    cruise_mps: float = setting(
        0.07,
        "m/s",
        "usual walking speed of a DARwIn-OP; grows with the legs",
        "ours: at 0.0615 m/s (seed 000: 0.04 m a step) goals that change with time are missed",
    )
    max_speed_mps: float = setting(
        0.10, "m/s", "top speed of a DARwIn-OP; grows with the legs", "ours: 65 mm a step"
    )
    max_back_mps: float = 0.03  # ours: backward steps of 19.5 mm
    max_side_mps: float = 0.03  # ours: side steps of 19.5 mm
    max_turn_deg: float = setting(
        14.0, "deg", "largest change of heading in one step", "seed 000: theta_safety"
    )
    single_support_s: float = setting(0.30, "s", "duration of single support", "seed 000: T_SS")
    double_support_s: float = setting(0.35, "s", "duration of double support", "seed 000: T_DS")

    def __post_init__(self) -> None:
        for name in ("cruise_mps", "max_speed_mps", "max_turn_deg", "single_support_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"gait: {name}={value} must be positive and finite")
        for name in ("max_back_mps", "max_side_mps", "double_support_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"gait: {name}={value} must be finite and not negative")
        if self.cruise_mps > self.max_speed_mps:
            raise ConfigError(
                f"gait: cruise_mps={self.cruise_mps} is above max_speed_mps={self.max_speed_mps}; lower it"
            )

    @property
    def step_s(self) -> float:
        """Duration of one step."""
        return self.single_support_s + self.double_support_s

    @property
    def max_turn_rad(self) -> float:
        """Largest change of heading in one step."""
        return math.radians(self.max_turn_deg)

    def scaled(self, factor: float) -> GaitLimits:
        """The limits of legs longer by a factor: speeds grow in proportion, turns and times stay."""
        speeds = ("cruise_mps", "max_speed_mps", "max_back_mps", "max_side_mps")
        return replace(self, **{name: factor * getattr(self, name) for name in speeds})


@dataclass(frozen=True)
class HeadLimits:
    """Range and speed of the neck.

    Args:
        pan_deg: Range to each side.
        tilt_deg: Highest and lowest tilt, down positive.
        speed_radps: Top speed of both joints.
    """

    pan_deg: float = 90.0  # ours, for the head of seed 001
    tilt_deg: tuple[float, float] = (0.0, 60.0)  # ours, likewise
    speed_radps: float = 4.0  # ours: MX-28 servo under load

    def __post_init__(self) -> None:
        if not 0.0 < self.pan_deg <= 180.0:
            raise ConfigError(f"head: pan_deg={self.pan_deg} must lie in (0, 180]")
        if not self.tilt_deg[0] < self.tilt_deg[1] <= 85.0:
            raise ConfigError(f"head: tilt_deg={self.tilt_deg} must be (highest, lowest), below 85")
        if not self.speed_radps > 0.0:
            raise ConfigError(f"head: speed_radps={self.speed_radps} must be positive")


@dataclass(frozen=True)
class StepLimits:
    """What the legs reach from one level of the ground to another; 0 where a robot does not leave its level.

    Args:
        up_m, down_m: Largest height of the foot that lands above and below the one that stands.
        reach_m: Largest step ahead to another level: of the frame midway between the feet, as of every footstep.
    """

    up_m: float = 0.0
    down_m: float = 0.0
    reach_m: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"steps: {name}={value} must be finite and not negative")

    def scaled(self, factor: float) -> StepLimits:
        """The limits of legs longer by a factor."""
        return StepLimits(factor * self.up_m, factor * self.down_m, factor * self.reach_m)


DARWIN_STEPS = StepLimits(0.05, 0.05, 0.15)
"""Ours, by walks of its dynamic body: experiment `stairs-walk`; with a reach of 0.17 m it falls."""


@dataclass(frozen=True)
class RobotModel:
    """Sizes of a humanoid and limits of its gait and head; lengths in m.

    Args:
        radius_m: S_r, of the circle round the trunk that planning keeps free.
        width_m, depth_m: Of the trunk with the arms, left to right and front to back.
        height_m: Of the standing robot.
        passage_width_m: w_r, width by which a gap is judged: trunk, swinging arms and sway.
        foot_m: Length and width of a foot.
        eye_m: Height of the camera while the head is tilted down and the robot walks.
        hip_m: Height of the pelvis while walking, which sets the scale of the steps.
        stance_m: Distance of the feet side by side, from middle to middle.
        gait: Limits of a footstep.
        steps: Limits of one to another level.
        head: Limits of the neck.
    """

    radius_m: float = RADIUS_M
    width_m: float = 0.164  # seed 000
    depth_m: float = 0.110  # seed 000
    height_m: float = 0.46
    passage_width_m: float = 0.30  # seed 004
    foot_m: tuple[float, float] = (0.104, 0.066)
    eye_m: float = 0.38
    hip_m: float = HIP_M
    stance_m: float = 0.090
    gait: GaitLimits = field(default_factory=GaitLimits)
    steps: StepLimits = DARWIN_STEPS
    head: HeadLimits = field(default_factory=HeadLimits)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name.endswith("_m") and not all(
                math.isfinite(v) and v > 0.0
                for v in (value if isinstance(value, tuple) else (value,))
            ):
                raise ConfigError(f"robot model: {name}={value} must be positive and finite")

    @property
    def breadth(self) -> float:
        """Radius relative to a DARwIn-OP's, the scale of the distances kept from obstacles."""
        return self.radius_m / RADIUS_M


DARWIN_OP = RobotModel()
"""The robot of seeds 000, 001 and 003."""
