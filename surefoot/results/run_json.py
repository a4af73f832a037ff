"""What the JSON files of a run folder must hold, checked when they are read, so that nobody else needs to.

A shape is `float` (a finite number), `int`, `bool`, `str`, `dict` (any object), `Maybe(shape)` (or null), `Some(shape,
...)` (one of them), `[shape]` (a list), `[shape, n]` (a list of n), `{name: shape}` (an object; a name that ends in "?"
may be absent, others may be there too), or `Values(shape)` (an object of such values).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from perception.primitives.safe_input import UnreadableError

MOST = 1e12  # of a number in size; larger ones overflow where they are squared


@dataclass(frozen=True)
class Maybe:
    """The shape, or null."""

    shape: Any


@dataclass(frozen=True)
class Values:
    """An object whose values have the shape."""

    shape: Any


@dataclass(frozen=True)
class Some:
    """One of the shapes."""

    shapes: tuple[Any, ...]


POINT = [float, 2]
NAMED = {float: "a finite number", int: "a whole number", bool: "true or false", str: "text", dict: "an object"}  # fmt: skip
TRACK = {
    "stamp": float, "track": int, "mean": [float, 4], "covariance": [[float, 4], 4], "radius_m?": Maybe(float),
    "height_m?": Maybe(float), "moving?": Maybe(float), "modes?": Maybe(Values(float)), "seen?": float,
}  # fmt: skip
BOX = {
    "centre_m": POINT, "length_m": float, "width_m": float, "yaw_rad": float, "sigma_length_m": Maybe(float),
    "sigma_width_m": Maybe(float), "covariance": Maybe([[float, 2], 2]),
}  # fmt: skip
FOOTPRINT = {
    "outline_m": [POINT], "sides": [{"seen": bool, "sigma_m": Maybe(float)}], "height_m": float,
    "sigma_height_m": Maybe(float), "probability": Maybe(float), "several": bool, "points": int, "box": Maybe(BOX),
}  # fmt: skip
EDGES = {"left_rad": float, "right_rad": float}
LENGTHS = {
    f"{sigma}{name}_m?": Maybe(float)
    for sigma in ("", "sigma_")
    for name in ("distance", "width", "height")
}
CORNER = [Maybe(float), 2]
CHANGED = {
    "outline_m": [POINT, 4], "position_m": POINT, "covariance": [[float, 2], 2], "size_m": [float, 3], "probability": float,
    "voxels": int,
}  # fmt: skip
SHAPES: dict[str, Any] = {
    "summary.json": {
        "kind?": str, "name?": str, "recording?": str, "command?": Maybe(str), "version?": str, "frames?": int,
        "seconds?": Maybe(float), "skipped?": Some((Values(int), int)), "notes?": [str], "interrupted?": bool,
        "goals?": Maybe(int), "goals_reached?": Maybe(int), "goal_positions?": Maybe([POINT]), "start?": Maybe([float, 3]),
        "start_covariance?": Maybe([[float, 3], 3]), "landmarks?": Maybe([[float, 5]]), "body?": Maybe(str),
        "fell_at_s?": Maybe(float), "renderer?": Maybe(str), "trajectory?": str,
        "recording_identity?": str, "commit?": str, "status?": [{"status": str, "times": int}],
    },
    "metrics.json": Values(Some((float, bool, str, Maybe(Values(Values(float)))))),
    "obstacles.json": {"tracks": [TRACK], "footprints?": [FOOTPRINT]},
    "views.json": [{"stamp": float, "name": str, "file": str}],
    "panorama.json": {
        "views": [{"placed": bool, "frame": int, "reason?": str}], "placed_by?": Values(int), "failed?": Maybe(str),
        "obstacles": [EDGES | LENGTHS | {"left_edge_m": CORNER, "right_edge_m": CORNER}], "gaps": [EDGES | LENGTHS],
    },
    "monocular.json": {"frames": int, "skipped?": Values(int), "judged": int, "iou?": Maybe(float), "iou_min?": Maybe(float)},
    "truth/ground.json": [{"name": str, "top_m": float, "outline_m": [POINT]}],
    "sessions.json": {
        "part": int,
        "sessions": [{
            "session": int, "name": str, "map": str, "recording": str, "digest": str, "frames": int, "part": int, "shift_s": float,
            "from_s": float, "to_s": float,
        }],
        "pairs": [{
            "sessions": [int, 2], "probability": Maybe(float), "merged": bool, "links": int, "views": int, "compared": int,
            "fitting": Maybe(float), "contradicting": Maybe(float), "moved?": int, "reason?": str,
        }],
        "parts": [[int]],
    },
    "changes.json": {
        "changes": [{
            "sessions": [int, 2], "kind": str, "probability": float, "before": Maybe(CHANGED), "after": Maybe(CHANGED),
        }],
    },
    "rooms.json": {
        "rooms": [{"number": int, "centre_m": POINT, "area_m2": float, "sigma_area_m2": float, "outline_m": [POINT]}],
        "doors": [
            {"rooms": [int, 2], "centre_m": POINT, "jambs_m": [POINT, 2], "width_m": float, "sigma_width_m": float}
        ],
        "floors": [[int]],
    },
    "truth/outlines.json": [{"parts_m": [[POINT]], "sides": [{"length_m": float, "seen": float}]}],
}  # fmt: skip


def check(value: Any, shape: Any, where: str = "") -> None:
    """Raise an UnreadableError that names the first place whose value is not of the shape."""
    if isinstance(shape, Maybe):
        if value is not None:
            check(value, shape.shape, where)
    elif isinstance(shape, Some):
        _check_some(value, shape, where)
    elif isinstance(shape, Values):
        _expect(isinstance(value, dict), where, "an object")
        for name, one in value.items():
            check(one, shape.shape, f"{where}.{name}")
    elif isinstance(shape, list):
        of, *count = shape
        right = isinstance(value, list) and (not count or len(value) == count[0])
        _expect(right, where, f"a list of {count[0]}" if count else "a list")
        for number, one in enumerate(value):
            check(one, of, f"{where}[{number}]")
    elif isinstance(shape, dict):
        _expect(isinstance(value, dict), where, "an object")
        for name, of in shape.items():
            key = name.removesuffix("?")
            _expect(key in value or key != name, f"{where}.{key}", "a value")
            if key in value:
                check(value[key], of, f"{where}.{key}")
    else:
        _expect(_is_plain(value, shape), where, NAMED[shape])


def _check_some(value: Any, shape: Some, where: str) -> None:
    faults = []
    for one in shape.shapes:
        try:
            check(value, one, where)
            return
        except UnreadableError as error:
            faults.append(error)
    raise faults[-1]


def _is_plain(value: Any, kind: type) -> bool:
    if kind is float:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return number and math.isfinite(value) and abs(value) <= MOST
    return type(value) is kind


def _expect(right: bool, where: str, what: str) -> None:
    if not right:
        raise UnreadableError(f"has at {where.removeprefix('.') or 'its top'} not {what}")
