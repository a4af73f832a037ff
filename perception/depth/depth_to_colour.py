"""Depth and colour of two cameras made one: colours laid onto the depth image, depth onto the colour image.

The two cameras stand beside each other, so that one sees what is hidden from the other. What something
nearer hides gets no colour, and where several points fall on one pixel the nearest is taken.

Source: ours; the use is that of unregistered RGB-D recordings.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from ..primitives.camera import Camera
from ..primitives.errors import InputError
from ..primitives.pose import Pose3
from . import _depth_to_colour_kernels as kernels

CELL_PX = 4
"""Edge of the cells in which a nearer thing hides what lies behind: depth images are the coarser ones."""

SLACK = 0.05
"""Share of the depth by which a point may lie behind the nearest of its cell: a slanted face is no cover."""


def colours_of_depth(
    depth: Float32[np.ndarray, "h w"],
    camera: Camera,
    rgb: UInt8[np.ndarray, "a b 3"],
    colour_camera: Camera,
    T_colour_depth: Pose3,
) -> UInt8[np.ndarray, "h w 3"]:
    """The colour of every depth pixel; black where there is no depth or the colour camera does not see it.

    Args:
        depth: m, NaN where there is none.
        camera: Of the depth image.
        rgb: Colour image.
        colour_camera: Its camera.
        T_colour_depth: Depth camera in the colour camera.

    Raises:
        InputError: An image does not fit its camera.
    """
    _check("depth", depth, camera)
    _check("colour", rgb, colour_camera)
    where, pixels, z = _carried(depth, camera, colour_camera, T_colour_depth)
    least = kernels.nearest(pixels, z, colour_camera.height, colour_camera.width, CELL_PX)
    laid = np.zeros((camera.height * camera.width, 3), np.uint8)
    laid[where] = kernels.sampled(pixels, z, rgb, least, CELL_PX, SLACK)
    return laid.reshape(camera.height, camera.width, 3)


def depth_on_colour(
    depth: Float32[np.ndarray, "h w"],
    camera: Camera,
    colour_camera: Camera,
    T_colour_depth: Pose3,
) -> Float32[np.ndarray, "a b"]:
    """Depth as the colour camera would measure it, m; NaN where no depth pixel falls.

    Args:
        depth: m, NaN where there is none.
        camera: Of the depth image.
        colour_camera: Of the image that is wanted.
        T_colour_depth: Depth camera in the colour camera.

    Raises:
        InputError: The depth image does not fit its camera.
    """
    _check("depth", depth, camera)
    _, pixels, z = _carried(depth, camera, colour_camera, T_colour_depth)
    least = kernels.nearest(pixels, z, colour_camera.height, colour_camera.width, 1)
    return np.where(np.isfinite(least), least, np.nan).astype(np.float32)


def _carried(
    depth: np.ndarray, camera: Camera, colour_camera: Camera, T_colour_depth: Pose3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat index of the pixels with depth, and where (px) and how deep (m) the other camera has them."""
    flat = depth.ravel()
    with np.errstate(invalid="ignore"):
        where = np.flatnonzero(flat > 0.0)
    x, y = camera.slopes
    rows, columns = np.divmod(where, camera.width)
    z = flat[where].astype(np.float64)
    along = x[rows if len(x) > 1 else 0, columns] * z
    down = y[rows, columns if y.shape[1] > 1 else 0] * z
    points = T_colour_depth.apply(np.stack([along, down, z], axis=-1))
    return where, colour_camera.project(points), points[:, 2]


def _check(what: str, image: np.ndarray, camera: Camera) -> None:
    if image.shape[:2] != (camera.height, camera.width):
        raise InputError(
            f"{what} image is {image.shape[:2]}; its camera says {(camera.height, camera.width)} (rows, "
            "columns); check the intrinsics"
        )
