"""Conversion of ROS messages: camera, depth image, colour image.

Sources: sensor_msgs (Image, CompressedImage, CameraInfo); REP 104 (lenses); image_geometry (which numbers
belong to which image); REP 118; compressed_depth_image_transport (a header of 12 bytes before the PNG, and
for metres depth = A / (value - B)).
"""

from __future__ import annotations

import re
import struct
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.safe_input import UnreadableError

from .codec import metres_of_floats
from .images import plausible
from .recording import FrameError

_DEPTHS: dict[str, np.dtype[Any]] = {
    "16UC1": np.dtype(np.uint16),
    "mono16": np.dtype(np.uint16),
    "32FC1": np.dtype(np.float32),
}
_COLOURS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1, "8UC3": 3}
_RVL = "compressedDepth rvl"
_TRANSPORTS = ("compressed", "compressedDepth")
_POLYNOMIALS = ("plumb_bob", "rational_polynomial", "")
"""Lens models with the coefficients of OpenCV; their number decides, as in image_geometry."""


def is_depth_encoding(encoding: str) -> bool:
    """Whether an encoding is that of depth images (REP 118)."""
    return encoding in _DEPTHS


def is_rectified(topic: str) -> bool:
    """Whether the name of a topic marks rectified images, such as /a/image_rect, /a/image_rect_raw/compressed.

    A word of the last part must begin with `rect`; image_direct and image_unrectified do not match.
    """
    parts = topic.split("/")
    name = parts[-2] if parts[-1] in _TRANSPORTS and len(parts) > 1 else parts[-1]
    return re.search("(?:^|[^A-Za-z])rect|Rect", name) is not None


def camera_of_info(message: Any, rectified: bool) -> Camera:
    """The camera of a CameraInfo message.

    Args:
        message: CameraInfo of ROS 1 or ROS 2.
        rectified: Whether the images are rectified: then P without distortion (K if P is zero), else K and D.

    Raises:
        ConfigError: The intrinsics are invalid, or the lens model is unknown.
    """
    P = _numbers(message, "p").reshape(3, 4)
    K = P if rectified and P[0, 0] != 0.0 else _numbers(message, "k").reshape(3, 3)
    return plausible(
        Camera(
            int(message.width),
            int(message.height),
            float(K[0, 0]),
            float(K[1, 1]),
            float(K[0, 2]),
            float(K[1, 2]),
            (0.0,) * 5 if rectified else _lens(message),
        )
    )


def depth_image(message: Any, camera: Camera, compressed: bool) -> Float32[np.ndarray, "h w"]:
    """Depth, m; NaN without depth.

    Raises:
        FrameError: The image has another encoding or size, too few bytes, or no valid pixel.
    """
    depth = _compressed_depth(message) if compressed else _raw_depth(message)
    _check_size("depth", depth, camera)
    if not np.isfinite(depth).any():
        raise FrameError("depth image has no valid pixel")
    return depth


def colour_image(message: Any, camera: Camera, compressed: bool) -> UInt8[np.ndarray, "h w 3"]:
    """Colour as RGB.

    Raises:
        FrameError: The image has another encoding or size, or too few bytes.
    """
    if compressed:
        try:
            rgb = safe_input.picture(bytes(message.data), cv2.IMREAD_COLOR_RGB)
        except UnreadableError as error:
            raise FrameError(f"colour image {error}") from error
    else:
        channels = _COLOURS.get(message.encoding)
        if channels is None:
            raise FrameError(
                f"colour image is encoded as {message.encoding!r}; expected one of {', '.join(_COLOURS)}"
            )
        image = _rows("colour", message, np.dtype(np.uint8), channels)
        rgb = np.repeat(image, 3, axis=2) if channels == 1 else image[..., :3]
        if message.encoding.startswith("bgr") or message.encoding == "8UC3":
            rgb = rgb[..., ::-1]
    _check_size("colour", rgb, camera)
    return np.ascontiguousarray(rgb, dtype=np.uint8)


def _numbers(message: Any, field: str) -> Float64[np.ndarray, "n"]:
    """A list of CameraInfo; ROS 1 uses upper-case names."""
    name = field if hasattr(message, field) else field.upper()
    return np.asarray(getattr(message, name), dtype=np.float64).ravel()


def _lens(message: Any) -> tuple[float, ...]:
    """Distortion of a raw image; five zeros if all coefficients are zero, for any model."""
    model, D = str(message.distortion_model), _numbers(message, "d")
    if not D.any():
        return (0.0,) * 5
    if model in _POLYNOMIALS and not D[5:].any():
        return tuple(np.pad(D[:5], (0, max(0, 5 - len(D)))).tolist())
    if model in _POLYNOMIALS and len(D) >= 8 and not D[8:].any():
        return tuple(D[:8].tolist())
    raise ConfigError(
        f"camera: distortion_model={model!r} with coefficients ({', '.join(f'{v:g}' for v in D)}) is not a "
        "supported lens; expected plumb_bob with up to 5 or rational_polynomial with 8; rectify the images with "
        "ROS's image_proc (depth with interpolation 0) and record its image_rect instead of them"
    )


def _raw_depth(message: Any) -> np.ndarray:
    kind = _DEPTHS.get(message.encoding)
    if kind is None:
        raise FrameError(
            f"depth image is encoded as {message.encoding!r}; expected one of {', '.join(_DEPTHS)}"
        )
    return _metres(_rows("depth", message, kind, 1)[..., 0])


def _rows(what: str, message: Any, kind: np.dtype[Any], channels: int) -> np.ndarray:
    """Pixels (h, w, channels) of an Image without row padding."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    needed = width * channels * kind.itemsize
    if step < needed or len(data) < height * step:
        raise FrameError(
            f"{what} image has {len(data)} bytes; {height} rows of {max(step, needed)} were expected"
        )
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :needed])
    other = kind.newbyteorder(">") if message.is_bigendian else kind.newbyteorder("<")
    return rows.view(other).reshape(height, width, channels)


def _compressed_depth(message: Any) -> np.ndarray:
    data = bytes(message.data)
    if _RVL in message.format:
        raise FrameError("depth image is compressed by RVL, which is not read; expected PNG")
    start = data.find(b"\x89PNG")
    try:
        image = safe_input.picture(data[max(start, 0) :], cv2.IMREAD_UNCHANGED)
    except UnreadableError as error:
        raise FrameError(f"compressed depth image {error}") from error
    if start < 0 or image.ndim != 2 or image.dtype != np.uint16:
        raise FrameError("compressed depth image has no PNG with one channel of uint16")
    if "32FC1" not in message.format:
        return _metres(image)
    if start < 12:
        raise FrameError("compressed depth image lacks the header of 12 bytes with its scale")
    _, a, b = struct.unpack("<iff", data[start - 12 : start])
    with np.errstate(divide="ignore"):
        metres = a / (image.astype(np.float32) - np.float32(b))
    return np.where(image > 0, metres, np.nan).astype(np.float32)


def _metres(image: np.ndarray) -> np.ndarray:
    """Depth from millimetres (0 without depth) or from metres as floats."""
    if image.dtype.kind == "u":
        return np.where(image > 0, image * np.float32(1e-3), np.nan).astype(np.float32)
    return metres_of_floats(image)


def _check_size(what: str, image: np.ndarray, camera: Camera) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise FrameError(
            f"{what} image is {width}x{height} px; {camera.width}x{camera.height} px was expected "
            "from camera_info"
        )
