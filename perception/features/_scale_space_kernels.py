"""Extrema of the difference of Gaussians: detected, fitted by a paraboloid, kept if distinct and not on an edge."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit

RUN = 64  # pixels that are looked at together; most runs have no peak


@njit(cache=True, nogil=True)
def extrema(
    levels: np.ndarray,
    threshold: float,
    contrast: float,
    edge_ratio: float,
    border: int,
    layers: int,
    found: np.ndarray,
) -> int:
    """Fitted extrema of one octave.

    levels: (layers + 3, h, w) float32, the blurred images. threshold: least |difference| at the pixel.
    contrast: least |difference| at the fitted place. edge_ratio: of principal curvatures, largest.
    found: (capacity, 5) float32, receives x, y, layer (all fitted), response, integer layer.
    Returns the number found, cut at the capacity.
    """
    height, width = levels.shape[1], levels.shape[2]
    rows, peak = np.empty((3, width), np.float32), np.zeros(width, np.uint8)
    fit = np.empty(5, np.float64)
    count = 0
    for layer in range(1, layers + 1):
        upper, lower = levels[layer + 1], levels[layer]
        for r in range(border, height - border):
            for n in range(r - 1 if r == border else r + 1, r + 2):
                up, low, line = upper[n], lower[n], rows[n % 3]
                for c in range(width):
                    line[c] = up[c] - low[c]
            row = rows[r % 3]
            _mark_peaks(rows[(r - 1) % 3], row, rows[(r + 1) % 3], threshold, peak)
            for first in range(border, width - border, RUN):
                last = min(first + RUN, width - border)
                if not _any(peak[first:last]):
                    continue
                for c in range(first, last):
                    if not peak[c]:
                        continue
                    sign = np.float32(1.0) if row[c] > 0.0 else np.float32(-1.0)
                    if not _is_largest(levels, layer, r, c, sign * row[c], sign):
                        continue
                    if count < found.shape[0] and _fit(
                        levels, layer, r, c, layers, contrast, edge_ratio, border, fit
                    ):
                        for k in range(5):
                            found[count, k] = fit[k]
                        count += 1
    return count


@njit(cache=True, nogil=True)
def _mark_peaks(
    above: np.ndarray, row: np.ndarray, below: np.ndarray, threshold: float, peak: np.ndarray
) -> None:
    """Set peak (w,) uint8 to 1 where a value is beyond the threshold and extreme among its eight neighbours."""
    n = row.size - 2
    here, out = row[1:], peak[1:]
    for c in range(n):
        most = max(
            max(row[c], row[c + 2]), max(max(above[c], below[c]), max(above[c + 2], below[c + 2]))
        )
        least = min(
            min(row[c], row[c + 2]), min(min(above[c], below[c]), min(above[c + 2], below[c + 2]))
        )
        most, least = (
            max(most, max(above[c + 1], below[c + 1])),
            min(least, min(above[c + 1], below[c + 1])),
        )
        value = here[c]
        high = (value > threshold) & (value >= most)
        low = (value < -threshold) & (value <= least)
        out[c] = np.uint8(high | low)


@njit(cache=True, nogil=True)
def _any(flags: np.ndarray) -> bool:
    some = np.uint8(0)
    for flag in flags:
        some |= flag
    return some != 0


@njit(cache=True, nogil=True, inline="always")
def _difference(levels: np.ndarray, layer: int, r: int, c: int) -> float:
    return levels[layer + 1, r, c] - levels[layer, r, c]


@njit(cache=True, nogil=True)
def _is_largest(
    levels: np.ndarray, layer: int, r: int, c: int, value: np.float32, sign: np.float32
) -> bool:
    """Whether no neighbour in the layers above and below is larger; those in its own are known."""
    for step in (-1, 1):
        if sign * _difference(levels, layer + step, r, c) > value:
            return False
    for step in (-1, 1):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                if sign * _difference(levels, layer + step, r + dr, c + dc) > value:
                    return False
    return True


@njit(cache=True, nogil=True)
def _fit(
    levels: np.ndarray,
    layer: int,
    r: int,
    c: int,
    layers: int,
    contrast: float,
    edge_ratio: float,
    border: int,
    fit: np.ndarray,
) -> bool:
    """At most five Newton steps to the paraboloid's extremum; returns whether it is accepted."""
    height, width = levels.shape[1], levels.shape[2]
    for _ in range(5):
        middle = float(_difference(levels, layer, r, c))
        east, west = _difference(levels, layer, r, c + 1), _difference(levels, layer, r, c - 1)
        south, north = _difference(levels, layer, r + 1, c), _difference(levels, layer, r - 1, c)
        above, below = _difference(levels, layer + 1, r, c), _difference(levels, layer - 1, r, c)
        gx, gy, gs = (east - west) / 2.0, (south - north) / 2.0, (above - below) / 2.0
        xx, yy = east + west - 2.0 * middle, south + north - 2.0 * middle
        ss = above + below - 2.0 * middle
        xy = (
            _difference(levels, layer, r + 1, c + 1)
            - _difference(levels, layer, r + 1, c - 1)
            - _difference(levels, layer, r - 1, c + 1)
            + _difference(levels, layer, r - 1, c - 1)
        ) / 4.0
        xs = (
            _difference(levels, layer + 1, r, c + 1)
            - _difference(levels, layer + 1, r, c - 1)
            - _difference(levels, layer - 1, r, c + 1)
            + _difference(levels, layer - 1, r, c - 1)
        ) / 4.0
        ys = (
            _difference(levels, layer + 1, r + 1, c)
            - _difference(levels, layer + 1, r - 1, c)
            - _difference(levels, layer - 1, r + 1, c)
            + _difference(levels, layer - 1, r - 1, c)
        ) / 4.0
        a, b, d = yy * ss - ys * ys, xs * ys - xy * ss, xy * ys - xs * yy
        determinant = xx * a + xy * b + xs * d
        if determinant == 0.0:
            return False
        e, f, g = xx * ss - xs * xs, xy * xs - xx * ys, xx * yy - xy * xy
        dx = -(a * gx + b * gy + d * gs) / determinant
        dy = -(b * gx + e * gy + f * gs) / determinant
        ds = -(d * gx + f * gy + g * gs) / determinant
        if abs(dx) < 0.5 and abs(dy) < 0.5 and abs(ds) < 0.5:
            value = middle + 0.5 * (gx * dx + gy * dy + gs * ds)
            trace, det2 = xx + yy, xx * yy - xy * xy
            if abs(value) < contrast or det2 <= 0.0:
                return False
            if trace * trace * edge_ratio >= (edge_ratio + 1.0) ** 2 * det2:
                return False
            fit[0], fit[1], fit[2], fit[3], fit[4] = c + dx, r + dy, layer + ds, abs(value), layer
            return True
        if not (abs(dx) < 1e6 and abs(dy) < 1e6 and abs(ds) < 1e6):
            return False
        c, r, layer = c + round(dx), r + round(dy), layer + round(ds)
        if layer < 1 or layer > layers:
            return False
        if c < border or c >= width - border or r < border or r >= height - border:
            return False
    return False
