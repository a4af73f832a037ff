"""Reading of image files, with checks: present, complete, of the right type and size, not empty.

Some data sets do not store depth but something to convert first. SUN RGB-D rotates the bits of millimetres by 3 to
the left. The first Kinect's raw values are disparities of 11 bits; 2047 means none. Values that look like either are
refused unless the description names the encoding.

Source: SUN RGB-D toolbox, read3dPoints.m; Burrus (2010), Kinect calibration (disparity to depth).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8, UInt16

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.safe_input import MissingError, UnreadableError

from ..words import count_of
from .codec import BACKGROUND_M, metres, metres_of_floats
from .recording import DESCRIPTION_FILE, FrameError

DEPTH_ADVICE = (
    "save depth as PNG of 16 bits, in millimetres, 0 without depth; or as TIFF or .npy of float32, in metres, with "
    "scale_per_metre = 1"
)
ENCODINGS = ("depth", "rotated", "kinect-disparity")
UNSTATED = ""
_CODED = ENCODINGS[1:]
PLAUSIBLE_WIDTHS = (0.08, 50.0)  # ours: focal length of a view of 161 deg and of 1.1 deg
_ROTATED_BITS = 3
_DISPARITY_NONE = 2047
_FULL = 65535  # no depth, stated or not: of cameras that mark pixels so, or beyond the last value
_MOST_DISPARITY = 1092  # the formula's depth is infinite at 1084.6
_OTHERS = 0.05  # ours: share of rotated values that are no multiples of 8, those beyond 8.2 m
_LEAST_VALUES = 50  # ours: fewer different values tell nothing

_PNG_START, _PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


@dataclass(frozen=True)
class DepthUnit:
    """Scale of a depth image.

    Args:
        per_metre: Units per metre.
        none: Values of pixels without depth.
        encoding: "depth"; "rotated", as in SUN RGB-D; or "kinect-disparity", the raw values of the first Kinect,
            for which the scale is ignored. Unstated: depth, unless the values look like one of the others.
    """

    per_metre: float
    none: tuple[int, ...]
    encoding: str = UNSTATED

    def __post_init__(self) -> None:
        if self.encoding not in (UNSTATED, *ENCODINGS):
            raise ConfigError(
                f"depth encoding {self.encoding!r} is unknown; expected one of {', '.join(ENCODINGS)}"
            )
        if not (np.isfinite(self.per_metre) and self.per_metre > 0.0):
            raise ConfigError(
                f"depth scale {self.per_metre} units per metre must be positive and finite; "
                "1000 for millimetres"
            )
        outside = [mark for mark in self.none if not 0 <= mark <= 65535]
        if outside:
            raise ConfigError(f"no-depth value {outside[0]} must lie between 0 and 65535")


def plausible(camera: Camera) -> Camera:
    """The camera, if its focal lengths can be in px.

    Raises:
        ConfigError: They cannot; a share of the width makes the view 180 deg wide and a map of it endless.
    """
    low, high = PLAUSIBLE_WIDTHS
    for name in ("fx", "fy"):
        value = getattr(camera, name)
        if not low * camera.width <= value <= high * camera.width:
            raise ConfigError(
                f"camera: {name}={value:g} px for an image {camera.width} px wide; expected pixels, "
                f"{low * camera.width:g} to {high * camera.width:g}, not metres or a share of the width (multiply "
                "that by the width)"
            )
    return camera


def read_depth(path: Path, camera: Camera, unit: DepthUnit) -> Float32[np.ndarray, "h w"]:
    """Read a depth image, m; NaN without depth.

    Of floats, whatever is not positive or not below 1000 m means no depth.

    Raises:
        FrameError: The file is missing, truncated, of another type or size, or has no valid pixel.
    """
    image = _read("depth", path, cv2.IMREAD_UNCHANGED)
    kinds = (np.uint16,) if unit.encoding in _CODED else (np.uint16, np.float32, np.float64)
    if image.ndim != 2 or image.dtype not in kinds:
        channels = 1 if image.ndim == 2 else image.shape[2]
        expected = "uint16" if unit.encoding in _CODED else "uint16, float32 or float64"
        advice = "an 8-bit picture has no depth" if image.dtype == np.uint8 else DEPTH_ADVICE
        raise FrameError(
            f"depth image has {count_of(channels, 'channel')} of {image.dtype}; one channel "
            f"of {expected} was expected ({advice})"
        )
    _check_size("depth", image, camera)
    if image.dtype != np.uint16:
        return _of_floats(image, unit)
    none = tuple(dict.fromkeys((*unit.none, _FULL)))
    if unit.encoding == "kinect-disparity":
        depth = _of_disparity(image)
    elif unit.encoding == "rotated":
        depth = metres(_rotated_back(image), unit.per_metre, unit.none)
    else:
        if unit.encoding == UNSTATED:
            _refuse_encoded(image)
        depth = metres(image, unit.per_metre, none)
    if not np.isfinite(depth).any():
        marks = " or ".join(str(mark) for mark in none)
        raise FrameError(f"depth image has no valid pixel: every value is {marks}")
    return depth


def trusted(
    depth: Float32[np.ndarray, "h w"], confidence: Path, camera: Camera
) -> Float32[np.ndarray, "h w"]:
    """Depth without the pixels of confidence 0.

    Raises:
        FrameError: The image of the confidence cannot be read, has another size, or leaves no pixel.
    """
    level = _read("confidence", confidence, cv2.IMREAD_GRAYSCALE)
    _check_size("confidence", level, camera)
    left = np.where(level > 0, depth, np.float32(np.nan))
    if not np.isfinite(left).any():
        raise FrameError("depth image has no pixel of confidence above 0")
    return left


def _of_floats(image: Float[np.ndarray, "h w"], unit: DepthUnit) -> Float32[np.ndarray, "h w"]:
    """Depth of floats, m."""
    with np.errstate(all="ignore"):
        depth = metres_of_floats(image / np.float64(unit.per_metre))
    depth[np.isin(image, unit.none)] = np.nan
    if not np.isfinite(depth).any():
        raise FrameError(
            f"depth image has no valid pixel: no value is positive and below {BACKGROUND_M:g} m"
        )
    return depth


def _rotated_back(image: UInt16[np.ndarray, "h w"]) -> UInt16[np.ndarray, "h w"]:
    """Undo the rotation of SUN RGB-D."""
    return np.asarray((image >> _ROTATED_BITS) | (image << (16 - _ROTATED_BITS)), np.uint16)


def _of_disparity(image: UInt16[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Depth of the first Kinect's raw disparity, m."""
    with np.errstate(divide="ignore"):
        depth = 1.0 / (3.3309495161 - 0.0030711016 * image.astype(np.float64))
    depth[(image == 0) | (image >= _DISPARITY_NONE) | (depth <= 0.0)] = np.nan
    return depth.astype(np.float32)


def _refuse_encoded(image: UInt16[np.ndarray, "h w"]) -> None:
    """Raise a FrameError for values that are no depth yet."""
    if int(image.max()) == _DISPARITY_NONE and int(
        image[image < _DISPARITY_NONE].max(initial=0)
    ) <= (_MOST_DISPARITY):
        raise FrameError(
            "depth image holds raw Kinect disparity (up to 1092, and 2047 for none), no depth; write "
            f'encoding = "kinect-disparity" under [depth] of a {DESCRIPTION_FILE}'
        )
    seen = image[image > 0]
    rotated = np.count_nonzero(seen & ((1 << _ROTATED_BITS) - 1)) <= _OTHERS * len(seen)
    if rotated and len(np.unique(seen)) >= _LEAST_VALUES:
        raise FrameError(
            "depth image holds multiples of 8 almost only, as the rotated millimetres of SUN RGB-D do; write "
            f'encoding = "rotated" under [depth] of a {DESCRIPTION_FILE}, or encoding = "depth" if they are depth'
        )


def read_colour(path: Path, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """Read a colour image as RGB; a grey image is repeated in the three channels.

    Raises:
        FrameError: The file is missing, truncated, not an image, or of another size.
    """
    image = _read("colour", path, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    _check_size("colour", image, camera)
    return image.astype(np.uint8, copy=False)


def first_size(where: Path, images: Sequence[Path], what: str = "depth") -> tuple[int, int]:
    """Width and height of the first image that can be read, px, for layouts that do not record them.

    Raises:
        RecordingError: None can be read.
    """
    reason = f"no {what} image found"
    for image in images:
        try:
            height, width = _read(what, image, cv2.IMREAD_UNCHANGED).shape[:2]
        except FrameError as error:
            reason = f"{image.name}: {error}"
        else:
            return width, height
    raise RecordingError(f"{where}: no frame can be used; {reason}")


def _read(what: str, path: Path, flags: int) -> np.ndarray:
    try:
        data = safe_input.data(path)
    except MissingError as error:
        raise FrameError(f"{what} image is missing") from error
    except UnreadableError as error:
        raise FrameError(f"{what} image {error}") from error
    if not data:
        raise FrameError(f"{what} image is an empty file")
    cut_png = data.startswith(_PNG_START) and _PNG_END not in data[-1024:]
    cut_jpeg = data.startswith(_JPEG_START) and _JPEG_END not in data[-1024:]
    if cut_png or cut_jpeg:  # checked here, because the decoders of OpenCV write to standard error
        raise FrameError(f"{what} image is truncated")
    try:
        if what == "depth" and safe_input.is_array(data):
            return _plane(safe_input.array(data))
        return safe_input.picture(data, flags)
    except UnreadableError as error:
        raise FrameError(f"{what} image {error}") from error


def _plane(array: np.ndarray) -> np.ndarray:
    """An array of rows and columns, or rows, columns and channels, as OpenCV would give it."""
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if array.ndim not in (2, 3):
        raise FrameError(
            f"depth image is an array of shape {array.shape}; (height, width) was expected"
        )
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _check_size(what: str, image: np.ndarray, camera: Camera) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise FrameError(
            f"{what} image is {width}x{height} px; {camera.width}x{camera.height} px was expected "
            "from the intrinsics"
        )
