"""Compiled loops behind the reliability of a disparity: sub-pixel fit, support by neighbours, the measure."""

from __future__ import annotations

import numpy as np
from numba import njit

from ._block_matching_kernels import NEVER

NOWHERE = np.int16(-8000)  # disparity of a pixel without one, in sixteenths: agrees with none
NEAR_VOTES, FAR_VOTES = np.int16(3), np.int16(1)  # a depth step is nearer to the near ones
REACH = 10  # px, of the farther neighbours that are asked


@njit(cache=True, error_model="numpy")
def between(found: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Sub-pixel disparity, float32, by a V through the three costs about each best one."""
    height, width = found.shape
    out = np.empty((height, width), np.float32)
    for y in range(height):
        lower, here, higher = costs[y, 0], costs[y, 1], costs[y, 2]
        place, row = found[y], out[y]
        for x in range(width):
            a, b = np.float32(lower[x]), np.float32(higher[x])
            arm = max(a, b) - np.float32(here[x])
            step = np.float32(0.5) * (a - b) / max(arm, np.float32(1.0))
            one_sided = lower[x] == NEVER or higher[x] == NEVER
            row[x] = np.float32(place[x]) + (np.float32(0.0) if one_sided else step)
    return out


@njit(cache=True, error_model="numpy")
def support(disparity: np.ndarray, least: np.float32, tolerance: np.float32) -> np.ndarray:
    """Votes of 48 neighbours that have the same disparity: 24 within 4 px, three votes each, 24 within 10.

    Args:
        disparity: (h, w) float32; NaN, below `least`, or beyond the left border: none.
        tolerance: Difference that counts as the same, px; 1.5 times as much for those farther away.

    Returns:
        (h, w) int16 in [0, 96]; outside the image the nearest pixel of it is asked.
    """
    height, width = disparity.shape
    sixteenths = np.empty((height + 2 * REACH, width + 2 * REACH), np.int16)
    for y in range(height):
        source, target = disparity[y], sixteenths[y + REACH]
        inner = target[REACH:]
        for x in range(width):
            d = source[x]
            ok = d >= least and d <= x
            inner[x] = np.int16(np.float32(16.0) * d) if ok else NOWHERE
        target[:REACH] = target[REACH]
        target[REACH + width :] = target[REACH + width - 1]
    for y in range(REACH):
        sixteenths[y] = sixteenths[REACH]
        sixteenths[REACH + height + y] = sixteenths[REACH + height - 1]
    votes = np.empty((height, width), np.int16)
    near, far = np.int16(16.0 * tolerance), np.int16(24.0 * tolerance)
    for y in range(height):
        middle, count = sixteenths[y + REACH, REACH:], votes[y]
        count[:] = -NEAR_VOTES - FAR_VOTES  # each pixel votes for itself twice
        for i in range(-2, 3):
            _vote(sixteenths[y + REACH + 2 * i], 2, middle, near, NEAR_VOTES, count)
            _vote(sixteenths[y + REACH + 5 * i], 5, middle, far, FAR_VOTES, count)
    return votes


@njit(cache=True, error_model="numpy")
def _vote(
    row: np.ndarray,
    step: int,
    middle: np.ndarray,
    limit: np.int16,
    weight: np.int16,
    count: np.ndarray,
) -> None:
    """Five neighbours in one row, `step` apart, their middle one in the column of the pixel."""
    a, b, c = row[REACH - 2 * step :], row[REACH - step :], row[REACH:]
    d, e = row[REACH + step :], row[REACH + 2 * step :]
    none = np.int16(0)
    for x in range(count.size):
        here, total = middle[x], count[x]
        total += weight if -limit <= np.int16(a[x] - here) <= limit else none
        total += weight if -limit <= np.int16(b[x] - here) <= limit else none
        total += weight if -limit <= np.int16(c[x] - here) <= limit else none
        total += weight if -limit <= np.int16(d[x] - here) <= limit else none
        total += weight if -limit <= np.int16(e[x] - here) <= limit else none
        count[x] = total


@njit(cache=True, error_model="numpy")
def trust(
    disparity: np.ndarray,
    costs: np.ndarray,
    votes: np.ndarray,
    area: int,
    least: np.float32,
    shape: np.ndarray,
    reliability: np.ndarray,
    sigma: np.ndarray,
) -> None:
    """Reliability in [0, 1] and deviation in px of every disparity; where there is none, 0 and NaN.

    Args:
        disparity: (h, w) float32, set to NaN where there is none.
        costs: (h, 5, w) int16 from `match`; votes: (h, w) int16 from `support`.
        area: Pixels of a block.
        shape: float32: fewest and enough votes, enough sharpness, enough distance of the rival, share of
            the reliability that a close rival leaves, cost of noise, deviations at best, per blur, at most.
    """
    noise, best, blur, most = shape[5], shape[6], shape[7], shape[8]
    height, width = disparity.shape
    per_pixel = np.float32(1.0 / area)
    columns = np.arange(width).astype(np.float32)
    for y in range(height):
        lower, here, higher = costs[y, 0], costs[y, 1], costs[y, 2]
        _clarity(lower, here, higher, costs[y, 3], costs[y, 4], per_pixel, shape, reliability[y])
        _agreement(votes[y], disparity[y], columns, shape[0], shape[1], least, reliability[y])
        spread, place = sigma[y], disparity[y]
        for x in range(width):
            cost = np.float32(here[x]) * per_pixel
            ends = (np.float32(lower[x]) + np.float32(higher[x])) * per_pixel
            valley = max(np.float32(0.5) * ends - cost, np.float32(0.01))
            spread[x] = min(best + blur * (cost + noise) / valley, most)
        for x in range(width):
            there = (place[x] >= least) & (place[x] <= columns[x])
            place[x] = place[x] if there else np.float32(np.nan)
        for x in range(width):
            spread[x] = spread[x] + np.float32(0.0) * place[x]  # NaN where there is none


@njit(cache=True, error_model="numpy")
def _clarity(
    lower: np.ndarray,
    here: np.ndarray,
    higher: np.ndarray,
    rival: np.ndarray,
    mutual: np.ndarray,
    per_pixel: np.float32,
    shape: np.ndarray,
    belief: np.ndarray,
) -> None:
    """Texture, distance of the rival, and whether the other image agrees: from the costs alone."""
    sharp, apart, kept, noise = shape[2], shape[3], shape[4], shape[5]
    zero, one = np.float32(0.0), np.float32(1.0)
    for x in range(belief.size):
        cost = np.float32(here[x]) * per_pixel
        valley = np.float32(0.5) * (np.float32(lower[x]) + np.float32(higher[x])) * per_pixel - cost
        floor = cost + noise
        clear = (np.float32(rival[x]) * per_pixel - cost) / (floor * apart)
        shared = min(max((np.float32(mutual[x]) * per_pixel + noise) / floor, zero), one)
        texture = min(max(valley / sharp, zero), one)
        clear = kept + (one - kept) * min(max(clear, zero), one)
        belief[x] = texture * clear * shared * shared


@njit(cache=True, error_model="numpy")
def _agreement(
    votes: np.ndarray,
    place: np.ndarray,
    columns: np.ndarray,
    few: np.float32,
    enough: np.float32,
    least: np.float32,
    belief: np.ndarray,
) -> None:
    zero, one = np.float32(0.0), np.float32(1.0)
    scale = one / (enough - few)
    for x in range(belief.size):
        agree = min(max((np.float32(votes[x]) - few) * scale, zero), one)
        is_there = (place[x] >= least) & (place[x] <= columns[x])
        belief[x] = belief[x] * agree * agree if is_there else zero
