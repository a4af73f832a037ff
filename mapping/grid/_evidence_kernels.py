"""Compiled loops of the terrain map: count points per cell, update log-odds; and the bounds of points in cells.

Arguments are checked by the callers; NumPy versions are in the tests.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from perception.primitives.compiled import njit

BLOCK = 2048  # points indexed at a time: the buffer stays in the first-level cache


class Weights(NamedTuple):
    """How one observation changes a cell; log-odds, see `evidence`."""

    obstacle_points: int
    first_obstacle: float
    first_floor: float
    obstacle: float
    floor: float
    limit: float
    moving: float


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

    The index of a point's cell depends on the anchor alone, not on the window. Points outside the window
    and NaN share one extra counter. A first loop over indices vectorises, a second one without branches
    scatters: four times faster than one loop that does both.

    Args:
        points: (n, 2), m.
        kinds: (n,) uint8: 0 floor, 1 static, 2 moving.
        anchor: (2,), lower left corner of lattice cell (0, 0), m.
        per_m: Cells per metre.
        first: (2,), lattice cell (x, y) of the window's corner.
        rows, columns: Size of the window.
        tally: (3 * rows * columns + 1,) int32, overwritten: kinds, rows, columns, then points outside.
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
    """Bounds of the points in cells: (lowest x, lowest y, highest x, highest y); NaN is skipped."""
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
def fold_evidence(
    counts: np.ndarray,
    log_odds: np.ndarray,
    updated_s: np.ndarray,
    moving: np.ndarray,
    corner: tuple[int, int],
    stamp_s: float,
    weights: Weights,
) -> None:
    """Update each cell at most once by its counts.

    The map is a torus: window cell [0, 0] is map cell `corner`, [row, column], and indices wrap.

    Args:
        counts: (3, rows, columns) int32 of the window.
        log_odds: (map rows, map columns) float32, +inf where a cell was never seen; changed.
        updated_s: Same shape, float64; changed.
        moving: Same shape, bool: the obstacle in the cell moves; changed.
        corner: See above.
        stamp_s: Time of the frame, s.
        weights: Weights of an observation.
    """
    w = weights
    map_rows, map_columns = log_odds.shape
    for row in range(counts.shape[1]):
        r = (corner[0] + row) % map_rows
        for column in range(counts.shape[2]):
            static, mobile = counts[1, row, column], counts[2, row, column]
            if static + mobile < w.obstacle_points and counts[0, row, column] == 0:
                continue
            c = (corner[1] + column) % map_columns
            old = log_odds[r, c]
            if static >= w.obstacle_points:
                new = w.first_obstacle if np.isinf(old) else min(old + w.obstacle, w.limit)
                moving[r, c] = False
            elif static + mobile >= w.obstacle_points:
                new = w.moving  # the obstacle has just arrived: earlier evidence does not apply
                moving[r, c] = True
            else:
                new = w.first_floor if np.isinf(old) else max(old + w.floor, -w.limit)
                if new < 0.0:
                    moving[r, c] = False
            log_odds[r, c] = new
            updated_s[r, c] = stamp_s
