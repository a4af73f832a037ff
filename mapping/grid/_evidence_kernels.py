"""Compiled inner loops of mapping: points into cells, evidence into log-odds, points into voxels.

Arrays and scalars only; the functions that check and shape are in the modules of the same ideas, the
NumPy twins in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BLOCK = 2048  # points indexed at a time: the buffer stays in the first-level cache
FLOOR, STILL, MOVING = 0, 1, 2  # kinds of points, in the order of `counts`


@njit(cache=True)
def count_points(
    points: np.ndarray,
    kinds: np.ndarray,
    anchor: np.ndarray,
    per_m: float,
    first: np.ndarray,
    rows: int,
    columns: int,
    tally: np.ndarray,
) -> None:
    """Count the points of each kind in each cell of a window of an endless lattice.

    Cell (0, 0) of the lattice has its lower left corner at the anchor; the window starts at the given
    cell. A point's cell depends on the anchor alone, so it is the same wherever the window is. Points
    outside, and NaN, go to a place of their own. The indices come first, in a loop that vectorises, the
    scattered additions second, in one without branches: four times faster than one loop that does both.

    Args:
        points: (n, 2), m.
        kinds: (n,) uint8, FLOOR, STILL or MOVING.
        anchor: (2,), m.
        per_m: Cells in a metre.
        first: (2,), lattice cell (x, y) of the window's corner.
        tally: (3 * rows * columns + 1,) int32, overwritten: kinds, rows, columns, then those outside.
    """
    ax, ay, fx, fy = anchor[0], anchor[1], first[0], first[1]
    cells = rows * columns
    outside = 3 * cells
    tally[:] = 0
    block = np.empty(BLOCK, np.int32)
    n = points.shape[0]
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        for i in range(size):
            x = np.floor((points[start + i, 0] - ax) * per_m) - fx
            y = np.floor((points[start + i, 1] - ay) * per_m) - fy
            inside = (x >= 0.0) & (x < columns) & (y >= 0.0) & (y < rows)
            cell = np.int32(kinds[start + i]) * cells + np.int32(y) * columns + np.int32(x)
            block[i] = cell if inside else outside
        for i in range(size):
            tally[block[i]] += 1


@njit(cache=True)
def lattice_bounds(points: np.ndarray, per_m: float) -> tuple[float, float, float, float]:
    """Lattice cells that hold the points: (lowest x, lowest y, highest x, highest y); NaN is passed over."""
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if x - x == 0.0 and y - y == 0.0:  # both finite
            low_x, high_x = min(low_x, x), max(high_x, x)
            low_y, high_y = min(low_y, y), max(high_y, y)
    return (
        np.floor(low_x * per_m),
        np.floor(low_y * per_m),
        np.floor(high_x * per_m),
        np.floor(high_y * per_m),
    )


@njit(cache=True)
def _most_beside(counts: np.ndarray, row: int, column: int) -> int:
    """The greatest count of a cell and its eight neighbours."""
    most = 0
    for r in range(max(row - 1, 0), min(row + 2, counts.shape[0])):
        for c in range(max(column - 1, 0), min(column + 2, counts.shape[1])):
            most = max(most, counts[r, c])
    return most


@njit(cache=True)
def fold_evidence(
    counts: np.ndarray,
    log_odds: np.ndarray,
    updated_s: np.ndarray,
    moving: np.ndarray,
    corner_row: int,
    corner_column: int,
    stamp_s: float,
    obstacle_points: int,
    first_obstacle: float,
    first_floor: float,
    obstacle: float,
    floor: float,
    limit: float,
    mover_odds: float,
    tail_share: float,
) -> None:
    """Change each cell at most once by what the counts say of it.

    The map is a torus: window cell [0, 0] is its cell [corner_row, corner_column], and indices wrap.

    Args:
        counts: (3, rows, columns) int32 of the window.
        log_odds: (map rows, map columns) float32, +inf where a cell was never seen; changed.
        updated_s: Same shape, float64; changed.
        moving: Same shape, bool: the obstacle here belongs to something that moves; changed.
    """
    map_rows, map_columns = log_odds.shape
    for row in range(counts.shape[1]):
        r = (corner_row + row) % map_rows
        for column in range(counts.shape[2]):
            still, mover = counts[1, row, column], counts[2, row, column]
            if still + mover < obstacle_points and counts[0, row, column] == 0:
                continue
            c = (corner_column + column) % map_columns
            old = log_odds[r, c]
            if still >= obstacle_points:
                if still < tail_share * _most_beside(counts[1], row, column):
                    continue  # as many of the neighbour's points come here by noise
                new = first_obstacle if np.isinf(old) else min(old + obstacle, limit)
                moving[r, c] = False
            elif still + mover >= obstacle_points:
                new = mover_odds  # it is here now; what was here before says nothing
                moving[r, c] = True
            else:
                new = first_floor if np.isinf(old) else max(old + floor, -limit)
                if new < 0.0:
                    moving[r, c] = False
            log_odds[r, c] = new
            updated_s[r, c] = stamp_s


@njit(cache=True)
def highest_in_cells(
    points: np.ndarray,
    heights: np.ndarray,
    kinds: np.ndarray,
    anchor: np.ndarray,
    per_m: float,
    first: np.ndarray,
    top: np.ndarray,
) -> None:
    """Raise each cell of the window to the highest obstacle point in it; top is (rows, columns) float32."""
    ax, ay, fx, fy = anchor[0], anchor[1], first[0], first[1]
    rows, columns = top.shape
    for i in range(points.shape[0]):
        if kinds[i] != STILL or np.isnan(heights[i]):
            continue
        x = np.floor((points[i, 0] - ax) * per_m) - fx
        y = np.floor((points[i, 1] - ay) * per_m) - fy
        if x >= 0.0 and x < columns and y >= 0.0 and y < rows:
            r, c = int(y), int(x)
            if not top[r, c] >= heights[i]:  # also true where top is NaN
                top[r, c] = heights[i]


@njit(cache=True)
def _slot_of(key: np.int64, table: np.ndarray, keys: np.ndarray) -> np.int64:
    """Slot of the hash table that holds the key's voxel, or the free one where it belongs."""
    mask = table.shape[0] - 1
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)  # Fibonacci hashing
    slot = np.int64(h >> np.uint64(20)) & mask
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
        points: (n, 3), m; NaN is passed over, and what lies a million voxels from the origin.
        colours: (n, 3) uint8, or (0, 3) where there are none.
        per_m: Voxels in a metre.
        call: Number of this addition, to count in how many of them a voxel was hit.
        start: First point to add.
        used: Voxels in use.
        keys, sums, counts, calls, last: (capacity,) int64; (capacity, 6) float64 of x, y, z, red, green,
            blue; (capacity,) int64 of points, and of additions; (capacity,) int64 the last addition.
        table: Hash table of voxel numbers, -1 where free.

    Returns:
        (next point, voxels in use); next point is n when all are in.
    """
    capacity = keys.shape[0]
    far = 1 << 20
    coloured = colours.shape[0] > 0
    for i in range(start, points.shape[0]):
        x = np.floor(points[i, 0] * per_m)
        y = np.floor(points[i, 1] * per_m)
        z = np.floor(points[i, 2] * per_m)
        if not (abs(x) < far and abs(y) < far and abs(z) < far):
            continue
        key = np.int64(
            ((np.int64(x) + far) << 42) | ((np.int64(y) + far) << 21) | (np.int64(z) + far)
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
        counts[voxel] += 1
        if last[voxel] != call:
            last[voxel] = call
            calls[voxel] += 1
    return points.shape[0], used
