"""Scenes: everything that stands and moves in a world, as plain values, made from a name and a seed.

A scene is data. `world` plays it, `pictures` paints it, `rays` measures it. The generators of the known
scenes are registered at the end; each is a function of the seed, some of the difficulty too.
"""

from __future__ import annotations

import difflib
import functools
from collections.abc import Callable
from pathlib import Path

from perception.primitives.errors import InputError

from ..scene import Scene
from . import difficulty as grades


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
    from . import avoidance_scenes, course, flat, home, plain_room, public_places, rooms, seed_rooms

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
