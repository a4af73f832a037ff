"""Scenes that a user writes, as TOML: ten lines are a room with something in it.

Lengths are m, angles deg, places (x, y) on the floor. Every key is known here; a misspelt one is refused, with
its nearest.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2

from .furniture import CATALOGUE, place_piece
from .model_files import placed, read_model
from .rooms import little_robot, walls
from .scenes import FloorArea, Mover, Scene, Thing
from .shapes import Box, Cylinder, Shape, distance
from .tags import place_tags
from .textures import KINDS, PALETTE

EXAMPLE = """\
extent = [0, 0, 5, 4]        # x_min, y_min, x_max, y_max of the floor inside the walls
start = [0.6, 2.0, 0]        # x, y, heading
goals = [[4.4, 2.0]]
[[box]]
name = "table"
at = [2.5, 2.0]
size = [0.6, 0.8, 0.5]       # along its own x, y, and its height
yaw = 20
[[mover]]
from = [3.6, 1.0]
to = [3.6, 3.0]
speed = 0.05
"""

_ROBOT_RADIUS_M = 0.15  # seed 001: S_r
_TAGS = 16
_KEYS: dict[str, dict[str, str]] = {
    "": {
        "extent": "four numbers", "start": "x, y, heading", "goals": "a list of places",
        "floor": "a material", "walls": "a material", "tags": "how many", "box": "tables",
        "cylinder": "tables", "furniture": "tables", "model": "tables", "mover": "tables",
        "area": "tables",
    },
    "box": dict.fromkeys(("name", "at", "size", "yaw", "above", "material", "albedo"), ""),
    "cylinder": dict.fromkeys(("name", "at", "radius", "height", "above", "material", "albedo"), ""),
    "furniture": dict.fromkeys(("kind", "at", "yaw", "name"), ""),
    "model": dict.fromkeys(("name", "file", "at", "yaw", "scale", "up", "above", "material", "albedo"), ""),
    "mover": dict.fromkeys(("name", "from", "to", "speed", "height", "colour"), ""),
    "area": dict.fromkeys(("extent", "material"), ""),
}  # fmt: skip


def read_scene(path: Path, seed: int) -> Scene:
    """The scene of a file.

    Args:
        path: TOML, see `EXAMPLE`.
        seed: Of colours, textures and where movers are on their lines.

    Raises:
        InputError: naming the key, its value and what was expected.
    """
    table = _load(path)
    reader = _Reader(path)
    extent = reader.numbers(table, "extent", 4)
    if not (extent[0] < extent[2] and extent[1] < extent[3]):
        raise InputError(
            f"{path}: extent = {list(extent)} must be x_min, y_min, x_max, y_max, rising"
        )
    x, y, heading = reader.numbers(table, "start", 3)
    start = Pose2(x, y, math.radians(heading))
    goals = tuple(reader.place({"goal": goal}, "goal") for goal in reader.items(table, "goals"))
    if not goals:
        raise InputError(f"{path}: goals is missing; give at least one place, goals = [[4.4, 2.0]]")
    rng = np.random.default_rng([seed, 30])
    wall = reader.material(table, "walls", "wall/cream")
    things = (*walls(extent, (wall,) * 4), *_things(reader, table, rng))
    movers = tuple(_mover(reader, item, k) for k, item in enumerate(reader.tables(table, "mover")))
    areas = [FloorArea(reader.material(table, "floor", "planks/oak"), extent)]
    areas += [
        FloorArea(reader.material(item, "material", "rug/teal"), reader.numbers(item, "extent", 4))
        for item in reader.tables(table, "area")
    ]
    _free(path, extent, things, (("start", (x, y)), *(("goal", goal) for goal in goals)))
    count = int(reader.number(table, "tags", float(_TAGS)))
    plates, landmarks = place_tags(extent, things, start, count) if count else ((), ())
    return Scene(
        path.stem, seed, extent, tuple(areas), things + plates, movers, landmarks, start, goals
    )


def _things(reader: _Reader, table: Mapping[str, Any], rng: np.random.Generator) -> list[Thing]:
    found = []
    for number, item in enumerate(reader.tables(table, "box")):
        size = reader.numbers(item, "size", 3)
        above = reader.number(item, "above", 0.0)
        yaw = math.radians(reader.number(item, "yaw", 0.0))
        place = (*reader.place(item, "at"), above + size[2] / 2)
        material = reader.material(item, "material", "cardboard/kraft")
        found.append(reader.thing(item, f"box {number + 1}", (Box(place, size, yaw, material),)))
    for number, item in enumerate(reader.tables(table, "cylinder")):
        radius, height = reader.number(item, "radius"), reader.number(item, "height")
        place = (*reader.place(item, "at"), reader.number(item, "above", 0.0) + height / 2)
        shape = Cylinder(place, radius, height, reader.material(item, "material", "plaster/clay"))
        found.append(reader.thing(item, f"cylinder {number + 1}", (shape,)))
    for item in reader.tables(table, "furniture"):
        kind = reader.word(item, "kind")
        model = next((one for one in CATALOGUE if one.name == kind), None)
        if model is None:
            names = list(dict.fromkeys(one.name for one in CATALOGUE))
            raise reader.refusal("furniture.kind", kind, f"one of {', '.join(names)}")
        yaw = math.radians(reader.number(item, "yaw", 0.0))
        piece = place_piece(model, reader.place(item, "at"), yaw, rng)
        found.append(dataclasses.replace(piece, name=reader.word(item, "name", kind)))
    for number, item in enumerate(reader.tables(table, "model")):
        file = reader.path.parent / reader.word(item, "file")
        up = reader.word(item, "up") if "up" in item else ""
        if up not in ("", "y", "z"):
            raise reader.refusal("model.up", up, '"y" or "z", the axis of the file that points up')
        scale = reader.number(item, "scale", 1.0)
        solids = read_model(file, reader.material(item, "material", "plaster/grey"), scale, up)
        place = (*reader.place(item, "at"), reader.number(item, "above", 0.0))
        yaw = math.radians(reader.number(item, "yaw", 0.0))
        parts = placed(solids, place, yaw)
        found.append(reader.thing(item, f"{file.stem} {number + 1}", parts))
    return found


def _mover(reader: _Reader, item: Mapping[str, Any], number: int) -> Mover:
    first, last = reader.place(item, "from"), reader.place(item, "to")
    speed = reader.number(item, "speed")
    length = math.dist(first, last)
    if not (speed > 0.0 and length > 0.0):
        raise reader.refusal("mover.speed", speed, "a positive speed, m/s, between two places")
    colour = reader.word(item, "colour", "orange")
    if colour not in PALETTE:
        raise reader.refusal("mover.colour", colour, f"one of {', '.join(PALETTE)}")
    heading = math.atan2(last[1] - first[1], last[0] - first[0])
    height = reader.number(item, "height", 0.45)
    name = reader.word(item, "name", f"robot {number + 1}")
    return little_robot(name, first, heading, speed, length / speed, colour, height)


def _free(
    path: Path,
    extent: tuple[float, ...],
    things: tuple[Thing, ...],
    places: tuple[tuple[str, tuple[float, float]], ...],
) -> None:
    """Start and goals are where the robot can stand."""
    shapes: list[tuple[str, Shape]] = [(t.name, part) for t in things for part in t.parts]
    for what, (x, y) in places:
        if not (extent[0] < x < extent[2] and extent[1] < y < extent[3]):
            raise InputError(f"{path}: {what} ({x}, {y}) lies outside the extent {list(extent)}")
        for name, shape in shapes:
            gap = float(distance(shape, np.array([[x, y]]))[0])
            if shape.bottom_m < 0.5 and gap < _ROBOT_RADIUS_M:
                raise InputError(
                    f"{path}: {what} ({x}, {y}) is {gap:.2f} m from {name!r}; the robot needs "
                    f"{_ROBOT_RADIUS_M} m"
                )


def _load(path: Path) -> dict[str, Any]:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; a scene was expected"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no valid TOML: {error}") from error
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


class _Reader:
    """Takes values out of tables; complaints name the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def refusal(self, key: str, value: object, expected: str) -> InputError:
        """What to say of a value that cannot be."""
        return InputError(f"{self.path}: {key} = {value!r}; expected {expected}")

    def tables(self, table: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
        """Entries of [[key]]."""
        return list(table.get(key, []))

    def items(self, table: Mapping[str, Any], key: str) -> list[Any]:
        """A list of anything."""
        value = table.get(key, [])
        if not isinstance(value, list):
            raise self.refusal(key, value, "a list")
        return value

    def number(self, table: Mapping[str, Any], key: str, default: float | None = None) -> float:
        """A finite number; sizes and heights are positive by the shapes' nature."""
        value = table.get(key, default)
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not good or not math.isfinite(value):
            raise self.refusal(key, value, "a finite number")
        if key in ("radius", "height", "scale") and value <= 0.0:
            raise self.refusal(key, value, "a positive number")
        return float(value)

    def numbers(self, table: Mapping[str, Any], key: str, count: int) -> tuple[Any, ...]:
        """So many finite numbers."""
        value = table.get(key)
        if not isinstance(value, list) or len(value) != count:
            raise self.refusal(key, value, f"a list of {count} numbers; for example\n{EXAMPLE}")
        found = tuple(self.number({key: v}, key) for v in value)
        if key == "size" and min(found) <= 0.0:
            raise self.refusal(key, value, "positive lengths")
        return found

    def place(self, table: Mapping[str, Any], key: str) -> tuple[float, float]:
        """A place on the floor."""
        x, y = self.numbers(table, key, 2)
        return x, y

    def word(self, table: Mapping[str, Any], key: str, default: str | None = None) -> str:
        """A text."""
        value = table.get(key, default)
        if not isinstance(value, str) or not value:
            raise self.refusal(key, value, "a text in quotes")
        return value

    def material(self, table: Mapping[str, Any], key: str, default: str) -> str:
        """A material that can be painted."""
        value = self.word(table, key, default)
        kind, _, colour = value.partition("/")
        if kind not in KINDS or colour not in PALETTE:
            raise self.refusal(
                key, value, f"kind/colour, of {', '.join(KINDS)} and {', '.join(PALETTE)}"
            )
        return value

    def thing(self, table: Mapping[str, Any], name: str, parts: tuple[Shape, ...]) -> Thing:
        """A named thing of some parts."""
        return Thing(self.word(table, "name", name), parts, self.number(table, "albedo", 0.6))
