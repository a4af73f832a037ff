"""Scenes: everything that stands and moves in a world, as plain values, made from a name and a seed.

A scene is data. `world` plays it, `pictures` paints it, `rays` measures it. The generators of the known
scenes are registered at the end; each is a function of the seed, some of the difficulty too.
"""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from perception.primitives.errors import InputError
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2

from . import difficulty as grades
from .shapes import Cylinder, Shape


@dataclass(frozen=True)
class Thing:
    """Something that stands still.

    Args:
        name: For people: "sofa", "wall".
        parts: Its shapes.
        albedo: Share of infrared light that it returns, for the time-of-flight camera.
        wall: Whether it belongs to the building; walls are no obstacles to be listed.
    """

    name: str
    parts: tuple[Shape, ...]
    albedo: float = 0.6
    wall: bool = False


@dataclass(frozen=True)
class Mover:
    """A small robot that goes to and fro on a straight line, blind to everything.

    Args:
        name: For people.
        start: (x, y) of one end of its line, m.
        heading_rad: Direction of the line.
        speed_mps: Even, in both directions.
        reversal_s: Time from one end to the other.
        parts: Shapes about the origin of the mover, upright cylinders.
        albedo: As of a thing.
        under_way_s: How long it has walked when the world begins; None: the world draws it.

    Source: seed 000, section 6 (robots d1 to d3).
    """

    name: str
    start: tuple[float, float]
    heading_rad: float
    speed_mps: float
    reversal_s: float
    parts: tuple[Cylinder, ...]
    albedo: float = 0.6
    under_way_s: float | None = None

    @property
    def radius_m(self) -> float:
        """Of the circle about all its parts."""
        return max(math.hypot(*part.centre[:2]) + part.radius for part in self.parts)

    @property
    def height_m(self) -> float:
        """Its top."""
        return max(part.top_m for part in self.parts)

    @property
    def end(self) -> tuple[float, float]:
        """The other end of its line."""
        length = self.speed_mps * self.reversal_s
        return (
            self.start[0] + length * math.cos(self.heading_rad),
            self.start[1] + length * math.sin(self.heading_rad),
        )

    def state(self, seconds: float) -> tuple[float, float, float, float]:
        """(x, y, vx, vy) that long after it left its start, m and m/s."""
        turns, rest = divmod(seconds, self.reversal_s)
        there = turns % 2 == 0
        travelled = self.speed_mps * (rest if there else self.reversal_s - rest)
        speed = self.speed_mps if there else -self.speed_mps
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return (
            self.start[0] + c * travelled,
            self.start[1] + s * travelled,
            c * speed,
            s * speed,
        )


@dataclass(frozen=True)
class FloorArea:
    """A rectangle of flooring: material, (x_min, y_min, x_max, y_max), m; later areas cover earlier."""

    material: str
    extent: tuple[float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """A world at rest, with what is to be done in it.

    Args:
        name, seed: What `load` was asked for.
        extent: (x_min, y_min, x_max, y_max) of the floor inside the walls, m.
        floor: Flooring; the first area covers all of the extent.
        things: What stands still, walls and tag plates among it.
        movers: What moves.
        landmarks: The tags, as the robot knows them beforehand.
        start: Where the robot stands at first.
        goals: Places to reach one after the other, m.
        floor_albedo: As of a thing.
    """

    name: str
    seed: int
    extent: tuple[float, float, float, float]
    floor: tuple[FloorArea, ...]
    things: tuple[Thing, ...]
    movers: tuple[Mover, ...]
    landmarks: tuple[Landmark, ...]
    start: Pose2
    goals: tuple[tuple[float, float], ...]
    floor_albedo: float = 0.5

    @property
    def obstacles(self) -> tuple[Thing, ...]:
        """The things that are neither building nor tag."""
        return tuple(thing for thing in self.things if not thing.wall)


def names() -> tuple[str, ...]:
    """The known scenes."""
    return tuple(_registry())


def load(name: str, seed: int, difficulty: float = grades.USUAL) -> Scene:
    """A scene by its name, or from a user's file; the same seed and difficulty give the same scene.

    Args:
        name: Of a known scene, or a path that ends in .toml (see `scene_file`).
        seed: Of everything that is drawn.
        difficulty: In [0, 1]: how many things and movers, how fast, how narrow the ways; 0.5 is usual.
            What papers print or use as it is (robots_room, narrow_course, boxes, avoidance_*), what is for
            measuring (empty_room, plain_room) and a user's file stay what they are.

    Raises:
        InputError: for an unknown name, an impossible seed or difficulty, or a file that cannot be read.
    """
    grades.check(difficulty)
    if name.endswith(".toml"):
        from .scene_file import read_scene  # it builds the values defined here

        return read_scene(Path(name), seed)
    known = _registry()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(
            f"scene {name!r} is unknown; {hint}known scenes: {', '.join(known)}, or your own .toml file"
        )
    if seed < 0:
        raise InputError(f"scene {name!r}: seed {seed} must not be negative; choose 0 or more")
    return known[name](seed, difficulty)


def _registry() -> dict[str, Callable[[int, float], Scene]]:
    from . import (
        avoidance_scenes,
        course,
        flat,
        home,
        plain_room,
        public_places,
        rooms,
        seed_rooms,
    )  # they build the values defined here

    known: dict[str, Callable[[int, float], Scene]] = {
        "home": home.furnished,
        "flat": flat.flat,
        "corridor": rooms.corridor,
        "office": public_places.office,
        "hall": public_places.hall,
        "empty_room": _always(rooms.empty_room),
        "boxes": _always(rooms.boxes),
        "plain_room": _always(plain_room.plain_room),
        "robots_room": _always(seed_rooms.robots_room),
        "printed_room": _always(seed_rooms.printed_room),
        "narrow_course": _always(seed_rooms.narrow_course),
        "course": course.course,
        "fast_course": course.fast_course,
        "hard_course": course.hard_course,
    }
    for motion in avoidance_scenes.MOTIONS:
        known[f"avoidance_{motion.lower()}"] = _always(
            functools.partial(avoidance_scenes.avoidance, motion)
        )
    return known


def _always(made: Callable[[int], Scene]) -> Callable[[int, float], Scene]:
    """A scene that is as difficult as it is."""
    return lambda seed, difficulty: made(seed)
