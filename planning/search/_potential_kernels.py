"""Compiled loops of the potential: the strongest repulsion at every cell, and the blocked cells."""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.compiled import njit


@njit(cache=True)
def spread(
    probability: np.ndarray, solid: np.ndarray, weights: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest weighted probability round every cell, and whether a solid cell blocks it.

    The four quarters round a cell have the same weights: the maximum of two rows is taken first, then that of two columns,
    and only the result is weighted. Rows lie end to end with empty cells between them, so that a shift of the map is a
    shift of the index.

    Args:
        probability: (rows, columns) float64; cells outside count as 0.
        solid: (rows, columns) bool.
        weights: (reach + 1, reach + 1) repulsion of the cell at (down, right) from the middle.
        near: Same shape, bool: whether a solid cell there blocks.
    """
    rows, columns = probability.shape
    reach = weights.shape[0] - 1
    wide = columns + reach
    count = rows * wide
    values = end_to_end(probability, reach)
    solids = end_to_end(solid, reach)
    potential, blocked = np.zeros(count), np.zeros(count, np.bool_)
    greater, either = np.empty(count + 2 * reach), np.empty(count + 2 * reach, np.bool_)
    for down in range(reach + 1):
        above, below = (reach - down) * wide, (reach + down) * wide
        a, b = values[above : above + len(greater)], values[below : below + len(greater)]
        for i in range(len(greater)):
            greater[i] = max(a[i], b[i])
        c, d = solids[above : above + len(greater)], solids[below : below + len(greater)]
        for i in range(len(either)):
            either[i] = c[i] | d[i]
        for right in range(reach + 1):
            west, east, weight = reach - right, reach + right, weights[down, right]
            if weight > 0.0:
                a, b = greater[west : west + count], greater[east : east + count]
                for i in range(count):
                    potential[i] = max(potential[i], weight * max(a[i], b[i]))
            if near[down, right]:
                c, d = either[west : west + count], either[east : east + count]
                for i in range(count):
                    blocked[i] |= c[i] | d[i]
    shape = rows, wide
    return potential.reshape(shape)[:, :columns].copy(), blocked.reshape(shape)[:, :columns].copy()


@njit(cache=True)
def end_to_end(cells: np.ndarray, reach: int) -> np.ndarray:
    """All rows in one array: `reach` empty cells before each row, `reach` empty rows before and two more after."""
    rows, columns = cells.shape
    wide = np.zeros((rows + 2 * reach + 2, columns + reach), cells.dtype)
    wide[reach : reach + rows, reach:] = cells
    return wide.reshape(-1)


@njit(cache=True)
def free_disc(
    probability: np.ndarray, unknown: np.ndarray, x: float, y: float, radius_m: float, cell_m: float
) -> None:
    """Mark unseen cells within a radius of (x, y), in cells, as known and free, in place."""
    rows, columns = probability.shape
    reach = math.ceil(radius_m / cell_m) + 1
    middle_row, middle_column = math.floor(y), math.floor(x)
    for row in range(max(middle_row - reach, 0), min(middle_row + reach + 1, rows)):
        for column in range(max(middle_column - reach, 0), min(middle_column + reach + 1, columns)):
            near = math.hypot(column - x, row - y) * cell_m <= radius_m
            if near and unknown[row, column]:
                probability[row, column] = 0.0
                unknown[row, column] = False
