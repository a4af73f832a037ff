"""Compiled loops: edge-preserving downsampling of depth, and a plane fitted around each pixel."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit

EDGE_SIGMAS = 4.0  # a larger depth difference separates two surfaces ...
EDGE_SLOPE = 0.015  # ... beyond this slope: share of depth per pixel, 75 deg at 260 px
LEAST_NEIGHBOURS = 9  # ours: of 25; a plane through fewer pixels is mostly noise


@njit(cache=True, nogil=True)
def downsample(
    z: np.ndarray, sigma: np.ndarray, grey: np.ndarray, factor: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean depth, standard deviation and grey value of each block; depth of the nearest surface in it only."""
    height, width = z.shape[0] // factor, z.shape[1] // factor
    has_grey = grey.shape[0] > 1
    small = np.empty((height, width), np.float32)
    spread = np.empty((height, width), np.float32)
    picture = np.zeros((height, width) if has_grey else (1, 1), np.float32)
    inverse = np.float32(1.0 / (factor * factor))
    for row in range(height):
        for column in range(width):
            nearest, its_sigma = np.float32(np.inf), np.float32(0.0)
            light = np.float32(0.0)
            for i in range(row * factor, row * factor + factor):
                for j in range(column * factor, column * factor + factor):
                    if z[i, j] < nearest:
                        nearest, its_sigma = z[i, j], sigma[i, j]
                    if has_grey:
                        light += grey[i, j]
            if has_grey:
                picture[row, column] = light * inverse
            if not nearest < np.inf:
                small[row, column] = spread[row, column] = np.nan
                continue
            far = nearest + EDGE_SIGMAS * its_sigma + EDGE_SLOPE * nearest * factor
            total, deviation, count = np.float32(0.0), np.float32(0.0), 0
            for i in range(row * factor, row * factor + factor):
                for j in range(column * factor, column * factor + factor):
                    if z[i, j] <= far:
                        total += z[i, j]
                        deviation += sigma[i, j]
                        count += 1
            small[row, column] = total / count
            spread[row, column] = deviation / count
    return small, spread, picture


@njit(cache=True, nogil=True)
def pack(
    z: np.ndarray,
    sigma: np.ndarray,
    grey: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    fx: float,
    fy: float,
) -> np.ndarray:
    """(h, w, 8) per pixel: plane (nx, ny, nz, d with n.p = d, n towards the scene), z, grey and its gradient.

    The plane is fitted to inverse depth over 5x5 pixels, in which a plane is exactly linear. Depth is NaN where
    it is missing or the neighbourhood is not planar.
    """
    height, width = z.shape
    has_grey = grey.shape[0] > 1
    out = np.empty((height, width, 8), np.float32)
    for v in range(height):
        for u in range(width):
            depth = z[v, u]
            cell = out[v, u]
            cell[4] = np.nan
            for k in range(5, 8):
                cell[k] = 0.0
            if has_grey:
                cell[5] = grey[v, u]
                if 0 < u < width - 1 and 0 < v < height - 1:
                    cell[6] = 0.5 * (grey[v, u + 1] - grey[v, u - 1])
                    cell[7] = 0.5 * (grey[v + 1, u] - grey[v - 1, u])
            if not depth > 0.0 or u < 2 or v < 2 or u >= width - 2 or v >= height - 2:
                continue
            centre = 1.0 / depth
            noise = EDGE_SIGMAS * sigma[v, u]
            n = suu = suv = svv = su = sv = sw = suw = svw = 0.0
            for j in range(-2, 3):
                for i in range(-2, 3):
                    other = z[v + j, u + i]
                    reach = noise + EDGE_SLOPE * depth * max(abs(i), abs(j))
                    if not abs(other - depth) < reach:
                        continue
                    w = 1.0 / other - centre
                    n += 1.0
                    su += i
                    sv += j
                    suu += i * i
                    suv += i * j
                    svv += j * j
                    sw += w
                    suw += i * w
                    svw += j * w
            if n < LEAST_NEIGHBOURS:
                continue
            suu -= su * su / n
            suv -= su * sv / n
            svv -= sv * sv / n
            suw -= su * sw / n
            svw -= sv * sw / n
            det = suu * svv - suv * suv
            if det < 1.0:
                continue
            a = (suw * svv - svw * suv) / det
            b = (svw * suu - suw * suv) / det
            w = centre + (sw - a * su - b * sv) / n
            p, q = a * fx, b * fy
            r = w - p * x[u] - q * y[v]
            size = 1.0 / np.sqrt(p * p + q * q + r * r)
            cell[0], cell[1], cell[2], cell[3] = p * size, q * size, r * size, size
            cell[4] = depth
    return out
