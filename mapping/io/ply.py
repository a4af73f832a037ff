"""Reads the points and triangles of a binary PLY, as `clouds.save_ply` and `surface.meshes` write it; no content can crash it.

Source: Turk, "The PLY polygon file format" (1994).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Int32

from perception.primitives import safe_input
from perception.primitives.safe_input import UnreadableError

_KINDS = {
    "char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4", "float": "<f4", "double": "<f8",
    "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2", "int32": "<i4", "uint32": "<u4", "float32": "<f4",
    "float64": "<f8",
}  # fmt: skip
_TRIANGLE = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])
_TRIANGLES = re.compile(
    rb"element face (\d{1,9})\r?\nproperty list uchar u?int vertex_ind(?:ex|ices)\r?\n$"
)
_HEADER = re.compile(rb"ply\r?\n(.{0,20000}?)end_header\r?\n", re.DOTALL)


def read_points(path: str | Path) -> np.ndarray:
    """The points of a file: an array with one field per property.

    Raises:
        UnreadableError: It is missing, damaged, not binary, or has no points with x, y and z first.
    """
    return _points(safe_input.data(path))[0]


def read_mesh(path: str | Path) -> tuple[np.ndarray, Int32[np.ndarray, "m 3"]]:
    """The points of a file as `read_points` gives them, and its triangles, indices of points.

    Raises:
        UnreadableError: As of `read_points`; or something other than triangles follows the points.
    """
    content = safe_input.data(path)
    points, header = _points(content)
    faces = _TRIANGLES.search(header[1])
    if faces is None:
        raise UnreadableError("has something other than triangles after its points")
    begin, count = header.end() + points.nbytes, int(faces[1])
    if len(content) - begin < count * _TRIANGLE.itemsize:
        raise UnreadableError(f"is cut off: {count} triangles were expected")
    triangles = np.frombuffer(content, _TRIANGLE, count, begin)
    corners = np.ascontiguousarray(triangles["corners"])
    if (triangles["count"] != 3).any() or ((corners < 0) | (corners >= len(points))).any():
        raise UnreadableError("has a face that is no triangle of its points")
    return points, corners


def _points(content: bytes) -> tuple[np.ndarray, re.Match[bytes]]:
    """The points, and the match of the header."""
    header = _HEADER.match(content)
    if header is None:
        raise UnreadableError("is no PLY")
    fields: dict[str, str] = {}
    count, element = 0, ""
    for line in header[1].decode("ascii", "replace").splitlines():
        word, *words = line.split() or [""]
        if word == "format" and words[:1] != ["binary_little_endian"]:
            raise UnreadableError(f"is PLY in the format {' '.join(words)}; binary was expected")
        if word == "element":
            if element:  # what follows the points is not read
                break
            element, count = words[0], safe_input.whole(words[-1]) or 0
        if word == "property" and len(words) == 2 and words[0] in _KINDS:
            fields[words[1]] = _KINDS[words[0]]
        elif word == "property":
            raise UnreadableError(f"has a property that is no number: {line}")
    if element != "vertex" or not {"x", "y", "z"} <= set(fields):
        raise UnreadableError("holds no points")
    record = np.dtype(list(fields.items()))
    if len(content) - header.end() < count * record.itemsize:
        raise UnreadableError(f"is cut off: {count} points were expected")
    return np.frombuffer(content, record, count, header.end()), header
