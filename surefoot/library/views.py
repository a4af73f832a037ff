"""Images of a user, as the views of a frame."""

from __future__ import annotations

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import ColourView, DepthView, RangeView, StereoView
from perception.primitives.pose import Pose3

from . import checks
from .checks import ArrayLike


def depth_view(
    depth_m: ArrayLike,
    camera: Camera | None,
    scale_per_metre: float | None,
    T_body_camera: Pose3 | None,
) -> DepthView:
    """The image of an RGB-D camera.

    Args:
        depth_m: (h, w), along the optical axis, m; integers need `scale_per_metre`.
        camera: Its intrinsics.
        scale_per_metre: Units per metre of integers.
        T_body_camera: Camera on the body.

    Raises:
        InputError: No camera, or as `checks.metres`.
    """
    lens = checks.instance(camera, Camera, "camera")
    return DepthView(checks.metres(depth_m, lens, scale_per_metre), lens, T_body_camera)


def range_view(
    range_m: ArrayLike,
    amplitude: ArrayLike | None,
    camera: Camera | None,
    scale_per_metre: float | None,
    T_body_camera: Pose3 | None,
) -> RangeView:
    """The image of a time-of-flight camera.

    Args:
        range_m: (h, w), along the ray, m; integers need `scale_per_metre`.
        amplitude: (h, w), of the return; 1 is that of a white target 2 m straight ahead.
        camera, scale_per_metre, T_body_camera: As for `depth_view`.

    Raises:
        InputError: No camera, or as `checks.metres`; the amplitude is not of its size.
    """
    lens = checks.instance(camera, Camera, "camera")
    returned = None
    if amplitude is not None:
        expected = "(rows, columns) of numbers, as range_m"
        returned = checks.array(amplitude, "amplitude", expected, "fui", (2,)).astype(np.float32)
        checks.image_shape(returned, lens, "amplitude")
    ranges = checks.metres(range_m, lens, scale_per_metre, "range_m")
    return RangeView(ranges, returned, lens, T_body_camera)


def stereo_view(
    left: ArrayLike | None,
    right: ArrayLike | None,
    baseline_m: float | None,
    camera: Camera | None,
    T_body_camera: Pose3 | None = None,
) -> StereoView:
    """A stereo pair.

    Args:
        left, right: (h, w) grey or (h, w, 3) RGB, uint8.
        baseline_m: Distance of the right camera to the right of the left one, m.
        camera: Intrinsics of either.
        T_body_camera: Left camera on the body.

    Raises:
        InputError: The pair is incomplete, there is no camera, or as `checks.grey`.
    """
    if left is None or right is None or baseline_m is None:
        raise InputError("a stereo pair needs left, right and baseline_m")
    lens = checks.instance(camera, Camera, "camera")
    return StereoView(
        checks.grey(left, lens, "left"),
        checks.grey(right, lens, "right"),
        checks.positive(baseline_m, "baseline_m"),
        lens,
        T_body_camera,
    )


def colour_view(rgb: ArrayLike, camera: Camera | None, T_body_camera: Pose3 | None) -> ColourView:
    """The image of a colour camera.

    Args:
        rgb: (h, w, 3), uint8, red first.
        camera: Its intrinsics.
        T_body_camera: Camera on the body.

    Raises:
        InputError: No camera, or as `checks.colour`.
    """
    lens = checks.instance(camera, Camera, "rgb_camera")
    return ColourView(checks.colour(rgb, lens), lens, T_body_camera)
