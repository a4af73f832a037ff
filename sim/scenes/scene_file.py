"""Scenes from a user's TOML file.

Lengths are in m, angles in deg, places (x, y) on the floor. Unknown keys are refused with the nearest known one.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2
from perception.primitives.safe_input import UnreadableError

from ..movers.law import LAWS
from ..rendering.textures import PALETTE
from ..scene import TO_AND_FRO, Extent, FloorArea, MovingObject, Scene, StaticObject
from ..shapes import Box, Cylinder, Shape
from .furniture import CATALOGUE, place_piece
from .model_files import placed, read_model
from .rooms import WALL_HEIGHT_M, small_robot, walls
from .scene_checks import (
    check_area,
    check_count,
    check_extent,
    check_moving_object,
    check_object,
    check_places,
    check_reachable,
)
from .scene_table import LEAST_M, TableReader
from .tags import place_tags
from .walker import SMALL, Walker

EXAMPLE = """\
extent = [0, 0, 5, 4]        # x_min, y_min, x_max, y_max of the floor inside the walls
start = [0.6, 2.0, 0]        # x, y, heading
goals = [[4.4, 2.0]]
[[box]]
name = "table"
at = [2.5, 2.0]
size = [0.6, 0.8, 0.5]       # along its own x, y, and its height
yaw = 20
[[moving_object]]
from = [3.6, 1.0]
to = [3.6, 3.0]
speed = 0.05
"""

ALBEDO = 0.6  # ours: default
SPEEDS_MPS = (0.001, 5.0)  # ours: of a moving object, up to a runner
MOST_TAGS = 50  # size of the dictionary, see `textures`
_TAGS = 16  # ours: default
_KEYS: dict[str, tuple[str, ...]] = {
    "": (
        "extent", "start", "goals", "floor", "walls", "tags", "box", "cylinder", "furniture", "model",
        "moving_object", "area",
    ),
    "box": ("name", "at", "size", "yaw", "above", "material", "albedo"),
    "cylinder": ("name", "at", "radius", "height", "above", "material", "albedo"),
    "furniture": ("kind", "at", "yaw", "name"),
    "model": ("name", "file", "at", "yaw", "scale", "up", "above", "material", "albedo"),
    "moving_object": ("name", "from", "to", "speed", "height", "colour", "phase", "law"),
    "area": ("extent", "material"),
}  # fmt: skip


def read_scene(path: Path, seed: int, walker: Walker = SMALL) -> Scene:
    """Read a scene from a file.

    Args:
        path: TOML, see `EXAMPLE`.
        seed: Draws colours, textures and phases of moving objects.
        walker: Who is to stand at start and goals and to get there.

    Raises:
        InputError: with file, entry, value, the expected value and a remedy.
    """
    if seed < 0:
        raise InputError(f"{path}: seed {seed} must not be negative; choose 0 or more")
    table = _load(path)
    reader = TableReader(path, EXAMPLE)
    check_count(reader.where, table)
    extent = reader.numbers(table, "extent", 4)
    check_extent(reader.where, extent)
    x, y, heading = reader.numbers(table, "start", 3)
    heading = reader.number({"heading": heading}, "heading", None, -360.0, 360.0)
    start = Pose2(x, y, math.radians(heading))
    goals = tuple(reader.place({"goal": goal}, "goal") for goal in reader.items(table, "goals"))
    if not goals:
        raise InputError(f"{path}: goals is missing; give at least one place, goals = [[4.4, 2.0]]")
    rng = np.random.default_rng([seed, 30])
    wall = reader.material(table, "walls", "wall/cream")
    static_objects = (*walls(extent, (wall,) * 4), *_static_objects(reader, table, extent, rng))
    places = [("start", (x, y)), *((f"goal {k}", goal) for k, goal in enumerate(goals, 1))]
    check_places(reader.where, extent, static_objects, places, walker)
    check_reachable(reader.where, extent, static_objects, (x, y), goals, walker)
    moving_objects = []
    for number, item in reader.entries(table, "moving_object"):
        moving_objects.append(_moving_object(reader, item, number))
        check_moving_object(
            reader.where, moving_objects[-1], extent, static_objects, (x, y), walker
        )
    areas = [FloorArea(reader.material(table, "floor", "planks/oak"), extent)]
    for _, item in reader.entries(table, "area"):
        material = reader.material(item, "material", "rug/teal")
        areas.append(FloorArea(material, reader.numbers(item, "extent", 4)))
        check_area(reader.where, areas[-1], extent)
    count = reader.count(table, "tags", _TAGS, MOST_TAGS)
    plates, landmarks = place_tags(extent, static_objects, start, count) if count else ((), ())
    return Scene(
        path.stem,
        seed,
        extent,
        tuple(areas),
        static_objects + plates,
        tuple(moving_objects),
        landmarks,
        start,
        goals,
    )


def _static_objects(
    reader: TableReader, table: Mapping[str, Any], extent: Extent, rng: np.random.Generator
) -> list[StaticObject]:
    found = []

    def add(item: Mapping[str, Any], name: str, parts: tuple[Shape, ...], albedo: float) -> None:
        shown = reader.word(item, "name", name)
        found.append(StaticObject(shown, parts, reader.number(item, "albedo", albedo, 0.0, 1.0)))
        check_object(reader.where, found[-1], extent, reader.number(item, "above", 0.0))

    for number, item in reader.entries(table, "box"):
        size = reader.size(item, "size")
        yaw = math.radians(reader.number(item, "yaw", 0.0))
        bottom = reader.number(item, "above", 0.0, 0.0)
        place = (*reader.place(item, "at"), bottom + size[2] / 2)
        material = reader.material(item, "material", "cardboard/kraft")
        add(item, f"box {number}", (Box(place, size, yaw, material),), ALBEDO)
    for number, item in reader.entries(table, "cylinder"):
        radius = reader.number(item, "radius", least=LEAST_M)
        height = reader.number(item, "height", least=LEAST_M)
        bottom = reader.number(item, "above", 0.0, 0.0)
        place = (*reader.place(item, "at"), bottom + height / 2)
        shape = Cylinder(place, radius, height, reader.material(item, "material", "plaster/clay"))
        add(item, f"cylinder {number}", (shape,), ALBEDO)
    for _, item in reader.entries(table, "furniture"):
        kind = reader.word(item, "kind")
        model = next((one for one in CATALOGUE if one.name == kind), None)
        if model is None:
            names = list(dict.fromkeys(one.name for one in CATALOGUE))
            raise reader.refusal("kind", kind, f"one of {', '.join(names)}")
        yaw = math.radians(reader.number(item, "yaw", 0.0))
        piece = place_piece(model, reader.place(item, "at"), yaw, rng)
        add(item, kind, piece.parts, piece.albedo)
    for number, item in reader.entries(table, "model"):
        add(item, *_model(reader, item, number), ALBEDO)
    return found


def _model(
    reader: TableReader, item: Mapping[str, Any], number: int
) -> tuple[str, tuple[Shape, ...]]:
    """Default name of a model, and its parts."""
    file = reader.path.parent / reader.word(item, "file")
    up = reader.word(item, "up") if "up" in item else ""
    if up not in ("", "y", "z"):
        raise reader.refusal("up", up, '"y" or "z", the axis of the file that points up')
    scale = reader.number(item, "scale", 1.0, 1e-6)
    try:
        solids = read_model(file, reader.material(item, "material", "plaster/grey"), scale, up)
    except InputError as error:
        raise InputError(f"{reader.where}{error}") from error
    place = (*reader.place(item, "at"), reader.number(item, "above", 0.0))
    yaw = math.radians(reader.number(item, "yaw", 0.0))
    return f"{file.stem} {number}", placed(solids, place, yaw)


def _moving_object(reader: TableReader, item: Mapping[str, Any], number: int) -> MovingObject:
    first, last = reader.place(item, "from"), reader.place(item, "to")
    speed = reader.number(item, "speed", None, *SPEEDS_MPS)
    length = math.dist(first, last)
    if length == 0.0:
        raise reader.refusal("to", list(last), "another place than from")
    colour = reader.word(item, "colour", "orange")
    if colour not in PALETTE:
        raise reader.refusal("colour", colour, f"one of {', '.join(PALETTE)}")
    heading = math.atan2(last[1] - first[1], last[0] - first[0])
    height = reader.number(item, "height", 0.45, 0.1, WALL_HEIGHT_M)
    name = reader.word(item, "name", f"robot {number}")
    law = reader.word(item, "law", TO_AND_FRO)
    if law not in LAWS:
        raise reader.refusal("law", law, f"one of {', '.join(LAWS)}")
    robot = small_robot(name, first, heading, speed, length / speed, colour, height)
    robot = replace(robot, law=law)
    if "phase" not in item:
        return robot
    return replace(robot, phase_s=reader.number(item, "phase", least=0.0))


def _load(path: Path) -> dict[str, Any]:
    try:
        table = safe_input.toml(safe_input.text(path))
    except UnreadableError as error:
        raise InputError(f"{path}: {error}; expected a scene file") from error
    _refuse_unknown(path, table, "")
    for kind in (key for key in _KEYS if key and key in table):
        entries = table[kind]
        if not isinstance(entries, list) or not all(isinstance(item, dict) for item in entries):
            raise InputError(f"{path}: {kind} must be tables, each headed [[{kind}]]")
        for item in entries:
            _refuse_unknown(path, item, kind)
    return table


def _refuse_unknown(path: Path, table: Mapping[str, Any], where: str) -> None:
    known = _KEYS[where]
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1, 0.5)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
            place = f"[[{where}]] {key}" if where else key
            raise InputError(f"{path}: unknown key {place}; {hint}")
