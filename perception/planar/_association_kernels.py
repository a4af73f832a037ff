"""Compiled inner loops of the hypothesis bank: branch, weigh, prune, merge.

A bank is a tuple of arrays, first axis the hypothesis, heaviest first: means, roots, log weights, landmarks
held in each slot and when used, and how many sightings in a row were taken for nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..filtering._square_root_kernels import wrapped
from ._planar_kernels import (
    BEARING,
    DEPTH,
    DOUBT_AFTER,
    GATE,
    OUTLIER,
    OUTLIER_DENSITY,
    PLACE,
    SCALE,
    SIZE,
    YAW,
    Weights,
    X,
    Y,
    deviations,
    expected,
    look,
    move,
    occupy,
    pose_covariance,
    slot_of,
    widen,
)

Bank = tuple[np.ndarray, ...]


@njit(cache=True)
def linear_density(
    mean: np.ndarray,
    root: np.ndarray,
    place: np.ndarray,
    entry: int,
    measured: np.ndarray,
    sigmas: np.ndarray,
    p: np.ndarray,
) -> tuple[float, float]:
    """Normalised innovation squared and log density of a sighting, by linearisation at the mean."""
    size = mean.shape[0]
    depth, bearing = expected(mean, place, entry, sigmas[0], p)
    first, second = measured[0] - depth, wrapped(measured[1] - bearing)
    x, y = place[0] - mean[X], place[1] - mean[Y]
    if entry >= 0:
        x, y = x + mean[entry], y + mean[entry + 1]
    c, s = math.cos(mean[YAW]), math.sin(mean[YAW])
    left, square = c * y - s * x, max(x * x + y * y, 1e-4)
    aa, ab, bb = sigmas[0] ** 2, 0.0, sigmas[1] ** 2
    for j in range(size):
        dx, dy = -root[X, j], -root[Y, j]
        if entry >= 0:
            dx, dy = dx + root[entry, j], dy + root[entry + 1, j]
        a = p[SCALE] * (c * dx + s * dy + left * root[YAW, j]) + sigmas[0] * root[DEPTH, j]
        b = (x * dy - y * dx) / square - root[YAW, j] + root[BEARING, j]
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    if entry < 0:
        aa, bb = aa + p[PLACE] ** 2, bb + p[PLACE] ** 2 / square
    determinant = aa * bb - ab * ab
    squared = (bb * first * first - 2.0 * ab * first * second + aa * second * second) / determinant
    return squared, -0.5 * squared - math.log(2.0 * math.pi) - 0.5 * math.log(determinant)


@njit(cache=True)
def advance(
    bank: Bank,
    count: int,
    dt: float,
    path: float,
    turn: float,
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> None:
    """Move every hypothesis."""
    for h in range(count):
        move(bank[0][h], bank[1][h], dt, path, turn, p, weights, scratch)


@njit(cache=True)
def take(
    bank: Bank,
    spare: Bank,
    places: np.ndarray,
    seen: np.ndarray,
    count: int,
    rate: float,
    clock: float,
    depth: float,
    p: np.ndarray,
    weights: Weights,
    scratch: tuple[np.ndarray, ...],
) -> int:
    """Learn from the sightings of one instant, none of which tells whose it is.

    Every hypothesis branches into every landmark inside the gate that it has not yet seen at this instant,
    and into "nothing"; the heaviest branches go on.

    Args:
        bank, spare: The bank, changed, and another of the same shape, overwritten.
        places: (l, 2), at most 62.
        seen: (k, 2) depth and bearing.
        count: Hypotheses in use.
        rate, clock: Turn, rad/s; time, s.
        depth: Branches lighter than the heaviest by more than this, in log weight, are dropped.

    Returns:
        How many are in use now.
    """
    capacity, marks = bank[0].shape[0], places.shape[0]
    branches = capacity * (marks + 1)
    weight, parent, mark = (
        np.empty(branches),
        np.empty(branches, np.int64),
        np.empty(branches, np.int64),
    )
    taken, taken_spare = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    sigmas = np.empty(2)
    nothing = math.log(p[OUTLIER] * p[OUTLIER_DENSITY])
    something = math.log((1.0 - p[OUTLIER]) / marks)
    for row in range(seen.shape[0]):
        if not (math.isfinite(seen[row, 0]) and math.isfinite(seen[row, 1])):
            continue
        sigmas[0], sigmas[1] = deviations(seen[row, 0], rate, p)
        found = 0
        for h in range(count):
            weight[found], parent[found], mark[found] = bank[2][h] + nothing, h, -1
            found += 1
            for m in range(marks):
                if taken[h] >> m & 1:
                    continue
                slot = slot_of(m, bank[3][h], bank[4][h])
                held = slot >= 0 and bank[3][h, slot] == m
                squared, density = linear_density(
                    bank[0][h], bank[1][h], places[m], SIZE + 2 * slot if held else -1,
                    seen[row], sigmas, p,
                )  # fmt: skip
                if squared <= 1.5 * p[GATE]:
                    weight[found] = bank[2][h] + something + density
                    parent[found], mark[found] = h, m
                    found += 1
        order = np.argsort(-weight[:found])
        best, kept = weight[order[0]], 0
        for k in order[: min(found, capacity)]:
            if weight[k] < best - depth:
                break
            h, m = parent[k], mark[k]
            copy(bank, h, spare, kept)
            taken_spare[kept] = taken[h]
            if m < 0:
                spare[2][kept] += nothing
                spare[5][kept] += 1
                if spare[5][kept] >= p[DOUBT_AFTER]:
                    widen(spare[0][kept], spare[1][kept], 1.0, p, weights, scratch)
                    spare[5][kept] = 0
            else:
                entry = occupy(
                    spare[0][kept], spare[1][kept], slot_of(m, spare[3][kept], spare[4][kept]), m,
                    clock, spare[3][kept], spare[4][kept], p, scratch[2],
                )  # fmt: skip
                status, density = look(
                    spare[0][kept], spare[1][kept], places[m], entry, seen[row], rate, 2.0 * p[GATE],
                    p, weights, scratch,
                )  # fmt: skip
                spare[2][kept] += something + density if status == 1 else nothing
                spare[5][kept] = 0
                taken_spare[kept] |= 1 << m
            kept += 1
        count = kept
        for h in range(count):
            copy(spare, h, bank, h)
            taken[h] = taken_spare[h]
    return tidy(bank, spare, count)


@njit(cache=True)
def copy(source: Bank, h: int, target: Bank, to: int) -> None:
    """Copy one hypothesis."""
    target[0][to] = source[0][h]
    target[1][to] = source[1][h]
    target[2][to] = source[2][h]
    target[3][to] = source[3][h]
    target[4][to] = source[4][h]
    target[5][to] = source[5][h]


@njit(cache=True)
def tidy(bank: Bank, spare: Bank, count: int) -> int:
    """Sort by weight, let what has come to the same pose be one, and make the weights sum to one."""
    order = np.argsort(-bank[2][:count])
    kept, difference = 0, np.empty(3)
    for k in order:
        same = -1
        for other in range(kept):
            for j in range(3):
                difference[j] = bank[0][k, j] - spare[0][other, j]
            difference[YAW] = wrapped(difference[YAW])
            squared = 0.0
            for j in range(3):
                for i in range(j):
                    difference[j] -= spare[1][other, j, i] * difference[i]
                difference[j] /= spare[1][other, j, j]
                squared += difference[j] * difference[j]
            if squared < 0.1:
                same = other
                break
        if same >= 0:
            high = max(spare[2][same], bank[2][k])
            spare[2][same] = high + math.log(
                math.exp(spare[2][same] - high) + math.exp(bank[2][k] - high)
            )
        else:
            copy(bank, k, spare, kept)
            kept += 1
    high, total = spare[2][0], 0.0
    for h in range(kept):
        high = max(high, spare[2][h])
    for h in range(kept):
        total += math.exp(spare[2][h] - high)
    for h in range(kept):
        spare[2][h] -= high + math.log(total)
        copy(spare, h, bank, h)
    return kept


@njit(cache=True)
def mixture(bank: Bank, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of (x, y, yaw) over all hypotheses by their weights."""
    mean, covariance, own = np.zeros(3), np.zeros((3, 3)), np.empty((3, 3))
    sine = cosine = 0.0
    for h in range(count):
        share = math.exp(bank[2][h])
        mean[X] += share * bank[0][h, X]
        mean[Y] += share * bank[0][h, Y]
        sine += share * math.sin(bank[0][h, YAW])
        cosine += share * math.cos(bank[0][h, YAW])
    mean[YAW] = math.atan2(sine, cosine)
    away = np.empty(3)
    for h in range(count):
        share = math.exp(bank[2][h])
        pose_covariance(bank[1][h], own)
        for j in range(3):
            away[j] = bank[0][h, j] - mean[j]
        away[YAW] = wrapped(away[YAW])
        for i in range(3):
            for j in range(3):
                covariance[i, j] += share * (own[i, j] + away[i] * away[j])
    return mean, covariance
