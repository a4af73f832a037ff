"""The two environments of seed 000: a room with three moving robots and five goals, and a narrow course.

The paper specifies the room completely: size, segments of the robots d1 to d3, their speed and reversal times, and the
time of each goal. The world draws the phase of each robot, or uses the printed start (`printed_room`). Of the course
the paper gives only "polygons and hemispheres" and the walked length; gates and positions are ours. The y axis points
ahead, as in the paper.

Source: seed 000, sections 6.1, 6.2, 6.5.1 and 6.5.2.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from perception.primitives.pose import Pose2

from ..scene import MovingObject, Place, Scene, StaticObject
from ..shapes import Box, Cylinder, Shape
from .rooms import scene_with_tags, walls

GOAL_TIMES_S = {
    "robots_room": (0.0, 70.0, 130.0, 150.0, 200.0),  # seed 000, section 6.5.1
    "printed_room": (0.0, 70.0, 130.0, 150.0, 200.0),
    "narrow_course": (0.0, 18.0, 38.0),  # ours: each changes before it is reached
}
"""Time from which each goal of a scene is active, s after the start."""

COURSE_M = 4.96  # seed 000, section 6.5.2: 124 steps of 0.04 m
EPUCK_RADIUS_M, EPUCK_HEIGHT_M = 0.037, 0.055  # robots d1 to d3 of seed 000
GATES = ((1.0, 0.50), (1.8, 0.80), (2.6, 0.50), (3.4, 0.80))  # ours: centres of the gates, m
HALF_GATE_M = 0.235  # ours: the robot is 0.164 m wide


def robots_room(seed: int) -> Scene:
    """Room of 4 x 5.6 m; d1 moves along x, d2 along y, d3 diagonally, all at 0.06 m/s.

    Source: seed 000, sections 6.1 and 6.2; d1 starts towards -x, since it would leave the room otherwise.
    """
    extent = (-2.0, -0.8, 2.0, 4.8)
    moving_objects = (
        _epuck("d1", (0.6, 1.1), math.pi, 25.0, "teal"),
        _epuck("d2", (0.0, 0.7), math.pi / 2, 18.0, "violet"),
        _epuck("d3", (-0.2, 3.3), math.pi / 4, 18.0, "leaf"),
    )
    return scene_with_tags(
        "robots_room",
        seed,
        extent,
        "planks/oak",
        walls(extent, ("wall/sage", "wall/sky", "wall/cream", "wall/sky")),
        moving_objects,
        Pose2(0.0, -0.3, math.pi / 2),
        ((0.0, 4.0), (-1.0, -0.2), (1.0, 0.1), (-1.0, 4.0), (1.0, 0.0)),
        low=True,
    )


def printed_room(seed: int) -> Scene:
    """The same with every robot at its printed start; the seed draws only the textures."""
    room = robots_room(seed)
    moving_objects = tuple(
        replace(moving_object, phase_s=0.0) for moving_object in room.moving_objects
    )
    return replace(room, name="printed_room", moving_objects=moving_objects)


def narrow_course(seed: int) -> Scene:
    """A corridor of 1.3 m with four gates between polygons and hemispheres, alternately left and right.

    The path from the start through the gates to the last goal is 4.96 m long. The seed mirrors the course and rotates
    the polygons.
    """
    rng = np.random.default_rng([seed, 4])
    width = 1.3
    mirrored = bool(rng.integers(2))

    def place(x: float, y: float) -> Place:
        return x, width - y if mirrored else y

    start = (0.3, 0.65)
    path = np.array([start, *GATES])
    walked = float(np.hypot(*np.diff(path, axis=0).T).sum())
    end = (GATES[-1][0] + math.sqrt((COURSE_M - walked) ** 2 - 0.15**2), 0.65)
    extent = (-0.2, 0.0, end[0] + 0.6, width)
    static_objects = list(walls(extent, ("wall/sky", "wall/sage", "wall/cream", "wall/sky")))
    colours = ("teal", "plum", "navy", "leaf")
    for k, (x, y) in enumerate(GATES):
        turn = float(rng.uniform(0.0, math.pi))
        corners, radius = (6, 8, 4, 6)[k], 0.15
        low, high = y - HALF_GATE_M - radius, y + HALF_GATE_M + radius
        dome, prism = (low, high) if k % 2 else (high, low)
        static_objects.append(
            StaticObject(f"hemisphere {k + 1}", hemisphere(place(x, dome), radius, colours[k]))
        )
        static_objects.append(
            StaticObject(
                f"polygon {k + 1}",
                polygon(place(x, prism), radius, corners, turn, 0.2, colours[k - 1]),
            )
        )
    goals = tuple(place(*goal) for goal in ((2.2, 0.65), (3.9, 0.65), end))
    return scene_with_tags(
        "narrow_course",
        seed,
        extent,
        "planks/oak",
        tuple(static_objects),
        (),
        Pose2(*place(*start), 0.0),
        goals,
        low=True,
    )


def hemisphere(centre: Place, radius: float, colour: str) -> tuple[Shape, ...]:
    """A dome of ten stacked discs, each with the radius of the sphere at its mid height."""
    layers = 10
    height = radius / layers
    return tuple(
        Cylinder(
            (*centre, (k + 0.5) * height),
            math.sqrt(radius**2 - ((k + 0.5) * height) ** 2),
            height,
            f"plaster/{colour}",
        )
        for k in range(layers)
    )


def polygon(
    centre: Place, radius: float, corners: int, turn_rad: float, height: float, colour: str
) -> tuple[Shape, ...]:
    """An upright regular prism with an even number of corners: one box across each pair of opposite sides.

    The union of the boxes is exactly the prism.
    """
    side, across = (
        2 * radius * math.sin(math.pi / corners),
        2 * radius * math.cos(math.pi / corners),
    )
    boxes = 1 if corners == 4 else corners // 2
    return tuple(
        Box(
            (
                *centre,
                height / 2 - 5e-4 * k,
            ),  # tops at slightly different heights, so that one is visible
            (across, side, height - 1e-3 * k),
            turn_rad + 2 * math.pi * k / corners,
            f"plaster/{colour}",
        )
        for k in range(boxes)
    )


def _epuck(
    name: str, start: Place, heading_rad: float, reversal_s: float, colour: str
) -> MovingObject:
    body = Cylinder(
        (0.0, 0.0, EPUCK_HEIGHT_M / 2), EPUCK_RADIUS_M, EPUCK_HEIGHT_M, f"stripes/{colour}"
    )
    return MovingObject(name, start, heading_rad, 0.06, reversal_s, (body,))
