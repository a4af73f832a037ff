"""Compiled loops of block matching: prefilter, block costs by running sums, best disparity, reliability costs.

Each loop over pixels and disparities runs along one row of 16-bit integers and writes one array: LLVM only
vectorises such loops. Signed 16 bits hold every block cost: at most 62 on 9 x 9 pixels, 5022.
"""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit

RADIUS = 4  # px, of a block
SIDE = 2 * RADIUS + 1  # ours: 9 px
NEVER = np.int16(32767)  # cost of a disparity that leads out of the image


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
    found: np.ndarray,
    costs: np.ndarray,
) -> None:
    """Disparity of the lowest block cost of every pixel, and the costs that its reliability depends on.

    Args:
        left, right: Gradients from `prefilter`, uint8.
        disparities: Number of disparities searched, from 0; a multiple of 8, at most w.
        given: True to evaluate the disparities in `found`, in [0, disparities), instead of searching.
        found: (h, w) int16, best disparity d; written unless `given`.
        costs: (h, 5, w) int16, written: cost at d - 1, d and d + 1, lowest cost two or more away from d,
            and lowest cost of the matched pixel of the right image with any left pixel. NEVER where
            undefined.
    """
    height, width = found.shape
    padded = width + 2 * RADIUS
    row = np.full((disparities, width + disparities), NEVER, np.int16)  # costs of one image row
    column, threes = np.empty(padded, np.int16), np.empty(padded, np.int16)
    back = np.empty(width, np.int16)
    for d in range(disparities):
        column[:] = 0
        for k in range(SIDE):
            _add(column[d:], left[k, d:], right[k])
        row[d, d:width] = 0
        _box(column[d:], threes, row[d, d:width])
    for y in range(height):
        new, old = y + SIDE - 1, y - 1
        best = costs[y, 1]
        best[:] = NEVER
        back[:] = NEVER
        for first in range(0, disparities, 8):  # while the costs are in the cache
            for d in range(first, first + 8):
                if y > 0:
                    _change(column[d:], left[new, d:], right[new], left[old, d:], right[old])
                    _box(column[d:], threes, row[d, d:width])
            if not given:
                _least(row, first, best)
            _least_back(row, first, back)
        if not given:
            _least_place(row, best, found[y])
        _rival(row, found[y], costs[y, 3])
        _gather(row, found[y], back, costs[y])


@njit(cache=True)
def _add(column: np.ndarray, left: np.ndarray, right: np.ndarray) -> None:
    for i in range(column.size):
        a, b = left[i], right[i]
        column[i] += a - b if a > b else b - a


@njit(cache=True)
def _change(
    column: np.ndarray, left: np.ndarray, right: np.ndarray, left0: np.ndarray, right0: np.ndarray
) -> None:
    """Change of the sum of each column of the block: a new row of pixels comes, the oldest one leaves."""
    for i in range(column.size):
        a, b, a0, b0 = left[i], right[i], left0[i], right0[i]
        comes = a - b if a > b else b - a
        leaves = a0 - b0 if a0 > b0 else b0 - a0
        column[i] = comes - leaves


@njit(cache=True)
def _box(column: np.ndarray, threes: np.ndarray, out: np.ndarray) -> None:
    """Add sums of nine neighbours, built from sums of three."""
    n = out.size
    second, third = column[1:], column[2:]
    for i in range(n + SIDE - 3):
        threes[i] = column[i] + second[i] + third[i]
    a, b = threes[3:], threes[6:]
    for i in range(n):
        out[i] += threes[i] + a[i] + b[i]


@njit(cache=True)
def _least(row: np.ndarray, d: int, best: np.ndarray) -> None:
    """Update the lowest cost of each left pixel with the eight disparities from d on."""
    n = best.size
    c0, c1, c2, c3 = row[d, d:n], row[d + 1, d:n], row[d + 2, d:n], row[d + 3, d:n]
    c4, c5, c6, c7 = row[d + 4, d:n], row[d + 5, d:n], row[d + 6, d:n], row[d + 7, d:n]
    least = best[d:]
    for x in range(n - d):
        a = min(min(c0[x], c1[x]), min(c2[x], c3[x]))
        b = min(min(c4[x], c5[x]), min(c6[x], c7[x]))
        least[x] = min(least[x], min(a, b))


@njit(cache=True)
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
def _least_place(row: np.ndarray, best: np.ndarray, place: np.ndarray) -> None:
    """First disparity that has the lowest cost."""
    n = best.size
    place[:] = 0
    for d in range(row.shape[0] - 4, -1, -4):
        c0, c1, c2, c3 = row[d, d:n], row[d + 1, d:n], row[d + 2, d:n], row[d + 3, d:n]
        d0, d1, d2, d3 = np.int16(d), np.int16(d + 1), np.int16(d + 2), np.int16(d + 3)
        least, at = best[d:], place[d:]
        for x in range(n - d):
            low = least[x]
            late = d3 if c3[x] == low else at[x]
            late = d2 if c2[x] == low else late
            late = d1 if c1[x] == low else late
            at[x] = d0 if c0[x] == low else late


@njit(cache=True)
def _rival(row: np.ndarray, place: np.ndarray, away: np.ndarray) -> None:
    """Lowest cost at least two disparities away from the best one."""
    n = place.size
    away[:] = NEVER
    for d in range(0, row.shape[0], 4):
        c0, c1, c2, c3 = row[d, d:n], row[d + 1, d:n], row[d + 2, d:n], row[d + 3, d:n]
        at, least = place[d:], away[d:]
        for x in range(n - d):
            gap = np.int16(at[x] - np.int16(d))
            a = c0[x] if (gap < -1 or gap > 1) else NEVER
            b = c1[x] if (gap < 0 or gap > 2) else NEVER
            c = c2[x] if (gap < 1 or gap > 3) else NEVER
            e = c3[x] if (gap < 2 or gap > 4) else NEVER
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
