"""The robot model of a configured body.

A robot that is described by a URDF has the sizes of its description. Of our own, the kinematic body, too, has those of
`robot.dynamic.anatomy` and `robot.dynamic.scale`. Lengths that planning was tuned with on a DARwIn-OP grow with the circle
round the trunk or with the legs.
"""

from __future__ import annotations

import math
from dataclasses import replace

from perception.primitives.robot_model import (
    DARWIN_OP,
    DARWIN_STEPS,
    GaitLimits,
    HeadLimits,
    RobotModel,
)
from sim.body.dynamic.anatomy import DARWIN, Anatomy, gait_for
from sim.robot import RobotConfig


def model_of(robot: RobotConfig, gait: GaitLimits) -> RobotModel:
    """Sizes and limits of a body.

    Args:
        robot: The body.
        gait: Limits of a step: of a described robot its own, else for legs of a DARwIn-OP.
    """
    found = robot.described
    if found is not None:
        return found.model if gait == GaitLimits() else replace(found.model, gait=gait)
    body, plain = robot.dynamic.body, DARWIN_OP
    breadth = math.hypot(*body.trunk_m[:2]) / math.hypot(*DARWIN.trunk_m[:2])
    legs = body.hip_m / DARWIN.hip_m
    return RobotModel(
        radius_m=breadth * plain.radius_m,
        width_m=body.trunk_m[1],
        depth_m=body.trunk_m[0],
        height_m=_top(body) / _top(DARWIN) * plain.height_m,
        passage_width_m=robot.dynamic.scale * plain.passage_width_m,
        foot_m=body.foot_m[:2],
        eye_m=legs * plain.eye_m,
        hip_m=body.hip_m,
        stance_m=gait_for(body, robot.gait).stance_width_m,
        gait=gait.scaled(legs),
        steps=DARWIN_STEPS.scaled(legs),
        head=HeadLimits(robot.head.pan_deg, robot.head.tilt_deg, robot.head.speed_radps),
    )


def _top(body: Anatomy) -> float:
    return body.trunk_bottom_m + body.trunk_m[2]
