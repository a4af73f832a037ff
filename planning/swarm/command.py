"""The best pixel as a footstep: turn as far as one step allows, and forward; or turn on the spot without a free pixel.

Source: Han 2018 (seed 000), section 5, eq. (10), C_w,penalty; slowing down in turns is ours (`footsteps`).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import GaitLimits

from ..commands import WalkCommand
from ..footsteps import footstep, limited_step

PRINTED_STEP_M = 0.04  # S_F, seed 000


def angle_to(place: Float[np.ndarray, "2"], robot: Pose2) -> float:
    """theta_p: direction of a place relative to the heading, left positive, in [-pi, pi) rad.

    Source: seed 000, eq. (7), with the missing subscript and the heading of the robot.
    """
    return wrap_angle(math.atan2(place[1] - robot.y, place[0] - robot.x) - robot.yaw)


def towards(place: Float[np.ndarray, "2"], robot: Pose2, gait: GaitLimits) -> WalkCommand:
    """C_w: a step at cruising speed to the place, turned by at most theta_safety.

    Args:
        place: P_best on the floor, world frame, m.
        robot: Pose, world frame.
        gait: Cruising speed and limits.

    Source: seed 000, eq. (10).
    """
    away_m = math.hypot(place[0] - robot.x, place[1] - robot.y)
    speed_mps = min(gait.cruise_mps, away_m / gait.step_s)  # the floor beyond was not checked
    return footstep(robot.yaw + angle_to(place, robot), speed_mps, robot, gait)


def published(place: Float[np.ndarray, "2"], robot: Pose2, gait: GaitLimits) -> WalkCommand:
    """The step of the paper: always 0.04 m, turned by at most theta_safety towards the place.

    Source: seed 000, eq. (10), with the heading of the robot.
    """
    return limited_step(gait, PRINTED_STEP_M / gait.step_s, 0.0, angle_to(place, robot))


def printed(place: Float[np.ndarray, "2"], robot: Pose2, gait: GaitLimits) -> WalkCommand:
    """The printed form, for comparison: always 0.04 m, by an angle without the heading of the robot.

    The angle is relative to the y axis, positive to the right in print. Its "atan(x / y)" is read as the arc tangent of
    two arguments here and in the objective (eq. (7)): that of a ratio takes a place behind for one ahead.

    Source: seed 000, eq. (10) as printed.
    """
    turn = -math.atan2(place[0] - robot.x, place[1] - robot.y)
    turn = min(max(turn, -gait.max_turn_rad), gait.max_turn_rad)
    return limited_step(gait, PRINTED_STEP_M / gait.step_s, 0.0, turn)


def turning(
    goal: Float[np.ndarray, "2"], robot: Pose2, gait: GaitLimits, literal: bool = False
) -> WalkCommand:
    """C_w,penalty: turn on the spot towards the goal; in the printed form always by +14 deg.

    Source: seed 000, section 5; the sign is ours.
    """
    if literal:
        return limited_step(gait, 0.0, 0.0, gait.max_turn_rad)
    return limited_step(gait, 0.0, 0.0, math.copysign(gait.max_turn_rad, angle_to(goal, robot)))
