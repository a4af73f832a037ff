"""Layers of a map as one GeoTIFF: float bands that GDAL, QGIS, rasterio and grid_map tools read.

The file is plain TIFF, uncompressed, with all bands of a pixel together, north (+y) up. Its axes are those of the map, in metres, as a
local coordinate system: the tie point is the upper left corner, and a pixel is a cell. NaN means "not seen".

Source: TIFF 6.0; OGC GeoTIFF 1.1 (19-008r4); names of bands and NaN in the tags of GDAL.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, unescape

import numpy as np
from jaxtyping import Float, Float32

from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from .atomic_write import atomic_path

SHORT, LONG, DOUBLE, ASCII = 3, 4, 12, 2
CITATION = "map frame, metres"
GEO_KEYS = (  # version 1.1.0, then (key, 0, 1, value), or (key, tag, length, offset) for the text
    *(1, 1, 0, 4),
    *(1024, 0, 1, 32767),  # model type: user defined, so a local system
    *(1025, 0, 1, 1),  # a pixel is an area
    *(1026, 34737, len(CITATION) + 1, 0),
    *(3076, 0, 1, 9001),  # metre
)


def save(
    path: str | Path,
    layers: Mapping[str, Float32[np.ndarray, "rows columns"]],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Path:
    """Write the layers as bands, complete or absent; returns the path.

    An empty map is written as one cell that was not seen.

    Args:
        path: File name that ends in .tif.
        layers: Name and values of each band, row 0 at the smallest y.
        origin: Lower left corner of cell [0, 0], map frame, m.
        cell_m: Side of a cell, m.

    Raises:
        InputError: The suffix is another one, or the layers differ in shape.
        OutputError: The folder cannot be written.
    """
    path = Path(path)
    if path.suffix != ".tif":
        raise InputError(f"map layers {path}: expected a name that ends in .tif")
    shapes = {layer.shape for layer in layers.values()}
    if len(shapes) != 1:
        raise InputError(f"map layers {path}: shapes {sorted(shapes)}; give layers of one shape")
    planes = np.stack(list(layers.values()))
    if not planes.size:
        planes = np.full((len(layers), 1, 1), np.nan)
    bands, rows, columns = planes.shape
    names = "".join(
        f'<Item name="DESCRIPTION" sample="{band}" role="description">{escape(name)}</Item>'
        for band, name in enumerate(layers)
    )
    top = float(origin[1]) + rows * cell_m
    tags = [
        (256, LONG, (columns,)),
        (257, LONG, (rows,)),
        (258, SHORT, (32,) * bands),  # bits
        (259, SHORT, (1,)),  # no compression
        (262, SHORT, (1,)),  # black is zero
        (273, LONG, (0,)),  # offset of the pixels, below
        (277, SHORT, (bands,)),
        (278, LONG, (rows,)),
        (279, LONG, (planes.size * 4,)),
        (284, SHORT, (1,)),  # all bands of a pixel together
        (338, SHORT, (0,) * (bands - 1)),  # the other bands are no colours
        (339, SHORT, (3,) * bands),  # floating point
        (33550, DOUBLE, (cell_m, cell_m, 0.0)),
        (33922, DOUBLE, (0.0, 0.0, 0.0, float(origin[0]), top, 0.0)),
        (34735, SHORT, GEO_KEYS),
        (34737, ASCII, f"{CITATION}|".encode() + b"\0"),
        (42112, ASCII, f"<GDALMetadata>{names}</GDALMetadata>".encode() + b"\0"),
        (42113, ASCII, b"nan\0"),
    ]
    pixels = np.moveaxis(planes[:, ::-1], 0, -1).astype("<f4")
    with atomic_path(path) as temporary:
        temporary.write_bytes(_header([tag for tag in tags if tag[2]]) + pixels.tobytes())
    return path


def load(
    path: str | Path,
) -> tuple[dict[str, Float32[np.ndarray, "rows columns"]], Float[np.ndarray, "2"], float]:
    """Layers by name, origin and side of a cell, of a file that `save` wrote.

    Raises:
        InputError: The file cannot be read, or was written by something else.
    """
    try:
        content = safe_input.data(path)
        tags = _tags(content)
        names = re.findall(r'sample="\d+"[^>]*>([^<]*)</Item>', tags[42112].decode())
        (columns,), (rows,), (start,) = tags[256], tags[257], tags[273]
        pixels = np.frombuffer(content, "<f4", rows * columns * len(names), start)
        planes = pixels.reshape(rows, columns, len(names))[::-1].astype(np.float32)
        layers = {unescape(name): planes[..., band] for band, name in enumerate(names)}
        cell_m, (left, top) = float(tags[33550][0]), tags[33922][3:5]
    except UnreadableError as error:
        raise InputError(f"map layers {path} {error}") from error
    except (KeyError, ValueError, TypeError, struct.error, AttributeError) as error:
        raise InputError(
            f"map layers {path}: expected map_layers.tif of a run; open others with GDAL"
        ) from error
    return layers, np.array([left, top - rows * cell_m]), cell_m


def _tags(content: bytes) -> dict[int, Any]:
    """Values of the tags of a little-endian TIFF, as tuples or bytes."""
    codes = {SHORT: "H", LONG: "I", DOUBLE: "d"}
    magic, version, at = struct.unpack_from("<2sHI", content)
    if (magic, version) != (b"II", 42):
        raise ValueError("no little-endian TIFF")
    found: dict[int, Any] = {}
    for entry in range(struct.unpack_from("<H", content, at)[0]):
        place = at + 2 + 12 * entry
        number, kind, count = struct.unpack_from("<HHI", content, place)
        size = count * (1 if kind == ASCII else struct.calcsize(codes[kind]))
        start = place + 8 if size <= 4 else struct.unpack_from("<I", content, place + 8)[0]
        found[number] = (
            content[start : start + size]
            if kind == ASCII
            else struct.unpack_from(f"<{count}{codes[kind]}", content, start)
        )
    return found


def _header(tags: list[tuple[int, int, tuple[int | float, ...] | bytes]]) -> bytes:
    """Everything before the pixels, which follow at once."""
    codes = {SHORT: "H", LONG: "I", DOUBLE: "d"}
    first = 8 + 2 + 12 * len(tags) + 4  # of the values that do not fit into their tag
    sizes = [
        len(values) if kind == ASCII else len(values) * struct.calcsize(codes[kind])
        for _, kind, values in tags
    ]
    end = first + sum(size + size % 2 for size in sizes if size > 4)
    entries, more = b"", b""
    for (number, kind, values), size in zip(tags, sizes, strict=True):
        if number == 273:
            values = (end,)
        data = (
            values
            if isinstance(values, bytes)
            else struct.pack(f"<{len(values)}{codes[kind]}", *values)
        )
        entries += struct.pack("<HHI", number, kind, len(values))
        if size > 4:
            entries += struct.pack("<I", first + len(more))
            more += data + b"\0" * (size % 2)
        else:
            entries += data.ljust(4, b"\0")
    head = struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + struct.pack("<I", 0)
    return head + more
