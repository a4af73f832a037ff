"""Compiled inner loops of the hypothesis bank: branch, weigh, prune, merge."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..filtering._square_root_kernels import wrapped
from ..primitives.compiled import njit
from ._planar_kernels import (
    BEARING,
    DEPTH,
    GAIN,
    OFFSET,
    SIZE,
    YAW,
    Scratch,
    Weights,
    X,
    Y,
    correct,
    deviations,
    expected,
    inflate,
    move,
    occupy,
    pose_covariance,
    slot_of,
)
from .config import Parameters


class Bank(NamedTuple):
    """Hypotheses along the first axis, heaviest first.

    Args:
        means, roots: State and lower Cholesky root of its covariance.
        log_weights: Logarithms of the weights.
        held, used: Landmark in each displacement slot, and when it was last seen, s.
        unmatched: Number of sightings in a row that matched no landmark.
    """

    means: np.ndarray
    roots: np.ndarray
    log_weights: np.ndarray
    held: np.ndarray
    used: np.ndarray
    unmatched: np.ndarray


@njit(cache=True)
def linear_density(
    mean: np.ndarray,
    root: np.ndarray,
    place: np.ndarray,
    entry: int,
    measured: np.ndarray,
    rate: float,
    p: Parameters,
) -> tuple[float, float]:
    """Normalised innovation squared and log density of a sighting, by linearisation at the mean."""
    size = mean.shape[0]
    depth, bearing = expected(mean, place, entry, 0.0, p)
    sigma_depth, sigma_bearing = deviations(depth, rate, p)
    depth += sigma_depth * mean[DEPTH]
    first, second = measured[0] - depth, wrapped(measured[1] - bearing)
    x, y = place[0] - mean[X], place[1] - mean[Y]
    if entry >= 0:
        x, y = x + mean[entry], y + mean[entry + 1]
    c, s = math.cos(mean[YAW]), math.sin(mean[YAW])
    left, square = c * y - s * x, max(x * x + y * y, 1e-4)
    aa, ab, bb = sigma_depth**2, 0.0, sigma_bearing**2
    for j in range(size):
        dx, dy = -root[X, j], -root[Y, j]
        if entry >= 0:
            dx, dy = dx + root[entry, j], dy + root[entry + 1, j]
        a = (p.scale + mean[GAIN]) * (c * dx + s * dy + left * root[YAW, j]) + root[OFFSET, j]
        a += (c * x + s * y) * root[GAIN, j] + sigma_depth * root[DEPTH, j]
        b = (x * dy - y * dx) / square - root[YAW, j] + root[BEARING, j]
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    if entry < 0:
        aa, bb = aa + p.place**2, bb + p.place**2 / square
    determinant = aa * bb - ab * ab
    squared = (bb * first * first - 2.0 * ab * first * second + aa * second * second) / determinant
    return squared, -0.5 * squared - math.log(2.0 * math.pi) - 0.5 * math.log(determinant)


@njit(cache=True)
def predict(
    bank: Bank,
    count: int,
    dt: float,
    path: float,
    turn: float,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> None:
    """Predict every hypothesis."""
    for h in range(count):
        move(bank.means[h], bank.roots[h], dt, path, turn, p, weights, scratch)


@njit(cache=True)
def branch(
    bank: Bank,
    places: np.ndarray,
    seen: np.ndarray,
    count: int,
    rate: float,
    taken: np.ndarray,
    p: Parameters,
    weight: np.ndarray,
    parent: np.ndarray,
    mark: np.ndarray,
) -> int:
    """Branches of all hypotheses for one sighting: log weight, hypothesis and landmark, -1 for clutter.

    Args:
        taken: (h,) bits of the landmarks that each hypothesis has seen at this instant.
        weight, parent, mark: Receive the branches.

    Returns:
        Number of branches.
    """
    marks = places.shape[0]
    clutter = math.log(p.outlier * p.outlier_density)
    landmark = math.log((1.0 - p.outlier) / marks)
    found = 0
    for h in range(count):
        weight[found], parent[found], mark[found] = bank.log_weights[h] + clutter, h, -1
        found += 1
        for m in range(marks):
            if taken[h] >> m & 1:
                continue
            slot = slot_of(m, bank.held[h], bank.used[h])
            held = slot >= 0 and bank.held[h, slot] == m
            squared, density = linear_density(
                bank.means[h], bank.roots[h], places[m], SIZE + 2 * slot if held else -1,
                seen, rate, p,
            )  # fmt: skip
            if squared <= 1.5 * p.gate:
                weight[found] = bank.log_weights[h] + landmark + density
                parent[found], mark[found] = h, m
                found += 1
    return found


@njit(cache=True)
def update(
    bank: Bank,
    spare: Bank,
    places: np.ndarray,
    seen: np.ndarray,
    count: int,
    rate: float,
    time_s: float,
    depth: float,
    p: Parameters,
    weights: Weights,
    scratch: Scratch,
) -> int:
    """Update with the sightings of one instant without identities.

    Every hypothesis branches into every landmark inside the gate that it has not yet seen at this instant, and
    into clutter; the heaviest branches are kept.

    Args:
        bank, spare: The bank, changed, and another of the same shape, overwritten.
        places: (l, 2), at most 62.
        seen: (k, 2) depth and bearing.
        count: Number of hypotheses.
        rate, time_s: Turn, rad/s; time, s.
        depth: Branches lighter than the heaviest by more than this, in log weight, are pruned.

    Returns:
        Number of hypotheses afterwards.
    """
    capacity, marks = bank.means.shape[0], places.shape[0]
    branches = capacity * (marks + 1)
    weight = np.empty(branches)
    parent, mark = np.empty(branches, np.int64), np.empty(branches, np.int64)
    taken, taken_spare = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    clutter = math.log(p.outlier * p.outlier_density)
    landmark = math.log((1.0 - p.outlier) / marks)
    for row in range(seen.shape[0]):
        if not (math.isfinite(seen[row, 0]) and math.isfinite(seen[row, 1])):
            continue
        found = branch(bank, places, seen[row], count, rate, taken, p, weight, parent, mark)
        order = np.argsort(-weight[:found])
        best, kept = weight[order[0]], 0
        for k in order[: min(found, capacity)]:
            if weight[k] < best - depth:
                break
            h, m = parent[k], mark[k]
            copy(bank, h, spare, kept)
            taken_spare[kept] = taken[h]
            if m < 0:
                spare.log_weights[kept] += clutter
                spare.unmatched[kept] += 1
                if spare.unmatched[kept] >= p.recover_after:
                    inflate(spare.means[kept], spare.roots[kept], 1.0, p, weights, scratch)
                    spare.unmatched[kept] = 0
            else:
                entry = occupy(
                    spare.means[kept], spare.roots[kept],
                    slot_of(m, spare.held[kept], spare.used[kept]), m,
                    time_s, spare.held[kept], spare.used[kept], p, scratch.wide,
                )  # fmt: skip
                status, density = correct(
                    spare.means[kept], spare.roots[kept], places[m], entry, seen[row], rate,
                    2.0 * p.gate, p, weights, scratch,
                )  # fmt: skip
                spare.log_weights[kept] += landmark + density if status == 1 else clutter
                spare.unmatched[kept] = 0
                taken_spare[kept] |= 1 << m
            kept += 1
        count = kept
        for h in range(count):
            copy(spare, h, bank, h)
            taken[h] = taken_spare[h]
    return merge(bank, spare, count)


@njit(cache=True)
def copy(source: Bank, h: int, target: Bank, to: int) -> None:
    """Copy one hypothesis."""
    target.means[to] = source.means[h]
    target.roots[to] = source.roots[h]
    target.log_weights[to] = source.log_weights[h]
    target.held[to] = source.held[h]
    target.used[to] = source.used[h]
    target.unmatched[to] = source.unmatched[h]


@njit(cache=True)
def merge(bank: Bank, spare: Bank, count: int) -> int:
    """Sort by weight, merge hypotheses at the same pose, and normalise the weights."""
    order = np.argsort(-bank.log_weights[:count])
    kept, difference = 0, np.empty(3)
    for k in order:
        same = -1
        for other in range(kept):
            for j in range(3):
                difference[j] = bank.means[k, j] - spare.means[other, j]
            difference[YAW] = wrapped(difference[YAW])
            squared = 0.0
            for j in range(3):
                for i in range(j):
                    difference[j] -= spare.roots[other, j, i] * difference[i]
                difference[j] /= spare.roots[other, j, j]
                squared += difference[j] * difference[j]
            if squared < 0.1:
                same = other
                break
        if same >= 0:
            high = max(spare.log_weights[same], bank.log_weights[k])
            spare.log_weights[same] = high + math.log(
                math.exp(spare.log_weights[same] - high) + math.exp(bank.log_weights[k] - high)
            )
        else:
            copy(bank, k, spare, kept)
            kept += 1
    high, total = spare.log_weights[0], 0.0
    for h in range(kept):
        high = max(high, spare.log_weights[h])
    for h in range(kept):
        total += math.exp(spare.log_weights[h] - high)
    for h in range(kept):
        spare.log_weights[h] -= high + math.log(total)
        copy(spare, h, bank, h)
    return kept


@njit(cache=True)
def mixture(bank: Bank, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of (x, y, yaw) of the mixture."""
    mean, covariance, own = np.zeros(3), np.zeros((3, 3)), np.empty((3, 3))
    sine = cosine = 0.0
    for h in range(count):
        share = math.exp(bank.log_weights[h])
        mean[X] += share * bank.means[h, X]
        mean[Y] += share * bank.means[h, Y]
        sine += share * math.sin(bank.means[h, YAW])
        cosine += share * math.cos(bank.means[h, YAW])
    mean[YAW] = math.atan2(sine, cosine)
    offset = np.empty(3)
    for h in range(count):
        share = math.exp(bank.log_weights[h])
        pose_covariance(bank.roots[h], own)
        for j in range(3):
            offset[j] = bank.means[h, j] - mean[j]
        offset[YAW] = wrapped(offset[YAW])
        for i in range(3):
            for j in range(3):
                covariance[i, j] += share * (own[i, j] + offset[i] * offset[j])
    return mean, covariance
