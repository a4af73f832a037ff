"""Compiled loops of stereo reliability: sub-pixel fit, agreement of neighbours, reliability and sigma."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..primitives.compiled import njit

RADIUS = 4  # px, of a block
SIDE = 2 * RADIUS + 1  # ours: 9 px
NEVER = np.int16(32767)  # cost of a disparity that leads out of the image
NO_DISPARITY = np.int16(-8000)  # in sixteenths of a pixel; agrees with no neighbour
NEAR_VOTES, FAR_VOTES = np.int16(3), np.int16(1)
"""Weight of near and far neighbours; near ones are more often on the same surface."""
REACH = 10  # px, to the farthest neighbours that vote
LEAST_PX = np.float32(2.0)  # ours: below, a quarter of a pixel is an eighth of the depth
SAME_PX = np.float32(1.0)  # ours: neighbours whose disparities differ by less agree
STEEPEST = 8  # ours: sixteenths of a pixel per pixel; on a steeper surface blocks do not match
FEW_VOTES = np.float32(96 * 0.30)  # ours: of 96 votes; reliability is 0 below
FULL_VOTES = np.float32(96)  # ours: reliability is not reduced above
SHARPNESS = np.float32(0.5)  # ours: s_0, grey levels; noise of 2 grey levels alone gives about 1
RIVAL_SHARE = np.float32(0.30)  # ours: reliability left beside an equally good second minimum
GREY_NOISE = np.float32(1.0)  # ours: cost per pixel added in ratios of small costs
MOST_SIGMA_PX = np.float32(1.0)  # ours


class Rating(NamedTuple):
    """Parameters of reliability and standard deviation.

    Args:
        uniqueness: u_0, relative distance of the second-best cost from which a match is unique.
        sigma_px: Standard deviation of a perfect match.
        sigma_per_blur: Additional standard deviation per ratio of remaining cost to slope.
    """

    uniqueness: np.float32
    sigma_px: np.float32
    sigma_per_blur: np.float32


@njit(cache=True, error_model="numpy")
def rate_row(costs: np.ndarray, rating: Rating, reliability: np.ndarray, sigma: np.ndarray) -> None:
    """Reliability by costs, and standard deviation in px, of one row.

    Args:
        costs: (5, w) int16 from `match`.
        rating: Parameters.
        reliability, sigma: (w,) float32, written.
    """
    per_pixel = np.float32(1.0 / (SIDE * SIDE))
    _clarity(costs[0], costs[1], costs[2], costs[3], costs[4], per_pixel, rating, reliability)
    _spread(costs[0], costs[1], costs[2], per_pixel, rating, sigma)


@njit(cache=True, error_model="numpy")
def sub_pixel(found: np.ndarray, costs: np.ndarray, out: np.ndarray) -> None:
    """Sub-pixel disparity of one row, float32, by a V through the three lowest costs (5, w) of each pixel."""
    lower, here, higher = costs[0], costs[1], costs[2]
    for x in range(found.size):
        a, b = np.float32(lower[x]), np.float32(higher[x])
        arm = max(a, b) - np.float32(here[x])
        step = np.float32(0.5) * (a - b) / max(arm, np.float32(1.0))
        one_sided = lower[x] == NEVER or higher[x] == NEVER
        out[x] = np.float32(found[x]) + (np.float32(0.0) if one_sided else step)


@njit(cache=True, error_model="numpy")
def agree(
    disparity: np.ndarray, reliability: np.ndarray, sigma: np.ndarray, missing: np.ndarray
) -> None:
    """Reduce the reliability where few neighbours agree, and remove disparities that are impossible.

    Args:
        disparity: (h, w) float32, set to NaN where it is below `LEAST_PX` or leads out of the image.
        reliability, sigma: (h, w) float32; 0 and NaN there.
        missing: (h, w) uint8, written: 1 there, else 0.
    """
    height, width = disparity.shape
    columns = np.arange(width).astype(np.float32)
    sixteenths = in_sixteenths(disparity)
    votes = np.empty(width, np.int16)
    for y in range(height):
        count_votes(sixteenths, y, votes)
        found, own, spread, none = disparity[y], reliability[y], sigma[y], missing[y]
        _agreement(votes, found, columns, own)
        for x in range(width):
            valid = (found[x] >= LEAST_PX) & (found[x] <= columns[x])
            found[x] = found[x] if valid else np.float32(np.nan)
        for x in range(width):
            none[x] = np.uint8(found[x] != found[x])
        for x in range(width):
            spread[x] = spread[x] + np.float32(0.0) * found[x]  # NaN where there is none


@njit(cache=True, error_model="numpy")
def in_sixteenths(disparity: np.ndarray) -> np.ndarray:
    """Disparity (h, w) float32 in sixteenths of a pixel, int16, with its border repeated `REACH` px outward.

    `NO_DISPARITY` where it is NaN, below `LEAST_PX`, or beyond the left border.
    """
    height, width = disparity.shape
    sixteenths = np.empty((height + 2 * REACH, width + 2 * REACH), np.int16)
    for y in range(height):
        source, target = disparity[y], sixteenths[y + REACH]
        inner = target[REACH:]
        for x in range(width):
            d = source[x]
            ok = d >= LEAST_PX and d <= x
            inner[x] = np.int16(np.float32(16.0) * d) if ok else NO_DISPARITY
        target[:REACH] = target[REACH]
        target[REACH + width :] = target[REACH + width - 1]
    for y in range(REACH):
        sixteenths[y] = sixteenths[REACH]
        sixteenths[REACH + height + y] = sixteenths[REACH + height - 1]
    return sixteenths


@njit(cache=True, error_model="numpy")
def count_votes(sixteenths: np.ndarray, y: int, count: np.ndarray) -> None:
    """Votes for the pixels of row `y`, in [0, 96], by 48 neighbours: 24 within 4 px with three votes each, 24 within 10 px.

    Neighbours agree if their disparities differ by at most `SAME_PX`, the far ones by 1.5 times as much; two on opposite
    sides also if their mean does, so that a slanted surface supports itself.

    Args:
        sixteenths: From `in_sixteenths`.
        y: The row.
        count: (w,) int16, written.
    """
    near, far = np.int16(16.0 * SAME_PX), np.int16(24.0 * SAME_PX)
    middle = sixteenths[y + REACH, REACH:]
    count[:] = 0
    for i in range(3):
        for k in range(1 if i == 0 else -2, 3):  # each pair of opposite neighbours once
            _vote(sixteenths, y, i, k, 2, middle, near, NEAR_VOTES, count)
            _vote(sixteenths, y, i, k, 5, middle, far, FAR_VOTES, count)


@njit(cache=True, error_model="numpy", forceinline=True)
def _vote(
    sixteenths: np.ndarray,
    y: int,
    down: int,
    right: int,
    step: int,
    middle: np.ndarray,
    limit: np.int16,
    weight: np.int16,
    count: np.ndarray,
) -> None:
    """Votes for every pixel of row `y` of its neighbours some steps down and right, and on the opposite side.

    Each votes if it agrees, and both if their mean does.
    """
    steep = np.int16(4 * step * STEEPEST)  # between two neighbours up to two steps away
    none = np.int16(0)
    a = sixteenths[y + REACH + down * step, REACH + right * step :]
    b = sixteenths[y + REACH - down * step, REACH - right * step :]
    for x in range(count.size):
        one, other = np.int16(a[x] - middle[x]), np.int16(b[x] - middle[x])
        mean, one, other = abs(np.int16(one + other)), abs(one), abs(other)
        # at most the limit if the mean agrees and the surface is not too steep
        slanted = max(mean, np.int16(one + other - steep + limit))
        for_one = weight if min(one, slanted) <= limit else none
        count[x] += for_one + (weight if min(other, slanted) <= limit else none)


@njit(cache=True, error_model="numpy")
def _clarity(
    lower: np.ndarray,
    here: np.ndarray,
    higher: np.ndarray,
    rival: np.ndarray,
    mutual: np.ndarray,
    per_pixel: np.float32,
    rating: Rating,
    reliability: np.ndarray,
) -> None:
    """Reliability of one row by its costs: texture, distance of the second minimum, left-right agreement."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for x in range(reliability.size):
        cost = np.float32(here[x]) * per_pixel
        valley = np.float32(0.5) * (np.float32(lower[x]) + np.float32(higher[x])) * per_pixel - cost
        floor = cost + GREY_NOISE
        clear = (np.float32(rival[x]) * per_pixel - cost) / (floor * rating.uniqueness)
        shared = min(max((np.float32(mutual[x]) * per_pixel + GREY_NOISE) / floor, zero), one)
        texture = min(max(valley / SHARPNESS, zero), one)
        clear = RIVAL_SHARE + (one - RIVAL_SHARE) * min(max(clear, zero), one)
        reliability[x] = texture * clear * shared * shared


@njit(cache=True, error_model="numpy")
def _spread(
    lower: np.ndarray,
    here: np.ndarray,
    higher: np.ndarray,
    per_pixel: np.float32,
    rating: Rating,
    sigma: np.ndarray,
) -> None:
    """Standard deviation of one row, px: it grows with the ratio of the remaining cost to the slope."""
    for x in range(sigma.size):
        cost = np.float32(here[x]) * per_pixel
        ends = (np.float32(lower[x]) + np.float32(higher[x])) * per_pixel
        valley = max(np.float32(0.5) * ends - cost, np.float32(0.01))
        blur = rating.sigma_per_blur * (cost + GREY_NOISE) / valley
        sigma[x] = min(rating.sigma_px + blur, MOST_SIGMA_PX)


@njit(cache=True, error_model="numpy")
def _agreement(
    votes: np.ndarray, disparity: np.ndarray, columns: np.ndarray, reliability: np.ndarray
) -> None:
    """Reduce the reliability of one row where few neighbours agree; 0 where there is no disparity."""
    zero, one = np.float32(0.0), np.float32(1.0)
    scale = one / (FULL_VOTES - FEW_VOTES)
    for x in range(reliability.size):
        agree = min(max((np.float32(votes[x]) - FEW_VOTES) * scale, zero), one)
        valid = (disparity[x] >= LEAST_PX) & (disparity[x] <= columns[x])
        reliability[x] = reliability[x] * agree * agree if valid else zero


@njit(cache=True)
def in_bytes(reliability: np.ndarray, out: np.ndarray) -> None:
    """Reliability (h, w) in 255ths, rounded, uint8."""
    for y in range(out.shape[0]):
        own, row = reliability[y], out[y]
        for x in range(own.size):
            row[x] = np.uint8(np.int32(np.float32(255.0) * own[x] + np.float32(0.5)))


@njit(cache=True, error_model="numpy")
def reduce_isolated(
    reliability: np.ndarray,
    around: np.ndarray,
    enough: np.float32,
    least: np.float32,
    region: np.ndarray,
) -> None:
    """Multiply the reliability by that of its surroundings, as a share of `enough`, and mark where `least` remains.

    Args:
        reliability: (h, w) float32, changed.
        around: (h, w) uint8, mean reliability around each pixel.
        enough: Mean from which a pixel keeps all of its own.
        least: Reliability that is marked.
        region: (h, w) uint8, 1 where marked; other pixels stay as they are.
    """
    one = np.float32(1.0)
    for y in range(reliability.shape[0]):
        own, mean, mark = reliability[y], around[y], region[y]
        for x in range(own.size):
            own[x] *= min(np.float32(mean[x]) / enough, one)
        for x in range(own.size):
            mark[x] |= np.uint8(own[x] >= least)


@njit(cache=True)
def reduce_outside(reliability: np.ndarray, inside: np.ndarray, share: np.float32) -> None:
    """Multiply the reliability (h, w) by `share` where `inside` (h, w) uint8 is 0."""
    one = np.float32(1.0)
    for y in range(reliability.shape[0]):
        own, kept = reliability[y], inside[y]
        for x in range(own.size):
            own[x] *= one if kept[x] != 0 else share
