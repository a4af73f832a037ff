"""Plain scenes (empty room, corridor, boxes in an arena), and the walls and tags of all rooms."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.pose import Pose2

from ..scene import Extent, FloorArea, MovingObject, Place, Scene, StaticObject
from ..shapes import Box, Cylinder
from .difficulty import USUAL, interpolated, interpolated_count, interpolated_span
from .tags import place_tags

WALL_HEIGHT_M = 2.4
WALL_THICKNESS_M = 0.10


def walls(extent: Extent, materials: tuple[str, str, str, str]) -> tuple[StaticObject, ...]:
    """Four walls just outside the extent: east, north, west, south."""
    x0, y0, x1, y1 = extent
    t, h = WALL_THICKNESS_M, WALL_HEIGHT_M
    middle_x, middle_y = (x0 + x1) / 2, (y0 + y1) / 2
    long_x, long_y = x1 - x0 + 2 * t, y1 - y0 + 2 * t
    boxes = (
        Box((x1 + t / 2, middle_y, h / 2), (t, long_y, h), 0.0, materials[0]),
        Box((middle_x, y1 + t / 2, h / 2), (long_x, t, h), 0.0, materials[1]),
        Box((x0 - t / 2, middle_y, h / 2), (t, long_y, h), 0.0, materials[2]),
        Box((middle_x, y0 - t / 2, h / 2), (long_x, t, h), 0.0, materials[3]),
    )
    return tuple(StaticObject("wall", (box,), 0.75, wall=True) for box in boxes)


def small_robot(
    name: str,
    start: Place,
    heading_rad: float,
    speed_mps: float,
    reversal_s: float,
    colour: str,
    height_m: float = 0.45,
) -> MovingObject:
    """A moving robot of 10 cm radius with a narrower head."""
    head = 0.08
    body = Cylinder((0.0, 0.0, (height_m - head) / 2), 0.10, height_m - head, f"stripes/{colour}")
    top = Cylinder((0.0, 0.0, height_m - head / 2), 0.07, head, "stripes/slate")
    return MovingObject(name, start, heading_rad, speed_mps, reversal_s, (body, top))


def empty_room(seed: int) -> Scene:
    """Four walls and a floor of 5 x 4 m, for measurements without obstacles."""
    extent = (0.0, 0.0, 5.0, 4.0)
    return scene_with_tags(
        "empty_room",
        seed,
        extent,
        "planks/oak",
        walls(extent, ("wall/white", "wall/sage", "wall/cream", "wall/sky")),
        (),
        Pose2(0.8, 2.0, 0.0),
        ((4.2, 2.0), (4.2, 3.2), (0.8, 0.8)),
    )


def corridor(seed: int, difficulty: float = USUAL) -> Scene:
    """A corridor of 8 x 1.6 m with boxes at alternating sides and a robot moving along it.

    A harder corridor has more and wider boxes, a faster robot, and finally a second one.
    """
    rng = np.random.default_rng([seed, 2])
    extent = (0.0, 0.0, 8.0, 1.6)
    static_objects = list(walls(extent, ("wall/cream",) * 4))
    side = bool(rng.integers(2))
    for k, x in enumerate(np.arange(1.8, 6.8, interpolated(difficulty, 2.2, 1.5, 1.2))):
        widths = interpolated_span(difficulty, (0.22, 0.30), (0.3, 0.42), (0.45, 0.6))
        width, height = float(rng.uniform(*widths)), float(rng.uniform(0.3, 0.6))
        y = width / 2 + 0.02 if side else extent[3] - width / 2 - 0.02
        place = (float(x + rng.uniform(-0.15, 0.15)), y, height / 2)
        static_objects.append(
            StaticObject(
                f"carton {k + 1}", (Box(place, (0.35, width, height), 0.0, "cardboard/kraft"),)
            )
        )
        side = not side
    moving_objects = []
    for name, x, heading, colour in (
        ("robot 1", 4.2, 0.0, "orange"),
        ("robot 2", 3.4, math.pi, "lime"),
    )[: interpolated_count(difficulty, 1, 1, 2)]:
        speed = float(
            rng.uniform(*interpolated_span(difficulty, (0.02, 0.03), (0.03, 0.05), (0.05, 0.08)))
        )
        moving_objects.append(small_robot(name, (x, 0.8), heading, speed, 20.0, colour))
    return scene_with_tags(
        "corridor",
        seed,
        extent,
        "tiles/grey",
        tuple(static_objects),
        tuple(moving_objects),
        Pose2(0.6, 0.8, 0.0),
        ((7.3, 0.8), (0.7, 0.8)),
    )


def boxes(seed: int) -> Scene:
    """An arena of 4 x 3 m with a row of boxes of 32 x 24 x 32 cm and a gap in it.

    Source: seed 004, section 8 (test obstacle, arena of 2.5 x 3 m; ours is longer, for a longer approach).
    """
    rng = np.random.default_rng([seed, 3])
    extent = (0.0, 0.0, 4.0, 3.0)
    static_objects = list(walls(extent, ("wall/white",) * 4))
    gap = float(rng.uniform(0.7, 0.9))
    middle = float(rng.uniform(1.0, 2.0))
    y_low, y_high = middle - gap / 2, middle + gap / 2
    for k in range(2):
        for name, y in (("low", y_low - 0.12 - 0.24 * k), ("high", y_high + 0.12 + 0.24 * k)):
            box = Box((2.0, y, 0.16), (0.32, 0.24, 0.32), 0.0, "cardboard/kraft")
            static_objects.append(StaticObject(f"box {name} {k + 1}", (box,)))
    return scene_with_tags(
        "boxes",
        seed,
        extent,
        "planks/pine",
        tuple(static_objects),
        (),
        Pose2(0.6, 1.5, 0.0),
        ((3.4, 1.5),),
    )


def scene_with_tags(
    name: str,
    seed: int,
    extent: Extent,
    flooring: str,
    static_objects: tuple[StaticObject, ...],
    moving_objects: tuple[MovingObject, ...],
    start: Pose2,
    goals: tuple[Place, ...],
    tags: int = 16,
    low: bool = False,
) -> Scene:
    """A scene with one flooring and tags on its walls.

    Args:
        name, seed, extent, static_objects, moving_objects, start, goals: As in `Scene`.
        flooring: Material of the floor.
        tags: Greatest number of tags.
        low: Whether the other objects are too low to carry or occlude tags.
    """
    carriers = tuple(item for item in static_objects if item.wall) if low else static_objects
    plates, landmarks = place_tags(extent, carriers, start, tags)
    return Scene(
        name,
        seed,
        extent,
        (FloorArea(flooring, extent),),
        static_objects + plates,
        moving_objects,
        landmarks,
        start,
        goals,
    )


def heading_towards(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Heading from one point to another, rad."""
    return math.atan2(b[1] - a[1], b[0] - a[0])
