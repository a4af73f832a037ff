"""Input of the public functions, converted to what the algorithms take, or refused with what was expected."""

from __future__ import annotations

import dataclasses
import operator
import reprlib
import typing
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Float32, UInt8

from perception.depth import structured_light, time_of_flight
from perception.depth.reach import ReachConfig
from perception.depth.sources import SENSORS
from perception.depth.structured_light import StructuredLightConfig
from perception.primitives import plugins
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, DepthView, Imu, RangeView, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3
from planning.commands import GazeCommand

from .. import __all__ as PUBLIC
from ..config import toml
from ..recordings.codec import LARGEST, metres_of_floats

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    ArrayLike = object  # anything: the functions here look at it themselves

C = TypeVar("C")
MILLIMETRES = 50.0  # ours: a median depth above this, in m, is a depth in millimetres
DIVIDED_TWICE = 0.01  # ours: a median depth below this, in m, was in metres before scale_per_metre
LEAST_SIGMA_M = 1e-6  # ours: below any sensor; what a number of 32 bits resolves at 10 m


ENTRIES: dict[type, dict[str, Any]] = {
    Camera: dict.fromkeys(("width", "height", "fx", "fy", "cx", "cy"), ()),
    Pose2: {"x": (), "y": (), "yaw": ()},
    Pose3: {"translation": (3,), "quat_xyzw": (4,)},
    Plane: {"normal": (3,), "offset_m": (), "covariance": (3, 3)},
    Gaussian: {"mean": (3,), "covariance": (3, 3)},  # of a body's pose: no other is taken
    Landmark: {"identity": (), "position": (3,), "side_m": ()},
    GazeCommand: {"pan_rad": (), "tilt_rad": ()},
    StepOdometry: {"motion": Pose2, "steps": (), "rise_m": ()},
    Imu: {"angular_velocity": (3,), "specific_force": (3,)},
}
"""Values that the functions take: shape of each entry, or its class."""
HINTS: dict[type, str] = {
    Pose3: "; from a (4, 4) matrix: surefoot.Pose3.from_matrix(T)",
    Plane: ", as find_floor returns it; a direction goes to `up`",
    Mapping: ' of names to values, such as {"reach.tof.farthest_m": 2.5}',
}
"""What else helps to give such a value."""


def instance(value: Any, kind: type[C], what: str) -> C:
    """A value, if it is one of this class, with finite numbers of the right shapes.

    Raises:
        InputError: Otherwise.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what} is a {type(value).__name__}; expected {_made(kind)}")
    for name, inner in ENTRIES.get(kind, {}).items():
        part = getattr(value, name)
        if isinstance(inner, type):
            instance(part, inner, f"{what}.{name}")
        else:
            numbers(part, inner, f"{what}.{name}")
    return value


def _made(kind: type) -> str:
    """How a value of a class is made."""
    public = f"surefoot.{kind.__name__}" if kind.__name__ in PUBLIC else kind.__name__
    entries = ", ".join(ENTRIES.get(kind, {}))
    return public + f"({entries})" * bool(entries) + HINTS.get(kind, "")


def optional(value: Any, kind: type[C], what: str) -> C | None:
    """As `instance`, or None."""
    return None if value is None else instance(value, kind, what)


def every(values: Any, kind: type[C], what: str) -> tuple[C, ...]:
    """As `instance`, for each of several values.

    Raises:
        InputError: They are none, or not several.
    """
    if not isinstance(values, Iterable):
        raise InputError(f"{what} is a {type(values).__name__}; expected a list of {_made(kind)}")
    return tuple(instance(one, kind, f"{what}[{i}]") for i, one in enumerate(values))


def path(value: Any, what: str) -> Path:
    """A path.

    Raises:
        InputError: It is neither text nor a path.
    """
    if not isinstance(value, (str, PathLike)):
        raise InputError(f"{what} is a {type(value).__name__}; expected a path")
    return Path(value)


def plugin(value: Any, what: str) -> str:
    """The name of an implementation, given as such or as a class.

    Raises:
        InputError: It is neither.
    """
    if not isinstance(value, (str, type)):
        raise InputError(
            f'{what} is a {type(value).__name__}; expected a name, "package.module:Class", or a class itself'
        )
    return plugins.name_of(value)


def array(
    values: Any, what: str, expected: str, kinds: str, axes: Sequence[int]
) -> npt.NDArray[Any]:
    """An array.

    Args:
        values: To convert.
        what: Name of the argument, for messages.
        expected: What is expected, for messages.
        kinds: Allowed `dtype.kind`.
        axes: Allowed numbers of axes.

    Raises:
        InputError: It is missing, no array, or of another kind or number of axes.
    """
    if values is None:
        raise InputError(f"{what} is missing; expected {expected}")
    if np.ma.is_masked(values):  # NumPy would show what is behind the mask
        raise InputError(
            f"{what} has masked entries; expected {expected}; fill them, with filled(numpy.nan), or with filled(0) "
            "where integers of 0 mean none"
        )
    try:
        found = np.asarray(values)
    except Exception as error:  # an array of another library says in its own way that it cannot
        raise InputError(f"{what} is no array ({error}); expected {expected}") from error
    if found.ndim == 0 and found.dtype.kind not in kinds:
        raise InputError(f"{what}={reprlib.repr(values)}; expected {expected}")
    if found.ndim not in axes or found.dtype.kind not in kinds:
        raise unfit(what, found, expected)
    return found


def unfit(what: str, found: npt.NDArray[Any], expected: str) -> InputError:
    """That an array has the wrong type or shape."""
    return InputError(f"{what} is {found.dtype} of shape {found.shape}; expected {expected}")


def image_shape(image: npt.NDArray[Any], camera: Camera, what: str) -> None:
    """Refuse an image whose size is not that of its camera.

    Raises:
        InputError: The sizes differ.
    """
    expected = (camera.height, camera.width)
    if image.shape[:2] != expected:
        raise InputError(
            f"{what} has shape {image.shape}; the camera expects {expected} (rows, columns)"
        )


def metres(
    depth: ArrayLike, camera: Camera, scale_per_metre: float | None, what: str = "depth_m"
) -> Float32[np.ndarray, "h w"]:
    """A depth or range image in m, NaN where there is none: not finite, not positive, or 1000 m or more.

    Args:
        depth: (h, w), floating point in m, or integers.
        camera: Its camera.
        scale_per_metre: Units per metre; must be given for integers, whose 0 means no depth.
        what: Name of the argument, for messages.

    Raises:
        InputError: Wrong shape or type, integers without a scale, or a depth that must be in millimetres.
    """
    expected = "(rows, columns) of floating point in m, or of integers with scale_per_metre"
    values = array(depth, what, expected, "fui", (2,))
    image_shape(values, camera, what)
    if scale_per_metre is None:
        if values.dtype.kind != "f":
            raise InputError(
                f"{what} is {values.dtype}, whose unit is unknown; give scale_per_metre, the units per "
                "metre (1000 for millimetres, 5000 for TUM RGB-D)"
            )
        scale = 1.0
    else:
        scale = positive(scale_per_metre, "scale_per_metre")
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large becomes infinite
        image = values.astype(np.float32) / np.float32(scale)
    measured = image[np.isfinite(image) & (image > 0.0)]
    middle = float(np.median(measured)) if len(measured) else 1.0
    stated = scale_per_metre is not None and values.dtype.kind == "f"
    if middle > MILLIMETRES and not stated:
        raise InputError(
            f"{what} has a median of {middle:.4g} m; expected metres, so give "
            "scale_per_metre (1000 if the values are millimetres, 1 if floats are metres of a place as wide)"
        )
    if middle < DIVIDED_TWICE and scale_per_metre is not None:
        raise InputError(
            f"{what} has a median of {middle:.4g} m with scale_per_metre={scale:g}; expected the units per metre of "
            "the values, so leave it out if they are metres"
        )
    return metres_of_floats(image)


def depth_image(
    depth_m: ArrayLike,
    camera: Camera,
    scale_per_metre: float | None = None,
    sigma_m: ArrayLike | None = None,
    T_body_camera: Pose3 | None = None,
    sensor: str = "depth",
) -> Depth:
    """A depth image with its standard deviation.

    Args:
        depth_m: (h, w), as for `metres`.
        camera: Its camera.
        scale_per_metre: Units per metre, for integers.
        sigma_m: Standard deviation of depth, one number or (h, w), m; None: as for
            `find_floor`.
        T_body_camera: Camera on the body.
        sensor: Of `SENSORS`; its noise is taken if sigma_m is None.

    Raises:
        InputError: As `metres`; or sigma_m has another shape or is not positive; or it is None, for stereo.
    """
    camera = instance(camera, Camera, "camera")
    mount = optional(T_body_camera, Pose3, "T_body_camera")
    image = metres(depth_m, camera, scale_per_metre)
    if sensor_named(sensor) == "stereo" and sigma_m is None:
        raise InputError(
            'sensor="stereo" needs sigma_m, as its noise follows from baseline and focal length; `stereo_depth` '
            "returns it"
        )
    if sigma_m is None and sensor == "tof":
        x, y = camera.slopes
        ranges = (image * np.sqrt(1.0 + x * x + y * y)).astype(np.float32)
        return time_of_flight.depth(RangeView(ranges, None, camera, mount))
    if sigma_m is None:
        return structured_light.depth(DepthView(image, camera, mount), StructuredLightConfig())
    expected = f"one number or {image.shape}, as depth_m, in m"
    sigma = array(sigma_m, "sigma_m", expected, "fui", (0, 2))
    if sigma.shape not in ((), image.shape):
        raise unfit("sigma_m", sigma, expected)
    sigma = np.where(np.isfinite(image), sigma.astype(np.float64), np.nan)
    there = sigma[np.isfinite(image)]
    if not ((there >= LEAST_SIGMA_M) & (there <= LARGEST)).all():
        raise InputError(
            f"sigma_m must be positive wherever there is depth: {LEAST_SIGMA_M:g} m at least, {LARGEST:g} m at most"
        )
    return Depth(image, sigma.astype(np.float32), camera, mount)


def sensor_named(name: Any) -> str:
    """A kind of depth sensor. InputError for another word."""
    if not isinstance(name, str) or name not in SENSORS:
        raise InputError(
            f"sensor is {reprlib.repr(name)}; one of {', '.join(map(repr, SENSORS))} was expected"
        )
    return name


def grey(image: ArrayLike, camera: Camera, what: str) -> UInt8[np.ndarray, "h w"]:
    """A grey image, converted from RGB where needed.

    Raises:
        InputError: It is not uint8 of shape (h, w) or (h, w, 3), or not of the camera's size.
    """
    expected = "uint8, (rows, columns) or (rows, columns, 3)"
    values = array(image, what, expected, "u", (2, 3))
    if values.dtype != np.uint8 or values.shape[2:] not in ((), (3,)):
        raise unfit(what, values, expected)
    image_shape(values, camera, what)
    if values.ndim == 2:
        return np.ascontiguousarray(values)
    import cv2

    return np.asarray(cv2.cvtColor(values, cv2.COLOR_RGB2GRAY))


def colour(image: ArrayLike, camera: Camera) -> UInt8[np.ndarray, "h w 3"]:
    """A colour image.

    Raises:
        InputError: It is not uint8 of shape (h, w, 3), or not of the camera's size.
    """
    expected = "uint8, (rows, columns, 3), red first"
    values = array(image, "rgb", expected, "u", (3,))
    if values.dtype != np.uint8 or values.shape[2] != 3:
        raise unfit("rgb", values, expected)
    image_shape(values, camera, "rgb")
    return np.ascontiguousarray(values)


def numbers(
    values: ArrayLike | None,
    shape: Sequence[int | None],
    what: str,
    default: float | None = None,
    *,
    shared: bool = False,
    finite: bool = True,
) -> Float[np.ndarray, "..."]:
    """Numbers of a shape.

    Args:
        values: To check.
        shape: Length of each axis; None for any length. An empty list serves where the first one may be 0.
        what: Name of the argument, for messages.
        default: Of every number, if `values` is None.
        shared: Whether one entry may stand for all along the first axis.
        finite: Whether NaN and infinity are refused.

    Raises:
        InputError: Missing, another shape, not numbers, not finite, or impossibly large.
    """
    if values is None and default is not None:
        return np.full([length or 0 for length in shape], default)
    several = f"{_written(shape)} of {'finite ' * finite}numbers" if shape else "a number"
    expected = several + f", or {_written(shape[1:]) or 'one number'} for all" * shared
    found = array(values, what, expected, "fui", range(4)).astype(np.float64)
    if found.size == 0 and shape and shape[0] in (None, 0):
        found = found.reshape([length or 0 for length in shape])
    if shared and found.shape == tuple(shape[1:]):
        found = np.broadcast_to(found, [length or 0 for length in shape]).copy()
    fits = found.ndim == len(shape) and all(
        length in (None, have) for length, have in zip(shape, found.shape, strict=True)
    )
    if not fits:
        raise InputError(f"{what} has shape {found.shape}; expected {expected}")
    if finite and not np.isfinite(found).all():
        raise InputError(f"{what} holds NaN or infinity; expected {expected}")
    if (np.abs(found[np.isfinite(found)]) > LARGEST).any():
        raise InputError(
            f"{what} holds a number above {LARGEST:g} in size; expected {expected} in m, s and rad"
        )
    return found


def _written(shape: Sequence[int | None]) -> str:
    """A shape as NumPy writes it, n for any length; empty for a single number."""
    lengths = ["n" if length is None else str(length) for length in shape]
    return f"({', '.join(lengths)}{',' * (len(lengths) == 1)})" if lengths else ""


def covariances(
    values: ArrayLike | None, shape: Sequence[int], what: str, *, shared: bool = False
) -> np.ndarray:
    """Covariance matrices: symmetric, no negative eigenvalue.

    Raises:
        InputError: Otherwise, or another shape.
    """
    found = numbers(values, shape, what, shared=shared)
    if found.size == 0:
        return found
    scale = 1e-9 * (1.0 + float(np.abs(found).max()))
    if not np.allclose(found, np.swapaxes(found, -1, -2), atol=scale):
        raise InputError(f"{what} must be symmetric")
    if float(np.linalg.eigvalsh(found).min()) < -scale:
        raise InputError(f"{what} has a negative eigenvalue; expected covariances")
    return found


def radii(values: ArrayLike, count: int) -> Float[np.ndarray, "n"]:
    """One radius for all or one each, m, not negative.

    Raises:
        InputError: Otherwise.
    """
    found = numbers(values, (count,), "radii_m", shared=True)
    if (np.asarray(values) < 0.0).any():
        raise InputError(f"radii_m holds {np.min(values):g}; expected no negative radius")
    return found


def direction(values: ArrayLike, what: str) -> Float[np.ndarray, "3"]:
    """A direction, of any length.

    Raises:
        InputError: Another shape, not finite, or of no length.
    """
    found = numbers(values, (3,), what)
    if not np.any(found):
        raise InputError(f"{what} must not be the zero vector")
    return found


def number(value: Any, what: str, *, finite: bool = True) -> float:
    """A single number.

    Raises:
        InputError: Otherwise, or not finite.
    """
    return float(numbers(value, (), what, finite=finite))


def positive(value: Any, what: str) -> float:
    """A positive finite number.

    Raises:
        InputError: Otherwise.
    """
    found = number(value, what)
    if not found >= toml.LEAST:
        raise InputError(
            f"{what}={found:g} must be a positive finite number, {toml.LEAST:g} at least"
        )
    return found


def whole(value: Any, what: str) -> int:
    """A whole number that is not negative.

    Raises:
        InputError: Otherwise.
    """
    try:
        found = operator.index(value)
    except TypeError:
        found = -1
    if found < 0:
        raise InputError(
            f"{what}={reprlib.repr(value)} must be a whole number that is not negative"
        )
    return found


def flag(value: Any, what: str) -> bool:
    """True or False.

    Raises:
        InputError: Otherwise: the text "false" would count as true.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{what}={reprlib.repr(value)}; expected True or False")
    return bool(value)


def reach(nearest_m: float, farthest_m: float) -> ReachConfig:
    """The range of depths that is used.

    Raises:
        InputError: No numbers, or no range.
    """
    return ReachConfig(
        number(nearest_m, "nearest_m"), number(farthest_m, "farthest_m", finite=False)
    )


def plain(value: Any) -> Any:
    """A setting without NumPy's types."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def configured(kind: type[C], settings: Mapping[str, Any], what: str) -> C:
    """A configuration from keyword arguments.

    Raises:
        InputError: A name is unknown or a value impossible.
    """
    kinds = typing.get_type_hints(kind)
    parts, values = {}, {}
    for name, value in settings.items():
        if name not in kinds:
            raise InputError(f"{what}: unknown setting {name!r}; known: {', '.join(kinds)}")
        if dataclasses.is_dataclass(value):
            parts[name] = instance(value, kinds[name], name)
        else:
            values[name] = plain(value)
    return toml.changed(kind(**parts), values)
