"""Compiled voxel hash table of the coloured cloud: points are added to the sums of their voxels."""

from __future__ import annotations

import numpy as np

from perception.primitives.compiled import njit

REACH = 1 << 20  # voxels from the origin along each axis; a key packs three indices of 21 bits


@njit(cache=True)
def _slot_of(key: np.int64, table: np.ndarray, keys: np.ndarray) -> np.int64:
    """Slot of the hash table that holds the key's voxel, or the free slot for it."""
    mask = table.shape[0] - 1
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)  # Fibonacci hashing
    slot = np.int64(h >> np.uint64(40)) & mask  # high bits: only they depend on all three indices
    while table[slot] >= 0 and keys[table[slot]] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True)
def rebuild_table(keys: np.ndarray, used: int, table: np.ndarray) -> None:
    """Fill an empty hash table (all -1, size a power of two) with the first `used` voxels."""
    table[:] = -1
    for voxel in range(used):
        table[_slot_of(keys[voxel], table, keys)] = voxel


@njit(cache=True)
def add_to_voxels(
    points: np.ndarray,
    colours: np.ndarray,
    values: np.ndarray,
    per_m: float,
    call: int,
    start: int,
    used: int,
    keys: np.ndarray,
    table: np.ndarray,
    sums: np.ndarray,
    counts: np.ndarray,
    calls: np.ndarray,
    last: np.ndarray,
) -> tuple[int, int]:
    """Add points to the running sums of their voxels until all are in or the arrays are full.

    Args:
        points: (n, 3), m; NaN and points beyond `REACH` are skipped.
        colours: (n, 3) uint8, or (0, 3) without colours.
        values: (n, k) float64, further numbers to average.
        per_m: Voxels per metre.
        call: Number of this addition (frame), to count the frames in which a voxel was hit.
        start: First point to add.
        used: Voxels in use.
        keys: (capacity,) int64, packed index of each voxel.
        table: Hash table of voxel numbers, -1 where free.
        sums: (capacity, 6 + k) float64 of x, y, z, red, green, blue, and the values.
        counts: (capacity,) int64, points in each voxel.
        calls: (capacity,) int64, frames that hit it.
        last: (capacity,) int64, the last such frame.

    Returns:
        (next point, voxels in use); next point is n when all are in.
    """
    capacity = keys.shape[0]
    coloured = colours.shape[0] > 0
    for i in range(start, points.shape[0]):
        x = np.floor(points[i, 0] * per_m)
        y = np.floor(points[i, 1] * per_m)
        z = np.floor(points[i, 2] * per_m)
        if not (abs(x) < REACH and abs(y) < REACH and abs(z) < REACH):
            continue
        key = np.int64(
            ((np.int64(x) + REACH) << 42) | ((np.int64(y) + REACH) << 21) | (np.int64(z) + REACH)
        )
        slot = _slot_of(key, table, keys)
        voxel = table[slot]
        if voxel < 0:
            if used == capacity:
                return i, used
            voxel = used
            used += 1
            table[slot] = voxel
            keys[voxel] = key
            sums[voxel, :] = 0.0
            counts[voxel] = 0
            calls[voxel] = 0
            last[voxel] = -1
        for axis in range(3):
            sums[voxel, axis] += points[i, axis]
        if coloured:
            for channel in range(3):
                sums[voxel, 3 + channel] += colours[i, channel]
        for channel in range(values.shape[1]):
            sums[voxel, 6 + channel] += values[i, channel]
        counts[voxel] += 1
        if last[voxel] != call:
            last[voxel] = call
            calls[voxel] += 1
    return points.shape[0], used


@njit(cache=True)
def thin(
    voxel_m: float,
    used: int,
    keys: np.ndarray,
    table: np.ndarray,
    sums: np.ndarray,
    counts: np.ndarray,
    calls: np.ndarray,
    last: np.ndarray,
) -> int:
    """Join the voxels whose mean points share a larger voxel, in place and in the order of their first hits.

    A joint voxel is never behind the first of its parts, so nothing is overwritten that is still to be read.

    Args:
        voxel_m: Side of the larger voxels, m.
        used: Voxels in use.
        keys, table, sums, counts, calls, last: As in `add_to_voxels`; changed.

    Returns:
        Voxels in use afterwards.
    """
    table[:] = -1
    joined = 0
    for voxel in range(used):
        key = np.int64(0)
        for axis in range(3):
            cell = np.floor(sums[voxel, axis] / counts[voxel] / voxel_m)
            key = (key << 21) | (np.int64(cell) + REACH)
        slot = _slot_of(key, table, keys)
        into = table[slot]
        if into < 0:
            into = joined
            joined += 1
            table[slot] = into
            keys[into] = key
            if into != voxel:
                sums[into] = sums[voxel]
                counts[into], calls[into], last[into] = counts[voxel], calls[voxel], last[voxel]
            continue
        for column in range(sums.shape[1]):
            sums[into, column] += sums[voxel, column]
        counts[into] += counts[voxel]
        calls[into] = max(calls[into], calls[voxel])
        last[into] = max(last[into], last[voxel])
    return joined
