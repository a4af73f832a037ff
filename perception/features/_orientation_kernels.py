"""Orientations of keypoints: a histogram of Gaussian-Hermite gradients, or of differences, around each.

The masks run only within the window of a histogram: the even one first along the other axis, then the odd ones,
with pixels in pairs around the middle. Only `moment_gradients` computes gradients from moments.
"""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit

BINS = 36
LANES = 8  # columns that are computed together
PI = math.pi


@njit(cache=True, nogil=True, fastmath=True)
def _patch(
    level: np.ndarray, row0: int, col0: int, rows: int, columns: int, patch: np.ndarray
) -> None:
    """Copy a window; the border is replicated."""
    height, width = level.shape
    inside = col0 >= 0 and col0 + columns <= width
    for r in range(rows):
        source, line = level[min(max(row0 + r, 0), height - 1)], patch[r]
        if inside:
            for c in range(columns):
                line[c] = source[col0 + c]
        else:
            for c in range(columns):
                line[c] = source[min(max(col0 + c, 0), width - 1)]


@njit(cache=True, nogil=True, fastmath=True)
def moment_gradients(
    patch: np.ndarray,
    rows: int,
    columns: int,
    masks: np.ndarray,
    smooth: np.ndarray,
    sums: np.ndarray,
    total: np.ndarray,
    gx: np.ndarray,
    gy: np.ndarray,
    square: np.ndarray,
    first_order: bool,
) -> None:
    """Signed roots of the sums of squared odd moments along x and y, over the middle of a patch.

    Long, because both axes share their scratch rows.

    patch: at least (rows + 2 half, columns + 2 half), the window with half a mask around it.
    masks: (1 + orders, half + 1), the mask of order 0 and the odd ones, from their middle outwards.
    smooth: at least as large as the patch. sums, total: (columns,). gx, gy: (rows, columns), out.
    square: (rows, columns), scratch. first_order: the direction is that of order 1 alone, without bias.
    """
    half, orders = masks.shape[1] - 1, masks.shape[0] - 1
    wide = columns + 2 * half
    for r in range(rows):  # order 0 down the columns
        out, middle, weight = smooth[r], patch[r + half], masks[0, 0]
        for c in range(wide):
            out[c] = weight * middle[c]
        for k in range(1, half + 1):
            above, below, weight = patch[r + half - k], patch[r + half + k], masks[0, k]
            for c in range(wide):
                out[c] += weight * (above[c] + below[c])
    for r in range(rows):  # then odd orders along the rows
        line, out = smooth[r], gx[r]
        for c in range(columns):
            total[c] = np.float32(0.0)
        for m in range(orders, 0, -1):
            for c in range(columns):
                sums[c] = np.float32(0.0)
            for k in range(1, half + 1):
                weight = masks[m, k]
                left, right = line[half - k :], line[half + k :]
                for c in range(columns):
                    sums[c] += weight * (right[c] - left[c])
            for c in range(columns):
                total[c] += sums[c] * sums[c]
        whole = square[r]
        if first_order:  # sums holds order 1 now
            for c in range(columns):
                out[c], whole[c] = sums[c], total[c]
        else:
            for c in range(columns):
                out[c] = math.copysign(np.sqrt(total[c]), sums[c])
    for r in range(rows + 2 * half):  # order 0 along the rows
        line, out, weight = patch[r], smooth[r], masks[0, 0]
        centre = line[half:]
        for c in range(columns):
            out[c] = weight * centre[c]
        for k in range(1, half + 1):
            left, right, weight = line[half - k :], line[half + k :], masks[0, k]
            for c in range(columns):
                out[c] += weight * (left[c] + right[c])
    for r in range(rows):  # then odd orders down the columns
        out = gy[r]
        for c in range(columns):
            total[c] = np.float32(0.0)
        for m in range(orders, 0, -1):
            for c in range(columns):
                sums[c] = np.float32(0.0)
            for k in range(1, half + 1):
                above, below, weight = smooth[r + half - k], smooth[r + half + k], masks[m, k]
                for c in range(columns):
                    sums[c] += weight * (below[c] - above[c])
            for c in range(columns):
                total[c] += sums[c] * sums[c]
        if first_order:
            other, whole = gx[r], square[r]
            for c in range(columns):
                first = other[c] * other[c] + sums[c] * sums[c] + np.float32(1e-30)
                scale = np.sqrt((whole[c] + total[c]) / first)
                out[c] = sums[c] * scale
                other[c] *= scale
        else:
            for c in range(columns):
                out[c] = math.copysign(np.sqrt(total[c]), sums[c])


@njit(cache=True, nogil=True, fastmath=True)
def _differences(
    patch: np.ndarray, rows: int, columns: int, gx: np.ndarray, gy: np.ndarray
) -> None:
    """Central differences of the pixels; the patch has one pixel around the window."""
    for r in range(rows):
        above, line, below = patch[r], patch[r + 1], patch[r + 2]
        for c in range(columns):
            gx[r, c] = line[c + 2] - line[c]
            gy[r, c] = below[c + 1] - above[c + 1]


@njit(cache=True, nogil=True, fastmath=True)
def angles(gx: np.ndarray, gy: np.ndarray, count: int, out: np.ndarray) -> None:
    """atan2(gy, gx) by a polynomial accurate to 1e-5 rad, without branches."""
    for i in range(count):
        x, y = gx[i], gy[i]
        ax, ay = abs(x), abs(y)
        ratio = min(ax, ay) / (max(ax, ay) + np.float32(1e-30))
        s = ratio * ratio
        a = np.float32(-0.01172120)
        a = a * s + np.float32(0.05265332)
        a = a * s + np.float32(-0.11643287)
        a = a * s + np.float32(0.19354346)
        a = a * s + np.float32(-0.33262347)
        a = (a * s + np.float32(0.99997726)) * ratio
        a = np.float32(PI / 2) - a if ay > ax else a
        a = np.float32(PI) - a if x < 0 else a
        out[i] = -a if y < 0 else a


@njit(cache=True, nogil=True)
def directions(
    levels: np.ndarray,
    points: np.ndarray,
    masks: np.ndarray,
    first_order: bool,
    printed: bool,
    window: float,
    peak_share: float,
    owners: np.ndarray,
    found: np.ndarray,
    strengths: np.ndarray,
) -> int:
    """Peaks of each keypoint's orientation histogram.

    levels: (n, h, w). points: (m, 4) x, y, sigma in px of the octave, integer layer.
    masks: as of `moment_gradients`; with a single row, differences of pixels are used instead.
    first_order: as of `moment_gradients`. printed: a mask displaced by one pixel, and directions by squares.
    window: standard deviation of the histogram's weight, in sigmas. peak_share: of the highest, counts as a peak.
    owners, found: (capacity,), the keypoint and the direction of each peak, rad in [-pi, pi).
    strengths: (capacity,), of each peak: its share of all votes.
    """
    half = masks.shape[1] - 1 if masks.shape[0] > 1 else 1
    reach_most = 1
    for i in range(points.shape[0]):
        reach_most = max(reach_most, round(3.0 * window * points[i, 2]))
    side_most = -(-(2 * reach_most + 1) // LANES) * LANES
    patch = np.empty((side_most + 2 * half, side_most + 2 * half), np.float32)
    smooth = np.empty_like(patch)
    sums, total = np.empty(side_most, np.float32), np.empty(side_most, np.float32)
    gx = np.empty((side_most, side_most), np.float32)
    gy, square = np.empty_like(gx), np.empty_like(gx)
    angle = np.empty(side_most, np.float32)
    weights, bins = np.empty(side_most, np.float64), np.empty(side_most, np.int32)
    votes, smoothed = np.empty(BINS, np.float64), np.empty(BINS, np.float64)
    falls = np.empty(side_most, np.float32)
    count = 0
    for i in range(points.shape[0]):
        sigma = points[i, 2]
        reach = round(3.0 * window * sigma)
        side = 2 * reach + 1
        column, row = round(points[i, 0]), round(points[i, 1])
        level = levels[int(points[i, 3])]
        wide = (
            -(-side // LANES) * LANES
        )  # whole vectors; the columns beyond the window are not used
        extent = side + 2 * half
        late = 1 if printed else 0
        top, left = row - reach - half + late, column - reach - half + late
        _patch(level, top, left, extent, wide + 2 * half, patch)
        if masks.shape[0] > 1:
            moment_gradients(
                patch, side, wide, masks, smooth, sums, total, gx, gy, square, first_order
            )
        else:
            _differences(patch, side, side, gx, gy)
        for c in range(side):
            falls[c] = math.exp(-((c - reach) ** 2) / (2.0 * (window * sigma) ** 2))
        for b in range(BINS):
            votes[b] = 0.0
        for r in range(side):
            if printed:
                for c in range(side):
                    angle[c] = math.atan2(gy[r, c] ** 2, gx[r, c] ** 2)
            else:
                angles(gx[r], gy[r], wide, angle)
            _weigh(gx[r, :wide], gy[r, :wide], angle, falls[r], falls, weights, bins)
            for c in range(side):
                votes[bins[c]] += weights[c]
        count = _peaks(votes, smoothed, peak_share, i, owners, found, strengths, count)
    return count


@njit(cache=True, nogil=True)
def _weigh(
    gx: np.ndarray,
    gy: np.ndarray,
    angle: np.ndarray,
    fall: np.float32,
    falls: np.ndarray,
    weights: np.ndarray,
    bins: np.ndarray,
) -> None:
    """Weight and bin of the gradients of one row of a window."""
    for c in range(gx.size):
        weights[c] = fall * falls[c] * math.sqrt(gx[c] ** 2 + gy[c] ** 2)
    for c in range(gx.size):
        b = np.int32(angle[c] * (BINS / (2.0 * PI)) + (BINS + 0.5))
        bins[c] = b - np.int32(BINS) if b >= BINS else b


@njit(cache=True, nogil=True)
def _peaks(
    votes: np.ndarray,
    smoothed: np.ndarray,
    peak_share: float,
    owner: int,
    owners: np.ndarray,
    found: np.ndarray,
    strengths: np.ndarray,
    count: int,
) -> int:
    """Smooth the histogram by (1 4 6 4 1) / 16 and fit a parabola to every high peak."""
    highest, all_votes = 0.0, 0.0
    for b in range(BINS):
        far = votes[b - 2] + votes[(b + 2) % BINS]
        near = votes[b - 1] + votes[(b + 1) % BINS]
        smoothed[b] = (far + 4.0 * near + 6.0 * votes[b]) / 16.0
        highest = max(highest, smoothed[b])
        all_votes += votes[b]
    if not highest > 0.0:
        return count
    for b in range(BINS):
        left, middle, right = smoothed[b - 1], smoothed[b], smoothed[(b + 1) % BINS]
        if middle > left and middle > right and middle >= peak_share * highest:
            if count == owners.shape[0]:
                return count
            place = b + 0.5 * (left - right) / (left - 2.0 * middle + right)
            direction = place * (2.0 * PI / BINS)
            owners[count] = owner
            found[count] = direction - 2.0 * PI if direction >= PI else direction
            strengths[count] = middle / all_votes
            count += 1
    return count
