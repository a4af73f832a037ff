"""Compiled loops of block matching: prefilter, block costs by running sums, best disparity, reliability costs.

Each loop over pixels and disparities runs along one row of 16-bit integers and writes one array: LLVM only
vectorises such loops. Signed 16 bits hold every block cost: at most 62 on 9 x 9 pixels, 5022.
"""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit
from ._stereo_trust_kernels import NEVER, RADIUS, SIDE, Rating, rate_row, sub_pixel


@njit(cache=True)
def prefilter(image: np.ndarray, limit: int) -> np.ndarray:
    """x-Sobel, clipped to +-limit, plus limit; border pixels are repeated outward.

    Args:
        image: (h, w) uint8.
        limit: Largest gradient.

    Returns:
        (h + 2 RADIUS, w + 2 RADIUS) uint8 in [0, 2 limit].
    """
    height, width = image.shape
    out = np.empty((height + 2 * RADIUS, width + 2 * RADIUS), np.uint8)
    column = np.empty(width, np.int16)
    for y in range(height):
        above, here, below = image[max(y - 1, 0)], image[y], image[min(y + 1, height - 1)]
        for x in range(width):
            column[x] = above[x] + 2 * here[x] + below[x]
        row = out[y + RADIUS]
        inner = row[RADIUS + 1 : RADIUS + width - 1]
        before, after = column[:-2], column[2:]
        for x in range(width - 2):
            slope: int = int(after[x]) - int(before[x])
            inner[x] = min(max(slope, -limit), limit) + limit
        row[: RADIUS + 1] = row[RADIUS + 1]
        row[RADIUS + width - 1 :] = row[RADIUS + width - 2]
    for y in range(RADIUS):
        out[y] = out[RADIUS]
        out[height + RADIUS + y] = out[height + RADIUS - 1]
    return out


@njit(cache=True)
def match(
    left: np.ndarray,
    right: np.ndarray,
    disparities: int,
    given: bool,
    rating: Rating,
    found: np.ndarray,
    costs: np.ndarray,
    disparity: np.ndarray,
    reliability: np.ndarray,
    sigma: np.ndarray,
) -> None:
    """Disparity of the lowest block cost of every pixel, its reliability by costs, and its standard deviation.

    Args:
        left, right: Gradients from `prefilter`, uint8.
        disparities: Number of disparities searched, from 0; a multiple of 8, at most w.
        given: True to evaluate the disparities in `found`, in [0, disparities), instead of searching.
        rating: Parameters of reliability and standard deviation.
        found: (h, w) int16, best disparity d; written unless `given`. With (1, w), each row overwrites the one before.
        costs: (h, 5, w) or (1, 5, w) int16, written: cost at d - 1, d and d + 1, lowest cost two or more away from d,
            and lowest cost of the matched pixel of the right image with any left pixel. NEVER where undefined.
        disparity: (h, w) float32, sub-pixel; written unless `given`.
        reliability, sigma: (h, w) float32, written.
    """
    height, width = disparity.shape
    padded = width + 2 * RADIUS
    row = np.full((disparities, width + disparities), NEVER, np.int16)  # costs of one image row
    column, threes = np.empty(padded, np.int8), np.empty(padded, np.int16)
    back = np.empty(width, np.int16)
    for d in range(disparities):
        row[d, d:width] = 0
        for k in range(SIDE):
            _change(column[d:], left[k, d:], right[k], right[k], right[k])  # none leaves
            _box(column[d:], threes, row[d, d:width])
    for y in range(height):
        new, old = y + SIDE - 1, y - 1
        place, kept = found[y % len(found)], costs[y % len(costs)]
        best = kept[1]
        best[:] = NEVER
        back[:] = NEVER
        if not given:
            place[:] = 0
        for first in range(0, disparities, 8):  # while the costs are in the cache
            for d in range(first, first + 8):
                if y > 0:
                    _change(column[d:], left[new, d:], right[new], left[old, d:], right[old])
                    _box(column[d:], threes, row[d, d:width])
            if not given:
                _least(row, first, best, place)
            _least_back(row, first, back)
        _rival(row, place, kept[3])
        _gather(row, place, back, kept)
        if not given:
            sub_pixel(place, kept, disparity[y])
        rate_row(kept, rating, reliability[y], sigma[y])


@njit(cache=True, forceinline=True)
def _change(
    column: np.ndarray, left: np.ndarray, right: np.ndarray, left0: np.ndarray, right0: np.ndarray
) -> None:
    """Change of the sum of each column of the block: a new row of pixels comes, the oldest one leaves."""
    for i in range(column.size):
        a, b, a0, b0 = left[i], right[i], left0[i], right0[i]
        comes, leaves = np.int8(max(a, b) - min(a, b)), np.int8(max(a0, b0) - min(a0, b0))
        column[i] = np.int8(comes - leaves)


@njit(cache=True, forceinline=True)
def _box(column: np.ndarray, threes: np.ndarray, out: np.ndarray) -> None:
    """Add sums of nine neighbours, built from sums of three."""
    n = out.size
    second, third = column[1:], column[2:]
    for i in range(n + SIDE - 3):
        threes[i] = column[i] + second[i] + third[i]
    a, b = threes[3:], threes[6:]
    for i in range(n):
        out[i] += threes[i] + a[i] + b[i]


@njit(cache=True, forceinline=True)
def _least(row: np.ndarray, d: int, best: np.ndarray, place: np.ndarray) -> None:
    """Update the lowest cost of each left pixel, and its first disparity, with the eight disparities from d on."""
    n = best.size
    c0, c1, c2, c3 = row[d, d:n], row[d + 1, d:n], row[d + 2, d:n], row[d + 3, d:n]
    c4, c5, c6, c7 = row[d + 4, d:n], row[d + 5, d:n], row[d + 6, d:n], row[d + 7, d:n]
    d0, d1, d2, d3 = np.int16(d), np.int16(d + 1), np.int16(d + 2), np.int16(d + 3)
    d4, d5, d6, d7 = np.int16(d + 4), np.int16(d + 5), np.int16(d + 6), np.int16(d + 7)
    least, at = best[d:], place[d:]
    for x in range(n - d):
        a = min(min(c0[x], c1[x]), min(c2[x], c3[x]))
        b = min(min(c4[x], c5[x]), min(c6[x], c7[x]))
        low, before = min(a, b), least[x]
        p0 = d0 if c0[x] == low else NEVER
        p1 = d1 if c1[x] == low else NEVER
        p2 = d2 if c2[x] == low else NEVER
        p3 = d3 if c3[x] == low else NEVER
        p4 = d4 if c4[x] == low else NEVER
        p5 = d5 if c5[x] == low else NEVER
        p6 = d6 if c6[x] == low else NEVER
        p7 = d7 if c7[x] == low else NEVER
        first = min(min(min(p0, p1), min(p2, p3)), min(min(p4, p5), min(p6, p7)))
        at[x] = first if low < before else at[x]
        least[x] = min(low, before)


@njit(cache=True, forceinline=True)
def _least_back(row: np.ndarray, d: int, back: np.ndarray) -> None:
    """The same for each right pixel, along the diagonals of the costs of the row."""
    n = back.size
    c0, c1, c2, c3 = row[d, d:], row[d + 1, d + 1 :], row[d + 2, d + 2 :], row[d + 3, d + 3 :]
    c4, c5, c6 = row[d + 4, d + 4 :], row[d + 5, d + 5 :], row[d + 6, d + 6 :]
    c7 = row[d + 7, d + 7 :]
    for x in range(n - d):
        a = min(min(c0[x], c1[x]), min(c2[x], c3[x]))
        b = min(min(c4[x], c5[x]), min(c6[x], c7[x]))
        back[x] = min(back[x], min(a, b))


@njit(cache=True)
def _rival(row: np.ndarray, place: np.ndarray, away: np.ndarray) -> None:
    """Lowest cost at least two disparities away from the best one."""
    n = place.size
    none = np.int16(0)
    away[:] = NEVER
    for d in range(0, row.shape[0], 4):
        c0, c1, c2, c3 = row[d, d:n], row[d + 1, d:n], row[d + 2, d:n], row[d + 3, d:n]
        d0, d1, d2, d3 = np.int16(d), np.int16(d + 1), np.int16(d + 2), np.int16(d + 3)
        before, after = np.int16(d - 1), np.int16(d + 4)
        at, least = place[d:], away[d:]
        for x in range(n - d):
            here = at[x]
            f = NEVER if here == before else none
            f0 = NEVER if here == d0 else none
            f1 = NEVER if here == d1 else none
            f2 = NEVER if here == d2 else none
            f3 = NEVER if here == d3 else none
            f4 = NEVER if here == after else none
            a, b = max(c0[x], max(f, max(f0, f1))), max(c1[x], max(f0, max(f1, f2)))
            c, e = max(c2[x], max(f1, max(f2, f3))), max(c3[x], max(f2, max(f3, f4)))
            least[x] = min(least[x], min(min(a, b), min(c, e)))


@njit(cache=True)
def _gather(row: np.ndarray, place: np.ndarray, back: np.ndarray, costs: np.ndarray) -> None:
    """Copy the costs about the best disparity of each pixel, and those of its match in the right image."""
    stride = np.uintp(row.shape[1])
    last, flat = np.uintp(row.shape[0] - 1) * stride, row.ravel()
    lower, here, higher, mutual = costs[0], costs[1], costs[2], costs[4]
    for x in range(place.size):
        start = np.uintp(place[x]) * stride
        at = start + np.uintp(x)
        lower[x] = flat[at - stride] if start > 0 else NEVER
        here[x] = flat[at]
        higher[x] = flat[at + stride] if start < last else NEVER
        mutual[x] = back[x - place[x]] if place[x] <= x else NEVER
