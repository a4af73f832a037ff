"""The catalogue of scenes: each generator makes a scene from a seed, some also from a difficulty."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Callable
from pathlib import Path

from perception.primitives.errors import InputError

from ..movers.law import MoversConfig
from ..movers.population import populated
from ..scene import Scene
from . import (
    avoidance_scenes,
    building,
    course,
    flat,
    home,
    plain_room,
    public_places,
    rooms,
    seed_rooms,
    storeys,
)
from . import difficulty as difficulties
from .scene_file import read_scene
from .walker import SMALL, Walker

AS_DRAWN = MoversConfig()


def names() -> tuple[str, ...]:
    """Names of the scenes."""
    return tuple(_registry())


def load(
    name: str,
    seed: int,
    difficulty: float = difficulties.USUAL,
    movers: MoversConfig = AS_DRAWN,
    walker: Walker = SMALL,
) -> Scene:
    """Load a scene by name or from a user's file; the same arguments give the same scene.

    Args:
        name: Name in the catalogue, or a path that ends in .toml (see `scene_file`).
        seed: Seed of everything drawn.
        difficulty: In [0, 1]: number and speed of objects, width of passages; 0.5 is the usual scene. Scenes that a
            paper specifies (robots_room, narrow_course, boxes, avoidance_*), scenes for measurements (empty_room,
            plain_room) and user files ignore it.
        movers: Laws of the moving objects; by default as the scene sets them.
        walker: For whom it is made, of ours only `home`; a user's file is checked for it.

    Raises:
        InputError: for an unknown name, an invalid seed or difficulty, or an unreadable file.
    """
    difficulties.check(difficulty)
    if name.endswith(".toml"):
        return populated(read_scene(Path(name), seed, walker), movers)
    known = _registry()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise InputError(
            f"scene {name!r} is unknown; {hint}known scenes: {', '.join(known)}, or your own .toml file"
        )
    if seed < 0:
        raise InputError(f"scene {name!r}: seed {seed} must not be negative; choose 0 or more")
    if name == "home":
        return populated(home.home(seed, difficulty, walker), movers)
    return populated(known[name](seed, difficulty), movers)


def _registry() -> dict[str, Callable[[int, float], Scene]]:
    known: dict[str, Callable[[int, float], Scene]] = {
        "home": home.home,
        "flat": flat.flat,
        "building": building.building,
        "corridor": rooms.corridor,
        "office": public_places.office,
        "hall": public_places.hall,
        "storeys": storeys.storeys,
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
    """A generator that ignores the difficulty."""
    return lambda seed, difficulty: made(seed)
