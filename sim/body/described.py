"""Gait, head and sizes for contact of a robot that is described, in place of those of our own."""

from __future__ import annotations

from dataclasses import replace

from ..robots.description import Description
from .dynamic.anatomy import DARWIN, Anatomy
from .gait import GaitConfig
from .head import HeadConfig


def gait_of(robot: Description, gait: GaitConfig) -> GaitConfig:
    """The gait with the lengths, times and limits of a robot."""
    limits, walk = robot.model.gait, robot.walk
    return replace(
        gait,
        stance_width_m=walk.stance_m,
        narrowest_m=walk.narrowest_m,
        lift_m=walk.lift_m,
        com_height_m=walk.com_m,
        backward_limit_m=limits.max_back_mps * limits.step_s,
        reach_m=max(robot.model.steps.reach_m, limits.max_speed_mps * limits.step_s),
        forward_limit_m=limits.max_speed_mps * limits.step_s,
        slow=1.0,
        lateral_limit_m=limits.max_side_mps * limits.step_s,
        turn_limit_deg=limits.max_turn_deg,
        single_support_s=_spanned(gait.single_support_s, limits.single_support_s),
        double_support_s=_spanned(gait.double_support_s, limits.double_support_s),
    )


def head_of(robot: Description, head: HeadConfig) -> HeadConfig:
    """The head with the ranges and the speed of a robot's gaze joints."""
    limits = robot.model.head
    return replace(
        head, pan_deg=limits.pan_deg, tilt_deg=limits.tilt_deg, speed_radps=limits.speed_radps
    )


def measures_of(robot: Description) -> Anatomy:
    """Trunk with arms from the middle of the legs up, and the soles."""
    model = robot.model
    bottom_m = model.hip_m / 2
    return replace(
        DARWIN,
        hip_m=model.hip_m,
        trunk_m=(model.depth_m, model.width_m, model.height_m - bottom_m),
        trunk_bottom_m=bottom_m,
        foot_m=(*model.foot_m, DARWIN.foot_m[2]),
        ankle_m=max(abs(robot.legs.sole_m[2]), DARWIN.ankle_m),
        foot_outward_m=0.0,
    )


def _spanned(span: tuple[float, float], value: float) -> tuple[float, float]:
    """The span, widened to contain a value."""
    return min(span[0], value), max(span[1], value)
