"""Compiled loops of back-projection. Ray slopes come as (1 or h, w) and (h, 1 or w) tables."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit


@njit(cache=True, nogil=True)
def gather(
    z: np.ndarray,
    sigma: np.ndarray,
    slope_x: np.ndarray,
    slope_y: np.ndarray,
    nearest: float,
    farthest: float,
    stride: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, sigma and flat pixel index of the pixels in range, row by row."""
    height, width = z.shape
    count = 0
    for v in range(0, height, stride):
        for u in range(0, width, stride):
            if nearest <= z[v, u] <= farthest and 0.0 < sigma[v, u] < np.inf:
                count += 1
    xyz = np.empty((count, 3))
    deviation = np.empty(count)
    pixels = np.empty(count, np.int64)
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    i = 0
    for v in range(0, height, stride):
        row = v if rows_x > 1 else 0
        for u in range(0, width, stride):
            depth = float(z[v, u])
            if nearest <= z[v, u] <= farthest and 0.0 < sigma[v, u] < np.inf:
                column = u if columns_y > 1 else 0
                xyz[i, 0] = slope_x[row, u] * depth
                xyz[i, 1] = slope_y[v, column] * depth
                xyz[i, 2] = depth
                deviation[i] = sigma[v, u]
                pixels[i] = v * width + u
                i += 1
    return xyz, deviation, pixels


@njit(cache=True, nogil=True)
def spread(z: np.ndarray, slope_x: np.ndarray, slope_y: np.ndarray, xyz: np.ndarray) -> None:
    """Fill (h, w, 3) float32 with the points of every pixel; NaN depth gives NaN."""
    height, width = z.shape
    rows_x, columns_y = slope_x.shape[0], slope_y.shape[1]
    flat = xyz.reshape(height, 3 * width)
    for v in range(height):
        x, row, out = slope_x[v if rows_x > 1 else 0], z[v], flat[v]
        if columns_y > 1:
            slopes = slope_y[v]
            for u in range(width):
                depth = row[u]
                out[3 * u] = x[u] * depth
                out[3 * u + 1] = slopes[u] * depth
                out[3 * u + 2] = depth
        else:
            y = slope_y[v, 0]
            for u in range(width):
                depth = row[u]
                out[3 * u] = x[u] * depth
                out[3 * u + 1] = y * depth
                out[3 * u + 2] = depth
