"""Depth images to points: back-projection through ray tables, with the sigma of every point.

An undistorted camera's rays are separable, so its table is one row and one column; a distorted camera
carries its table itself (`Camera.rays`, made once). Only pixels with depth become points, and each keeps
its place in the image.

Source: seed 003, section 3 (disparity to range).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from ..primitives.errors import InputError
from ..primitives.frame import Depth
from . import _points_kernels as kernels


@dataclass(frozen=True)
class Points:
    """Points seen by one camera.

    Args:
        xyz: (n, 3), camera frame, m; all finite and in front of the camera.
        sigma: (n,), deviation of z, m; the error lies along the ray.
        pixels: (n,), flat index row * width + column into the image, or the number of the point where
            there is no image.
    """

    xyz: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "n"]
    pixels: Int[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.xyz)


def from_depth(depth: Depth, nearest_m: float, farthest_m: float, stride: int = 1) -> Points:
    """Points of all pixels whose depth lies in a range, in row order.

    Args:
        depth: Image; NaN, and pixels whose sigma is not a positive number, give no point.
        nearest_m: Smallest z that is believed, m.
        farthest_m: Largest z that is believed, m.
        stride: Take every so many rows and columns.

    Raises:
        InputError: The image does not fit its camera, the range is empty, or the stride is not positive.
    """
    _check(depth)
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
    """Points of the whole image in its own order, camera frame, m; NaN where there is no depth.

    Args:
        depth: Image.
        out: Filled and returned instead of new memory, if given.

    Raises:
        InputError: The image does not fit its camera, or `out` does not fit the image.
    """
    z, camera = depth.z, depth.camera
    height, width = z.shape
    if camera.height != height or camera.width != width:
        _check(depth)
    if out is None:
        out = np.empty((height, width, 3), np.float32)
    elif out.shape != (height, width, 3) or not out.flags.c_contiguous:
        raise InputError(
            f"points: out is {out.shape}; a contiguous array of {(height, width, 3)} was expected"
        )
    x, y = camera.single_slopes
    kernels.spread(z, x, y, out)
    return out


def unorganised(
    xyz: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, "n"] | None = None
) -> Points:
    """A cloud without an image; without sigma, that of a structured-light camera is taken.

    Points that are not finite or not in front of the camera are left out, the others keep their number.
    """
    keep = np.flatnonzero(np.isfinite(xyz).all(axis=1) & (xyz[:, 2] > 0.0))
    kept = np.ascontiguousarray(xyz[keep], dtype=np.float64)
    if sigma is None:
        return Points(kept, 0.0012 + 0.0019 * (kept[:, 2] - 0.4) ** 2, keep)
    return Points(kept, np.ascontiguousarray(sigma[keep], dtype=np.float64), keep)


def _check(depth: Depth) -> None:
    expected = (depth.camera.height, depth.camera.width)
    if depth.z.shape != expected or depth.sigma.shape != expected:
        raise InputError(
            f"points: depth is {depth.z.shape} and sigma {depth.sigma.shape}, the camera says {expected} "
            "(rows, columns); check the intrinsics"
        )
