"""Footsteps: a desired heading and speed as one step within the limits of the gait.

Source: seed 000, section 2.1 (the command and its limits); seed 001, section 4 (heading and speed to
footstep); slowing down in turns is ours.
"""

from __future__ import annotations

import math

from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import GaitLimits

from .commands import WalkCommand


def limited_step(
    gait: GaitLimits, forward_mps: float, left_mps: float, turn_rad: float
) -> WalkCommand:
    """The step for given speeds and turn, each clipped to its limit."""
    forward = min(max(forward_mps, -gait.max_back_mps), gait.max_speed_mps)
    left = min(max(left_mps, -gait.max_side_mps), gait.max_side_mps)
    turn = min(max(turn_rad, -gait.max_turn_rad), gait.max_turn_rad)
    return WalkCommand(
        forward * gait.step_s,
        left * gait.step_s,
        turn,
        gait.single_support_s,
        gait.double_support_s,
    )


def half_a_step_on(robot: Pose2, last: WalkCommand) -> Pose2:
    """The pose at which the next step begins to move the body, which follows its feet by half a step.

    Args:
        robot: Pose at the end of the last step.
        last: The last step.
    """
    return robot @ Pose2(last.forward_m / 2, last.lateral_m / 2, last.turn_rad / 2)


def footstep(
    heading_rad: float,
    speed_mps: float,
    robot: Pose2,
    gait: GaitLimits,
    away_m: float = math.inf,
) -> WalkCommand:
    """The next step towards a heading at a speed.

    The robot turns as far as one step allows. The speed falls with the cosine of the remaining heading error;
    from 90 degrees on the robot turns on the spot. No step is longer than the target is far, and near a target the steps of a
    turn are so short that their circle is half as wide as the target is far: else the robot would pass it, or go round it, for
    ever.

    Args:
        heading_rad: Desired direction of walking, world frame.
        speed_mps: Desired speed, negative for backwards; clipped to the limits.
        robot: Present pose, world frame.
        gait: Limits of a step.
        away_m: Distance to the target, m.
    """
    error = wrap_angle(heading_rad - robot.yaw)
    turn = min(max(error, -gait.max_turn_rad), gait.max_turn_rad)
    slowed = min(speed_mps, away_m / gait.step_s) * max(0.0, math.cos(error - turn))
    if turn != error:
        slowed = min(slowed, away_m / 2.0 * gait.max_turn_rad / gait.step_s)
    return limited_step(gait, slowed, 0.0, turn)
