"""Orientations of keypoints: a histogram of Gaussian-Hermite gradients, or of differences, around each.

The masks run only within the window of a histogram: the even one first along the other axis, then the odd ones,
with pixels in pairs around the middle. Only `moment_gradients` computes gradients from moments.
"""

from __future__ import annotations

import math

import numpy as np

from ..primitives.compiled import njit

BINS = 36
PI = math.pi


@njit(cache=True, nogil=True, fastmath=True)
def _patch(level: np.ndarray, row0: int, col0: int, extent: int, patch: np.ndarray) -> None:
    """Copy a square window, row after row; the border is replicated."""
    height, width = level.shape
    inside = col0 >= 0 and col0 + extent <= width
    for r in range(extent):
        source = level[min(max(row0 + r, 0), height - 1)]
        line = patch[r * extent : (r + 1) * extent]
        if inside:
            for c in range(extent):
                line[c] = source[col0 + c]
        else:
            for c in range(extent):
                line[c] = source[min(max(col0 + c, 0), width - 1)]


@njit(cache=True, nogil=True, fastmath=True)
def _even(source: np.ndarray, step: int, weights: np.ndarray, out: np.ndarray) -> None:
    """Convolve with the mask of order 0, from its middle outwards, whose entries lie `step` apart."""
    half = weights.shape[0] - 1
    centre, weight = source[half * step :], weights[0]
    for i in range(out.size):
        out[i] = weight * centre[i]
    for k in range(1, half + 1):
        before, after, weight = source[(half - k) * step :], source[(half + k) * step :], weights[k]
        for i in range(out.size):
            out[i] += weight * (before[i] + after[i])


@njit(cache=True, nogil=True, fastmath=True)
def _odd(
    source: np.ndarray, step: int, masks: np.ndarray, sums: np.ndarray, total: np.ndarray
) -> None:
    """Convolutions with the odd masks: that of order 1, and the sum of the squares of all."""
    half = masks.shape[1] - 1
    for i in range(total.size):
        total[i] = np.float32(0.0)
    for m in range(masks.shape[0] - 1, 0, -1):
        for i in range(sums.size):
            sums[i] = np.float32(0.0)
        for k in range(1, half + 1):
            weight = masks[m, k]
            before, after = source[(half - k) * step :], source[(half + k) * step :]
            for i in range(sums.size):
                sums[i] += weight * (after[i] - before[i])
        for i in range(total.size):
            total[i] += sums[i] * sums[i]


@njit(cache=True, nogil=True, fastmath=True)
def moment_gradients(
    patch: np.ndarray,
    rows: int,
    wide: int,
    masks: np.ndarray,
    work: np.ndarray,
    gx: np.ndarray,
    gy: np.ndarray,
    first_order: bool,
) -> None:
    """Signed roots of the sums of squared odd moments along x and y, over the middle of a patch.

    Everything runs over flat arrays, since a window is too narrow for fast loops over its rows. The last entries of each
    row of the results, twice half a mask, are no gradients.

    patch: (rows + 2 half) rows of `wide` pixels, flat: the window with half a mask around it.
    masks: (1 + orders, half + 1), the mask of order 0 and the odd ones, from their middle outwards.
    work: (4, at least as long as the patch), scratch. gx, gy: `rows` rows of `wide`, flat, out.
    first_order: the direction is that of order 1 alone, without bias.
    """
    half = masks.shape[1] - 1
    count = rows * wide - 2 * half
    smooth, sums, total, square = work[0], work[1, :count], work[2, :count], work[3, :count]
    _even(patch, wide, masks[0], smooth[: rows * wide])  # order 0 down the columns
    _odd(smooth, 1, masks, gx[:count], square)  # then odd orders along the rows
    _even(patch, 1, masks[0], smooth[: (rows + 2 * half) * wide - 2 * half])
    _odd(smooth, wide, masks, sums, total)
    if first_order:
        for i in range(count):
            first = gx[i] * gx[i] + sums[i] * sums[i] + np.float32(1e-30)
            scale = np.sqrt((square[i] + total[i]) / first)
            gy[i] = sums[i] * scale
            gx[i] *= scale
    else:
        for i in range(count):
            gx[i] = math.copysign(np.sqrt(square[i]), gx[i])
            gy[i] = math.copysign(np.sqrt(total[i]), sums[i])


@njit(cache=True, nogil=True, fastmath=True)
def _differences(patch: np.ndarray, rows: int, wide: int, gx: np.ndarray, gy: np.ndarray) -> None:
    """Central differences of the pixels; arguments as of `moment_gradients`, with one pixel around the window."""
    above, line, below = patch[1:], patch[wide:], patch[2 * wide + 1 :]
    for i in range(rows * wide - 2):
        gx[i] = line[i + 2] - line[i]
        gy[i] = below[i] - above[i]


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
    side_most = 2 * reach_most + 1
    longest = (side_most + 2 * half) * (side_most + 2 * half)
    patch, work = np.empty(longest, np.float32), np.empty((4, longest), np.float32)
    gx, gy = np.empty(longest, np.float32), np.empty(longest, np.float32)
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
        extent = side + 2 * half
        late = 1 if printed else 0
        top, left = row - reach - half + late, column - reach - half + late
        _patch(level, top, left, extent, patch)
        if masks.shape[0] > 1:
            moment_gradients(patch, side, extent, masks, work, gx, gy, first_order)
        else:
            _differences(patch, side, extent, gx, gy)
        for c in range(side):
            falls[c] = math.exp(-((c - reach) ** 2) / (2.0 * (window * sigma) ** 2))
        for b in range(BINS):
            votes[b] = 0.0
        for r in range(side):
            across = gx[r * extent : r * extent + side]
            down = gy[r * extent : r * extent + side]
            if printed:
                for c in range(side):
                    angle[c] = math.atan2(down[c] ** 2, across[c] ** 2)
            else:
                angles(across, down, side, angle)
            _weigh(across, down, angle, falls[r], falls, weights, bins)
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
