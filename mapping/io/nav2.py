"""Occupancy maps as files for ROS: the yaml and image pair of map_server and Nav2.

Image row 0 is the top, the largest y. In a trinary map 254 is free, 0 occupied, 205 unknown. In a map of mode
"scale" the darkness of a pixel is the probability, and a transparent pixel is unknown. The yaml gives the lower
left corner of the lower left pixel.

Source: the map_server format, "trinary" and "scale" modes.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from .atomic_write import atomic_path

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
OCCUPIED_ABOVE = 0.65  # map_server: default occupied_thresh
FREE_BELOW = 0.196  # map_server: free_thresh; with Nav2's 0.25 an unknown pixel would read as free


class OccupancyMap(NamedTuple):
    """An occupancy map read from a file.

    Args:
        probability: (rows, columns), p that an obstacle covers the cell; row 0 at the smallest y.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell, m.
        known: (rows, columns), whether the cell was ever seen.
    """

    probability: Float32[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float
    known: Bool[np.ndarray, "rows columns"]


def save(
    folder: str | Path,
    name: str,
    probability: Float32[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Path:
    """Write `name.pgm`, then `name.yaml`; each is complete or absent. Returns the yaml's path.

    An empty map is written as one unknown cell, so that map readers accept it.

    Args:
        folder: An existing folder.
        name: Name of both files, without suffix.
        probability: p that an obstacle covers the cell; row 0 at the smallest y.
        known: Whether the cell was ever seen. Unseen cells, and p between the thresholds, are unknown.
        origin: Lower left corner of cell [0, 0], world frame, m.
        cell_m: Side of a cell, m.

    Raises:
        OutputError: The folder cannot be written.
    """
    rows, columns = max(1, probability.shape[0]), max(1, probability.shape[1])
    pixels = np.full((rows, columns), UNKNOWN, np.uint8)
    if probability.size:
        pixels[known & (probability < FREE_BELOW)] = FREE
        pixels[known & (probability > OCCUPIED_ABOVE)] = OCCUPIED
    with atomic_path(Path(folder) / f"{name}.pgm") as path:
        path.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + pixels[::-1].tobytes())
    return _save_yaml(
        Path(folder) / f"{name}.yaml",
        f"{name}.pgm",
        "trinary",
        (FREE_BELOW, OCCUPIED_ABOVE),
        origin,
        cell_m,
    )


def save_scale(
    folder: str | Path,
    name: str,
    probability: Float32[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Path:
    """Write `name.png`, then `name.yaml`, of mode "scale"; arguments and errors as for `save`.

    Nav2 reads such a pixel as an occupancy of 100 times its probability.
    """
    rows, columns = max(1, probability.shape[0]), max(1, probability.shape[1])
    pixels = np.zeros((rows, columns, 4), np.uint8)
    if probability.size:
        pixels[..., :3] = np.rint(255 * (1 - probability))[..., np.newaxis]
        pixels[..., 3] = np.where(known, 255, 0)
    done, data = cv2.imencode(".png", pixels[::-1])
    assert done
    with atomic_path(Path(folder) / f"{name}.png") as path:
        path.write_bytes(data.tobytes())
    return _save_yaml(
        Path(folder) / f"{name}.yaml", f"{name}.png", "scale", (0.0, 1.0), origin, cell_m
    )


def _save_yaml(
    target: Path,
    image: str,
    mode: str,
    thresholds: tuple[float, float],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
) -> Path:
    free, occupied = thresholds
    # without an exponent: YAML takes 5e-05, which has no dot, for a text
    x, y, side = (np.format_float_positional(v, trim="0") for v in (*origin.astype(float), cell_m))
    yaml = (
        f"image: {image}\n"
        f"mode: {mode}\n"
        f"resolution: {side}\n"
        f"origin: [{x}, {y}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {occupied}\n"
        f"free_thresh: {free}\n"
    )
    with atomic_path(target) as path:
        path.write_text(yaml, encoding="utf-8")
    return target


def load(path: str | Path) -> OccupancyMap:
    """Read a map by its yaml file, as map_server does.

    Mode "trinary" gives p of 0 (free), 0.5 (unknown) or 1 (occupied). In mode "scale" p rises linearly from the one
    threshold to the other, and transparent pixels of a PNG are unknown.

    Raises:
        InputError: A file is missing, truncated or of another format, or the map is rotated.
    """
    path = Path(path)
    entries = _entries(path)
    image = entries["image"].strip("\"'")
    pixels, opaque = _read_image(path.parent / image)
    cell_m = _number(path, entries, "resolution")
    if not cell_m > 0.0:
        raise InputError(f"{path}: resolution={cell_m} must be positive, metres per pixel")
    origin = _origin(path, entries["origin"])
    light = pixels[::-1].astype(np.float32) / 255
    p = light if entries.get("negate", "0") in ("1", "true") else 1 - light
    high, low = (_number(path, entries, f"{name}_thresh") for name in ("occupied", "free"))
    occupied, free = p > high, p < low
    mode = entries.get("mode", "trinary")
    if mode == "trinary":
        trinary = np.where(occupied, 1, np.where(free, 0, 0.5)).astype(np.float32)
        return OccupancyMap(trinary, origin, cell_m, occupied | free)
    if mode == "scale":
        between = (p - np.float32(low)) / np.float32(max(high - low, 1e-6))
        scaled = np.where(occupied, np.float32(1), np.where(free, np.float32(0), between))
        known = opaque[::-1].copy()
        return OccupancyMap(np.where(known, scaled, np.float32(0.5)), origin, cell_m, known)
    raise InputError(f"{path}: mode {mode!r} is not supported; save the map as trinary or scale")


def _entries(path: Path) -> dict[str, str]:
    """The flat `key: value` lines of the yaml, comments removed."""
    try:
        text = safe_input.text(path)
    except UnreadableError as error:
        raise InputError(f"map {path} {error}; give the .yaml of a map") from error
    entries = {}
    for line in text.splitlines():
        match = re.match(r"^(\w+)\s*:\s*(.*?)\s*(#.*)?$", line)
        if match:
            entries[match[1]] = match[2]
    for key in ("image", "resolution", "origin", "occupied_thresh", "free_thresh"):
        if not entries.get(key):
            raise InputError(f"{path}: no {key}; expected the yaml of a map_server map")
    return entries


def _number(path: Path, entries: dict[str, str], key: str) -> float:
    try:
        return float(entries[key])
    except ValueError as error:
        raise InputError(f"{path}: {key}={entries[key]!r} must be a number") from error


def _origin(path: Path, text: str) -> Float[np.ndarray, "2"]:
    try:
        x, y, yaw = (float(part) for part in text.strip("[]").split(","))
    except ValueError as error:
        raise InputError(f"{path}: origin={text!r} must be [x, y, yaw]") from error
    if abs(yaw) > 1e-9:
        raise InputError(
            f"{path}: origin is rotated by {yaw} rad; only maps with yaw 0 are supported"
        )
    return np.array([x, y])


def _read_image(
    path: Path,
) -> tuple[UInt8[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Grey values of a PGM or PNG, and which pixels are opaque."""
    if path.suffix.lower() != ".png":
        pixels = _read_pgm(path)
        return pixels, np.ones(pixels.shape, np.bool_)
    try:
        image = safe_input.picture(safe_input.data(path), cv2.IMREAD_UNCHANGED)
    except UnreadableError as error:
        raise InputError(
            f"map image {path}: {error}; a PNG was expected beside the yaml"
        ) from error
    if image.dtype != np.uint8:
        raise InputError(f"map image {path} has values of {image.dtype}; 8 bits were expected")
    channels = image if image.ndim == 3 else image[..., np.newaxis]
    grey = channels[..., : min(3, channels.shape[-1])].mean(axis=-1)
    opaque = channels[..., 3] == 255 if channels.shape[-1] == 4 else np.ones(grey.shape, np.bool_)
    return np.rint(grey).astype(np.uint8), opaque


def _read_pgm(path: Path) -> UInt8[np.ndarray, "rows columns"]:
    """A binary PGM of one byte per pixel; comments in its header are skipped."""
    try:
        content = safe_input.data(path)
    except UnreadableError as error:
        raise InputError(f"map image {path} {error}; it must be beside the yaml") from error
    gap = rb"(?:\s|#[^\n]*\n)+"
    header = re.match(
        rb"P5" + gap + rb"(\d{1,9})" + gap + rb"(\d{1,9})" + gap + rb"(\d{1,9})\s", content
    )
    if header is None or int(header[3]) != 255:
        raise InputError(f"map image {path}: expected a binary PGM (P5) with 255 grey levels")
    columns, rows = int(header[1]), int(header[2])
    body = content[header.end() :]
    if len(body) < rows * columns or rows * columns == 0:
        raise InputError(
            f"map image {path}: {len(body)} bytes of pixels, expected {rows * columns}; it is truncated"
        )
    return np.frombuffer(body, np.uint8, rows * columns).reshape(rows, columns)
