"""Rooms whose surfaces or whose reflectance say how views lie to each other: textured, plain and repetitive ones.

A round room turned about its middle looks the same to depth. Posters are flush with walls and floor, so that only the
amplitude of the time-of-flight camera shows them. In a repetitive room all posters are equal and stand in rows.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from perception.primitives.pose import Pose2
from sim.scene import FloorArea, Scene, StaticObject
from sim.scenes import catalogue
from sim.shapes import Box

ROUND_RADIUS_M = 2.0
ROUND_SIDES = 48
ROOM_HEIGHT_M = 2.4
POSTERS = 500
POSTER_M = (0.04, 0.20)  # side lengths
SHADES = (0.1, 0.25, 0.95)  # infrared reflectance of printed paper
THICK_M = 0.0005
SPACING_M = 0.30  # of equal posters
TOP_M = 1.6  # of the posters on a wall
KINDS = {
    "textured": ("round", "corridor", "boxes"),
    "plain": ("round", "plain_room", "home"),
    "repetitive": ("round", "corridor", "boxes"),
}
"""Kind to the rooms that are shown that way."""

Panel = tuple[np.ndarray, float, float, float]
"""Middle of a rectangle's lower edge, its heading (a wall's, seen from inside), length and height; m."""


def load(kind: str, room: str, seed: int) -> Scene:
    """A room of a kind: `KINDS`."""
    scene = round_room(seed) if room == "round" else catalogue.load(room, seed)
    if kind == "plain":
        return scene
    rng = np.random.default_rng([seed, 52])
    return replace(scene, static_objects=(*scene.static_objects, *posters(scene, kind, rng)))


def round_room(seed: int) -> Scene:
    """A round room, empty, with the robot near its middle."""
    reach = ROUND_RADIUS_M + 0.2
    extent = (-reach, -reach, reach, reach)
    length = 2.0 * (ROUND_RADIUS_M + 0.1) * math.tan(math.pi / ROUND_SIDES)
    walls = []
    for angle in 2.0 * math.pi * np.arange(ROUND_SIDES) / ROUND_SIDES:
        x, y = (ROUND_RADIUS_M + 0.05) * np.array([math.cos(angle), math.sin(angle)])
        box = Box(
            (float(x), float(y), ROOM_HEIGHT_M / 2), (0.1, length, ROOM_HEIGHT_M), float(angle)
        )
        walls.append(StaticObject("wall", (box,), 0.75, wall=True))
    start = np.random.default_rng([seed, 53]).uniform(-0.3, 0.3, 2)
    floor = (FloorArea("planks/pine", extent),)
    pose = Pose2(float(start[0]), float(start[1]), 0.0)
    return Scene("round", seed, extent, floor, tuple(walls), (), (), pose, ((1.0, 0.0),))


def posters(scene: Scene, kind: str, rng: np.random.Generator) -> Iterator[StaticObject]:
    """Posters on the walls and the floor: of random size, place and shade, or equal ones in rows."""
    panels = [panel for item in scene.static_objects if item.wall for panel in _panels(scene, item)]
    x0, y0, x1, y1 = scene.extent
    if kind == "repetitive":
        for middle, heading, length, height in panels:
            for along in np.arange(-length / 2 + SPACING_M / 2, length / 2, SPACING_M):
                for up in np.arange(SPACING_M / 2, height, SPACING_M):
                    yield _on_wall(middle, heading, float(along), float(up), (0.12, 0.12), 0.1)
        for x in np.arange(x0 + SPACING_M / 2, x1, SPACING_M):
            for y in np.arange(y0 + SPACING_M / 2, y1, SPACING_M):
                yield _on_floor(float(x), float(y), (0.12, 0.12), 0.1)
        return
    areas = np.array([length * height for _, _, length, height in panels] + [(x1 - x0) * (y1 - y0)])
    for number in rng.choice(len(areas), POSTERS, p=areas / areas.sum()):
        w, h = (float(side) for side in rng.uniform(*POSTER_M, 2))
        shade = float(rng.choice(SHADES))
        a, b = rng.uniform(0.0, 1.0, 2)
        if number == len(panels):
            yield _on_floor(float(x0 + a * (x1 - x0)), float(y0 + b * (y1 - y0)), (w, h), shade)
            continue
        middle, heading, length, height = panels[number]
        yield _on_wall(middle, heading, (a - 0.5) * length, float(b) * height, (w, h), shade)


def _panels(scene: Scene, wall: StaticObject) -> Iterator[Panel]:
    """The inner faces of a wall, as far as posters hang."""
    for part in wall.parts:
        if not isinstance(part, Box) or part.size[2] < 1.0:
            continue
        centre = np.asarray(part.centre[:2])
        inward = np.array([scene.start.x, scene.start.y]) - centre
        for turn, thick, length in (
            (0.0, part.size[0], part.size[1]),
            (math.pi / 2, part.size[1], part.size[0]),
        ):
            heading = part.yaw_rad + turn
            normal = np.array([math.cos(heading), math.sin(heading)])
            if thick > 0.2:
                continue
            side = math.copysign(1.0, float(normal @ inward))
            face = centre + side * thick / 2 * normal
            yield face, heading + (0.0 if side > 0 else math.pi), length, TOP_M


def _on_wall(
    middle: np.ndarray,
    heading: float,
    along: float,
    up: float,
    size: tuple[float, float],
    albedo: float,
) -> StaticObject:
    normal = np.array([math.cos(heading), math.sin(heading)])
    x, y = middle + THICK_M / 2 * normal + along * np.array([-normal[1], normal[0]])
    up = max(up, size[1] / 2 + 0.001)
    box = Box((float(x), float(y), up), (THICK_M, size[0], size[1]), heading)
    return StaticObject("poster", (box,), albedo, wall=True)


def _on_floor(x: float, y: float, size: tuple[float, float], albedo: float) -> StaticObject:
    box = Box((x, y, THICK_M / 2), (size[0], size[1], THICK_M))
    return StaticObject("poster", (box,), albedo, wall=True)
