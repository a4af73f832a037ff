"""One organised point cloud (PCD 0.7) as a recording of one frame.

A cloud with the rows and columns of its camera is a depth image: z is the depth, and the intrinsics follow from
the points, because u = fx x/z + cx for all of them. A cloud that no pinhole camera fits within half a pixel is
refused.

Source: pointclouds.org, the PCD file format; the fit of the intrinsics is ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.safe_input import UnreadableError

from ._lzf_kernels import lzf_decompress
from .folder import camera_of
from .recording import RecordingInfo, SkippedFrame

_TYPES = {"F": "f", "U": "u", "I": "i"}
_PINHOLE_PX = 0.5  # ours: a larger residual means another lens or a transformed cloud
_MIN_POINTS = 100  # ours: for the fit of the intrinsics


class PcdRecording:
    """An organised PCD file.

    Raises:
        RecordingError: The file is not PCD, truncated, not organised, or not the image of a pinhole camera.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._camera, self._depth, self._rgb = _read(path)
        camera = self._camera
        self.info = RecordingInfo(name=path.stem, kind="pcd", frames=1)
        self.remarks = [
            f"intrinsics fitted to the points: {camera.fx:.2f} {camera.fy:.2f} "
            f"{camera.cx:.2f} {camera.cy:.2f} px"
        ]

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Always empty: a file without a usable frame is refused."""
        return []

    def frames(self) -> Iterator[Frame]:
        """The frame, at time 0."""
        colour = None if self._rgb is None else ColourView(self._rgb, self._camera)
        yield Frame(0.0, depth=DepthView(self._depth, self._camera), colour=colour)


def _read(
    path: Path,
) -> tuple[Camera, Float32[np.ndarray, "h w"], UInt8[np.ndarray, "h w 3"] | None]:
    try:
        content = safe_input.data(path)
    except UnreadableError as error:
        raise RecordingError(f"{path}: {error}") from error
    header, body = _header(path, content)
    width, height = (_count(path, header, key) for key in ("WIDTH", "HEIGHT"))
    if height < 2 or width < 2:
        raise RecordingError(
            f"{path}: {width}x{height} is not organised; a depth image needs the rows and columns "
            "of a camera"
        )
    points = _points(path, header, body, width * height)
    missing = [axis for axis in "xyz" if axis not in (points.dtype.names or ())]
    if missing:
        raise RecordingError(f"{path}: has no field {missing[0]}; x, y and z were expected")
    with np.errstate(invalid="ignore"):  # some bits of "no depth" are a signalling NaN
        xyz = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    xyz = xyz.reshape(height, width, 3)
    seen = np.isfinite(xyz).all(axis=-1) & (xyz[..., 2] > 0.0)
    if seen.sum() < _MIN_POINTS:
        raise RecordingError(
            f"{path}: {int(seen.sum())} points in front of the camera; at least {_MIN_POINTS} were expected"
        )
    camera = _pinhole(path, xyz, seen)
    depth = np.where(seen, xyz[..., 2], np.nan).astype(np.float32)
    return camera, depth, _rgb(points, height, width)


def _header(path: Path, content: bytes) -> tuple[dict[str, list[str]], bytes]:
    if not content:
        raise RecordingError(f"{path}: the file is empty")
    header: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in header:
        end = content.find(b"\n", position)
        if end < 0 or end - position > 4096:
            raise RecordingError(f"{path}: is not a PCD file: its header has no line DATA")
        words = content[position:end].decode("latin-1").split()
        position = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT"):
        if not header.get(key):
            raise RecordingError(f"{path}: its header has no line {key}; PCD 0.7 was expected")
    return header, content[position:]


def _count(path: Path, header: dict[str, list[str]], key: str) -> int:
    word = header[key][0]
    found = safe_input.whole(word)
    if found is None:
        raise RecordingError(f"{path}: {key} {word[:20]} in its header is not a number")
    return found


def _points(path: Path, header: dict[str, list[str]], body: bytes, count: int) -> np.ndarray:
    """The points as a structured array."""
    names, sizes, kinds = header["FIELDS"], header["SIZE"], header["TYPE"]
    repeats = header.get("COUNT", ["1"] * len(names))
    try:
        fields = [
            (name if name != "_" else f"_{i}", f"<{_TYPES[kind]}{size}", (int(repeat),))
            for i, (name, size, kind, repeat) in enumerate(
                zip(names, sizes, kinds, repeats, strict=True)
            )
        ]
        record = np.dtype([(n, t) if r == (1,) else (n, t, r) for n, t, r in fields])
    except (KeyError, ValueError, TypeError) as error:
        raise RecordingError(
            f"{path}: FIELDS, SIZE, TYPE and COUNT do not agree ({error})"
        ) from error
    data = header["DATA"][0] if header["DATA"] else ""
    if data == "ascii":
        return _ascii(path, record, body, count)
    if data == "binary":
        if len(body) < count * record.itemsize:
            raise _truncated(path, len(body), count * record.itemsize)
        return np.frombuffer(body, record, count)
    if data == "binary_compressed":
        return _compressed(path, record, body, count)
    raise RecordingError(f"{path}: DATA {data!r}; ascii, binary or binary_compressed was expected")


def _ascii(path: Path, record: np.dtype, body: bytes, count: int) -> np.ndarray:
    lines = [tuple(line.split()) for line in body.decode("latin-1").splitlines() if line.strip()]
    if len(lines) < count:
        raise RecordingError(f"{path}: is truncated: {len(lines)} of {count} points")
    try:
        return np.array(lines[:count], dtype=record)
    except ValueError as error:
        raise RecordingError(f"{path}: a point cannot be parsed ({error})") from error


def _compressed(path: Path, record: np.dtype, body: bytes, count: int) -> np.ndarray:
    """Points of binary_compressed: field after field, compressed as one block by LZF."""
    if len(body) < 8:
        raise _truncated(path, len(body), 8)
    packed_size, size = (int(v) for v in np.frombuffer(body, "<u4", 2))
    if len(body) - 8 < packed_size:
        raise _truncated(path, len(body) - 8, packed_size)
    if size != count * record.itemsize:
        raise RecordingError(
            f"{path}: unpacks to {size} bytes; {count} points of {record.itemsize} were expected"
        )
    unpacked = lzf_decompress(np.frombuffer(body, np.uint8, packed_size, 8), size)
    if unpacked.size != size:
        raise RecordingError(f"{path}: its compressed points are damaged")
    points = np.empty(count, record)
    offset = 0
    for name in record.names or ():
        field = record[name]
        block = unpacked[offset : offset + count * field.itemsize]
        points[name] = block.view(field.base).reshape(count, *field.shape)
        offset += block.size
    return points


def _truncated(path: Path, found: int, expected: int) -> RecordingError:
    return RecordingError(f"{path}: is truncated: {found} of {expected} bytes of points")


def _pinhole(path: Path, xyz: np.ndarray, seen: np.ndarray) -> Camera:
    """Least squares of u = fx x/z + cx and v = fy y/z + cy over all points."""
    v, u = np.nonzero(seen)
    x, y, z = xyz[seen].T
    found = []
    for pixel, slope in ((u, x / z), (v, y / z)):
        design = np.stack([slope, np.ones_like(slope)], axis=1)
        solution, _, rank, _ = np.linalg.lstsq(design, pixel.astype(np.float64), rcond=None)
        fault = np.inf if rank < 2 else float(np.abs(design @ solution - pixel).max())
        if fault > _PINHOLE_PX:
            raise RecordingError(
                f"{path}: no pinhole camera fits the points: largest residual {fault:.1f} px, "
                f"{_PINHOLE_PX} px allowed; untransformed points (x right, y down, z forward) were expected"
            )
        found.append(solution)
    (fx, cx), (fy, cy) = found
    height, width = seen.shape
    return camera_of(
        path, width=width, height=height, fx=float(fx), fy=float(fy), cx=float(cx), cy=float(cy)
    )


def _rgb(points: np.ndarray, height: int, width: int) -> UInt8[np.ndarray, "h w 3"] | None:
    name = next((n for n in ("rgb", "rgba") if n in (points.dtype.names or ())), None)
    if name is None or points.dtype[name].itemsize != 4:
        return None
    packed = np.ascontiguousarray(points[name]).view(np.uint32)
    rgb = np.stack([packed >> 16, packed >> 8, packed], axis=-1) & 0xFF
    return rgb.astype(np.uint8).reshape(height, width, 3)
