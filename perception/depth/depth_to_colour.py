"""Registration of a colour image to a depth image of another camera.

The two cameras see the scene from different places, so points visible to one may be occluded for the other;
occluded points get no colour.

Source: ours, for RGB-D recordings that are not registered.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt8

from ..primitives.camera import Camera
from ..primitives.pose import Pose3
from . import _depth_to_colour_kernels as kernels

CELL_PX = 4
"""Cell size of the occlusion test, px of the colour image; depth images are coarser."""

SLACK = 0.05
"""A point this share of its depth behind the nearest one of its cell is still visible: slanted surfaces."""


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
        T_colour_depth: Pose of the depth camera in the colour camera.

    Raises:
        InputError: An image does not fit its camera.
    """
    camera.check_image("depth", depth)
    colour_camera.check_image("colour", rgb)
    where, pixels, z = _projected(depth, camera, colour_camera, T_colour_depth)
    nearest = kernels.nearest(pixels, z, colour_camera.height, colour_camera.width, CELL_PX)
    colours = np.zeros((camera.height * camera.width, 3), np.uint8)
    colours[where] = kernels.sampled(pixels, z, rgb, nearest, CELL_PX, SLACK)
    return colours.reshape(camera.height, camera.width, 3)


def _projected(
    depth: np.ndarray, camera: Camera, colour_camera: Camera, T_colour_depth: Pose3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat index of each pixel with depth; its pixel (u, v) and depth, m, in the colour camera."""
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
