"""Input of the public functions, converted to what the algorithms take, or refused with what was expected."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Float32, UInt8

from perception.depth import structured_light
from perception.depth.structured_light import StructuredLightConfig
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth, DepthView
from perception.primitives.pose import Pose3

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    ArrayLike = object  # anything: the functions here look at it themselves

C = TypeVar("C")
MILLIMETRES = 50.0  # ours: a median depth above this, in m, is a depth in millimetres


def pinhole(camera: Any, what: str = "camera") -> Camera:
    """A camera, if it is one.

    Raises:
        InputError: It is not a `surefoot.Camera`.
    """
    if not isinstance(camera, Camera):
        raise InputError(
            f"{what} is a {type(camera).__name__}; expected surefoot.Camera(width, height, fx, fy, cx, cy)"
        )
    return camera


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
    """A depth or range image in m, NaN where there is none.

    Args:
        depth: (h, w), floating point in m, or integers.
        camera: Its camera.
        scale_per_metre: Units per metre; must be given for integers, whose 0 means no depth.
        what: Name of the argument, for messages.

    Raises:
        InputError: Wrong shape or type, integers without a scale, or a depth that must be in millimetres.
    """
    values = np.asarray(depth)
    if values.ndim != 2 or values.dtype.kind not in "fui":
        raise InputError(
            f"{what} is {values.dtype} of shape {values.shape}; expected (rows, columns) of floating point "
            "in m, or of integers with scale_per_metre"
        )
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
    image = values.astype(np.float32) / np.float32(scale)
    image = np.where(np.isfinite(image) & (image > 0.0), image, np.float32(np.nan))
    measured = image[np.isfinite(image)]
    if len(measured) and float(np.median(measured)) > MILLIMETRES:
        raise InputError(
            f"{what} has a median of {float(np.median(measured)):.4g} m; expected metres, so give "
            "scale_per_metre (1000 if the values are millimetres)"
        )
    return np.asarray(image, np.float32)


def depth_image(
    depth_m: ArrayLike,
    camera: Camera,
    scale_per_metre: float | None = None,
    sigma_m: ArrayLike | None = None,
    T_body_camera: Pose3 | None = None,
) -> Depth:
    """A depth image with its standard deviation.

    Args:
        depth_m: (h, w), as for `metres`.
        camera: Its camera.
        scale_per_metre: Units per metre, for integers.
        sigma_m: Standard deviation of depth, one number or (h, w), m; None takes that of an RGB-D camera.
        T_body_camera: Camera on the body.

    Raises:
        InputError: As `metres`; or sigma_m has another shape or is not positive.
    """
    camera = pinhole(camera)
    image = metres(depth_m, camera, scale_per_metre)
    if sigma_m is None:
        return structured_light.depth(
            DepthView(image, camera, T_body_camera), StructuredLightConfig()
        )
    sigma = np.asarray(sigma_m, np.float32)
    if sigma.shape not in ((), image.shape):
        raise InputError(
            f"sigma_m has shape {sigma.shape}; expected one number or {image.shape}, as depth_m"
        )
    sigma = np.where(np.isfinite(image), sigma, np.float32(np.nan)).astype(np.float32)
    if not (sigma[np.isfinite(image)] > 0.0).all():
        raise InputError("sigma_m must be positive wherever there is depth")
    return Depth(image, sigma, camera, T_body_camera)


def grey(image: ArrayLike, camera: Camera, what: str) -> UInt8[np.ndarray, "h w"]:
    """A grey image, converted from RGB where needed.

    Raises:
        InputError: It is not uint8 of shape (h, w) or (h, w, 3), or not of the camera's size.
    """
    values = np.asarray(image)
    if values.dtype != np.uint8 or values.ndim not in (2, 3) or values.shape[2:] not in ((), (3,)):
        raise InputError(
            f"{what} is {values.dtype} of shape {values.shape}; expected uint8, (rows, columns) or "
            "(rows, columns, 3)"
        )
    image_shape(values, camera, what)
    if values.ndim == 2:
        return np.ascontiguousarray(values)
    import cv2

    return np.asarray(cv2.cvtColor(values, cv2.COLOR_RGB2GRAY))


def colour(image: ArrayLike, camera: Camera, what: str = "rgb") -> UInt8[np.ndarray, "h w 3"]:
    """A colour image.

    Raises:
        InputError: It is not uint8 of shape (h, w, 3), or not of the camera's size.
    """
    values = np.asarray(image)
    if values.dtype != np.uint8 or values.ndim != 3 or values.shape[2] != 3:
        raise InputError(
            f"{what} is {values.dtype} of shape {values.shape}; expected uint8, (rows, columns, 3), red first"
        )
    image_shape(values, camera, what)
    return np.ascontiguousarray(values)


def numbers(
    values: ArrayLike | None,
    shape: Sequence[int | None],
    what: str,
    default: float | None = None,
) -> Float[np.ndarray, "..."]:
    """Finite numbers of a shape.

    Args:
        values: To check; a single number stands for as many as `shape` asks for.
        shape: Length of each axis; None for any length.
        what: Name of the argument, for messages.
        default: Of every number, if `values` is None.

    Raises:
        InputError: Another shape, not numbers, or not finite.
    """
    wanted = ", ".join("n" if length is None else str(length) for length in shape)
    expected = f"expected ({wanted}) of finite numbers"
    if values is None:
        if default is None:
            raise InputError(f"{what} is missing; {expected}")
        values = default
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is no array of numbers ({error}); {expected}") from error
    if array.ndim == 0 and None not in shape:
        array = np.full(tuple(length or 0 for length in shape), float(array))
    if array.size == 0 and shape and shape[0] in (None, 0):
        array = array.reshape(tuple(length or 0 for length in shape))
    fits = array.ndim == len(shape) and all(
        length in (None, have) for length, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise InputError(f"{what} has shape {array.shape}; {expected}")
    if not np.isfinite(array).all():
        raise InputError(f"{what} holds NaN or infinity; {expected}")
    return array


def covariances(values: ArrayLike | None, shape: Sequence[int], what: str) -> np.ndarray:
    """Covariance matrices: symmetric, no negative eigenvalue.

    Raises:
        InputError: Otherwise, or another shape.
    """
    array = numbers(values, shape, what)
    if array.size == 0:
        return array
    scale = 1e-9 * (1.0 + float(np.abs(array).max()))
    if not np.allclose(array, np.swapaxes(array, -1, -2), atol=scale):
        raise InputError(f"{what} must be symmetric")
    if float(np.linalg.eigvalsh(array).min()) < -scale:
        raise InputError(f"{what} has a negative eigenvalue; expected covariances")
    return array


def positive(value: float, what: str) -> float:
    """A positive finite number.

    Raises:
        InputError: Otherwise.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{what}={value!r} must be a positive finite number")
    return number


def configured(kind: type[C], settings: Mapping[str, Any], what: str) -> C:
    """A configuration from keyword arguments.

    Raises:
        InputError: A name is unknown or a value impossible.
    """
    known = [item.name for item in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for name in settings:
        if name not in known:
            raise InputError(f"{what}: unknown setting {name!r}; known: {', '.join(known)}")
    return kind(**settings)
