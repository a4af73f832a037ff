"""Depth images to points: back-projection with the standard deviation of every point.

The rays of an undistorted camera are separable, so one row and one column of slopes suffice; a distorted
camera has a full table (`Camera.rays`, computed once). Only pixels with depth become points, and each
keeps its pixel index.

Source: seed 003, section 3 (disparity to range).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from ..primitives.errors import InputError
from ..primitives.frame import Depth
from . import _points_kernels as kernels


@dataclass(frozen=True)
class Points:
    """Points measured by one camera.

    Args:
        xyz: (n, 3), camera frame, m; all finite and in front of the camera.
        sigma: (n,), standard deviation of z, m; the error is along the ray.
        pixels: (n,), flat index row * width + column into the image.
    """

    xyz: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "n"]
    pixels: Int[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.xyz)

    def of(self, chosen: Int[np.ndarray, "k"] | Bool[np.ndarray, "n"]) -> Points:
        """Some of the points."""
        index = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        return Points(self.xyz.take(index, axis=0), self.sigma.take(index), self.pixels.take(index))


def from_depth(depth: Depth, nearest_m: float, farthest_m: float, stride: int = 1) -> Points:
    """Points of all pixels whose depth lies in a range, in row order.

    Args:
        depth: Image; pixels without depth, or without a positive sigma, give no point.
        nearest_m, farthest_m: Range of z that is used.
        stride: 1 for every row and column, 2 for every second one.

    Raises:
        InputError: The image does not fit its camera, the range is empty, or the stride is not positive.
    """
    depth.camera.check_image("depth", depth.z)
    depth.camera.check_image("sigma", depth.sigma)
    if not 0.0 <= nearest_m < farthest_m:
        raise InputError(
            f"points: nearest_m={nearest_m} must not be negative and be below farthest_m={farthest_m}"
        )
    if stride < 1:
        raise InputError(f"points: stride={stride} must be at least 1")
    x, y = depth.camera.slopes
    xyz, sigma, pixels = kernels.gather(
        depth.z, depth.sigma, x, y, max(nearest_m, 1e-6), farthest_m, stride
    )
    return Points(xyz, sigma, pixels)


def organised(
    depth: Depth, out: Float32[np.ndarray, "a b 3"] | None = None
) -> Float32[np.ndarray, "h w 3"]:
    """Points of all pixels as an image, camera frame, m; NaN where there is no depth.

    Args:
        depth: Image.
        out: Array to fill and return; None allocates a new one.

    Raises:
        InputError: The image does not fit its camera, or `out` does not fit the image.
    """
    z, camera = depth.z, depth.camera
    height, width = z.shape
    camera.check_image("depth", z)
    if out is None:
        out = np.empty((height, width, 3), np.float32)
    elif out.shape != (height, width, 3) or not out.flags.c_contiguous:
        raise InputError(
            f"points: out is {out.shape}; a contiguous array of {(height, width, 3)} was expected"
        )
    x, y = camera.single_slopes
    kernels.spread(z, x, y, out)
    return out
