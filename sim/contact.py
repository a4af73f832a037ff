"""Contact between the robot and objects: its solid (trunk and feet as upright boxes) and the distance to shapes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.primitives.pose import Pose2

from .body.body import Body
from .body.dynamic.anatomy import Anatomy
from .shapes import Box, Cylinder, Shape, convex_gap, distance, outline


@dataclass(frozen=True)
class Nearest:
    """The nearest object and the distance to it, m; zero or less means contact."""

    gap_m: float
    name: str


def robot_solid(body: Body, measures: Anatomy) -> tuple[Box, ...]:
    """True trunk, and feet up to the ankle, world frame."""
    x, y, _ = body.true_trunk().position
    trunk = body.true_pose @ Pose2(float(x), float(y))
    bottom_m = body.true_height_m + measures.trunk_bottom_m
    boxes = [_upright(trunk, measures.trunk_m, bottom_m)]
    foot_m = (measures.foot_m[0], measures.foot_m[1], measures.ankle_m)
    for side, (foot, lift) in zip((1, -1), body.feet_body, strict=True):
        sole = body.true_pose @ foot @ Pose2(0.0, side * measures.foot_outward_m)
        boxes.append(_upright(sole, foot_m, body.true_height_m + lift))
    return tuple(boxes)


def nearest(solid: Sequence[Box], shapes: Sequence[tuple[str, Shape]]) -> Nearest:
    """The shape nearest to the solid; shapes touch only where their heights overlap.

    Exact for upright prisms.
    """
    best = Nearest(float("inf"), "nothing")
    for name, shape in shapes:
        reach = _reach(shape)
        for box in solid:
            apart = math.dist(box.centre[:2], shape.centre[:2]) - reach - _reach(box)
            if apart < best.gap_m and shape.bottom_m < box.top_m and box.bottom_m < shape.top_m:
                gap = _gap(box, shape)
                if gap < best.gap_m:
                    best = Nearest(gap, name)
    return best


def _reach(shape: Shape) -> float:
    """Radius of a circle about the centre that contains the outline, for a fast rejection."""
    if isinstance(shape, Cylinder):
        return shape.radius
    if isinstance(shape, Box):
        return math.hypot(shape.size[0], shape.size[1]) / 2
    return float(np.max(np.hypot(*(outline(shape) - np.array(shape.centre[:2])).T)))


def _gap(box: Box, shape: Shape) -> float:
    if isinstance(shape, Cylinder):
        return float(distance(box, np.array([shape.centre[:2]]))[0]) - shape.radius
    return convex_gap(outline(box), outline(shape))


def _upright(pose: Pose2, size: tuple[float, float, float], bottom_m: float) -> Box:
    return Box((pose.x, pose.y, bottom_m + size[2] / 2), size, pose.yaw)
