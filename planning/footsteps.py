"""Footsteps: a desired heading and speed as one step that the gait can make.

Source: seed 000, section 2.1 (the command and its limits); seed 001, section 4 (heading and speed to
footstep); slowing down in turns is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle

from .commands import WalkCommand


@dataclass(frozen=True)
class GaitConfig:
    """What one footstep can do."""

    cruise_mps: float = 0.07  # own: at 0.0615 (seed 000: 0.04 m a step) goals are late
    max_speed_mps: float = 0.10  # own (specification): top speed, 65 mm a step
    max_back_mps: float = 0.03  # own: back steps of 19.5 mm
    max_side_mps: float = 0.03  # own: side steps of 19.5 mm
    max_turn_deg: float = 14.0  # theta_safety, seed 000
    single_support_s: float = 0.30  # T_SS, seed 000
    double_support_s: float = 0.35  # T_DS, seed 000

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
        """Time of one step."""
        return self.single_support_s + self.double_support_s

    @property
    def max_turn_rad(self) -> float:
        """Greatest turn of one step."""
        return math.radians(self.max_turn_deg)

    def command(self, forward_mps: float, left_mps: float, turn_rad: float) -> WalkCommand:
        """The step for given speeds, each brought within its limit."""
        forward = min(max(forward_mps, -self.max_back_mps), self.max_speed_mps)
        left = min(max(left_mps, -self.max_side_mps), self.max_side_mps)
        turn = min(max(turn_rad, -self.max_turn_rad), self.max_turn_rad)
        return WalkCommand(
            forward * self.step_s,
            left * self.step_s,
            turn,
            self.single_support_s,
            self.double_support_s,
        )


def half_a_step_on(robot: Pose2, last: WalkCommand) -> Pose2:
    """Where the body will be when the step now asked for begins to move it: it follows its feet half a step later.

    Args:
        robot: Where it is while its last step ends.
        last: That step.
    """
    return robot @ Pose2(last.forward_m / 2, last.lateral_m / 2, last.turn_rad / 2)


def footstep(heading_rad: float, speed_mps: float, robot: Pose2, config: GaitConfig) -> WalkCommand:
    """The next step towards a heading at a speed.

    The robot turns as far as one step allows. While the heading is farther off than that, it slows down:
    by the cosine of what is left, to turning on the spot from 90 degrees on.

    Args:
        heading_rad: Desired direction of walking, world frame.
        speed_mps: Desired speed, negative: backwards; brought within the gait's limits.
        robot: Where it stands.
        config: The gait's limits.
    """
    error = wrap_angle(heading_rad - robot.yaw)
    turn = min(max(error, -config.max_turn_rad), config.max_turn_rad)
    slowed = speed_mps * max(0.0, math.cos(error - turn))
    return config.command(slowed, 0.0, turn)
