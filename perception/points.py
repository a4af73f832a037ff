"""From a depth image to points in the camera frame, each with the deviation of its depth.

The ray through every pixel is computed once per camera and kept; back-projecting is then one product.

Source: seed 003, section 3 (X = (u - c_x) Z / f).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int

from . import _points_kernels
from .primitives.camera import Camera
from .primitives.frame import Depth


@dataclass(frozen=True)
class Points:
    """Points of one depth image.

    Args:
        xyz: (n, 3), camera frame, m.
        sigma: (n,), deviation of z, m.
        pixels: (n, 2), (u, v) each came from.
    """

    xyz: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "n"]
    pixels: Int[np.ndarray, "n 2"]


def from_depth(depth: Depth, nearest_m: float, farthest_m: float, stride: int = 1) -> Points:
    """The points of all pixels whose depth is known and within reach.

    Args:
        depth: Depth image with its deviations, m.
        nearest_m: Nearer is left out.
        farthest_m: Farther is left out.
        stride: 2 takes every second row and column.

    Returns:
        In row order.
    """
    z = depth.z[::stride, ::stride]
    with np.errstate(invalid="ignore"):
        used = (z >= nearest_m) & (z <= farthest_m)
    v, u = np.nonzero(used)
    distance = z[used].astype(np.float64)
    rays = _rays(depth.camera)[::stride, ::stride][used]
    return Points(
        np.column_stack([rays * distance[:, None], distance]),
        depth.sigma[::stride, ::stride][used].astype(np.float64),
        np.column_stack([u, v]) * stride,
    )


def organised(depth: Depth) -> Float32[np.ndarray, "h w 3"]:
    """Every pixel's point, camera frame, m, in image order; NaN where there is no depth."""
    out = np.empty((*depth.z.shape, 3), np.float32)
    _points_kernels.back_project(depth.z, _rays(depth.camera), out)
    return out


@lru_cache(maxsize=16)
def _rays(camera: Camera) -> Float32[np.ndarray, "h w 2"]:
    """(x, y) at z = 1 through every pixel."""
    rays = np.ascontiguousarray(camera.rays[..., :2], dtype=np.float32)
    rays.setflags(write=False)
    return rays
