"""Compiled loops over the cells in which something may hang; see `hanging`, a NumPy version is in the tests."""

from __future__ import annotations

import numpy as np

from perception.primitives.compiled import njit

from ._terrain_kernels import RAY, Placement


@njit(cache=True)
def questions(
    counts: np.ndarray,
    sums: np.ndarray,
    hanging: np.ndarray,
    heights: np.ndarray,
    place: Placement,
    least: int,
    lowest_m: float,
    below_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The places through which a frame may see: below obstacles well above the floor, and at the height of what hangs.

    Args:
        counts: (3, rows, columns) int32 of the window.
        sums: (3 rows columns + 1, 3), of `gather`.
        hanging: (map rows, map columns) bool, torus as for `fold_evidence`; changed: what reaches down stands.
        heights: Same shape, m.
        place: The window.
        least: Obstacle points of a cell.
        lowest_m: Points down to this height are of what stands.
        below_m: How far below the lowest points of an obstacle one of its two places lies; the other is half as high.

    Returns:
        Row and column in the window and whether the cell is a new one, (n, 3); row and column in the map, (n, 2); and
        the places, (n, 3), m.
    """
    rows, columns = counts.shape[1], counts.shape[2]
    cells = np.empty((2 * rows * columns, 3), np.int64)
    there = np.empty((2 * rows * columns, 2), np.int64)
    places = np.empty((2 * rows * columns, 3))
    n = 0
    for row in range(rows):
        r = (place.row + row) % hanging.shape[0]
        for column in range(columns):
            c = (place.column + column) % hanging.shape[1]
            static, mobile = counts[1, row, column], counts[2, row, column]
            known = hanging[r, c]
            upper = lower = float(heights[r, c])
            if static >= least:
                entry = rows * columns + row * columns + column
                mean = sums[entry, 0] / static
                spread = max(0.0, sums[entry, 1] / static - mean * mean)
                lowest = mean - 2.0 * np.sqrt(spread)
                if lowest <= lowest_m:
                    hanging[r, c] = False
                if known or lowest <= lowest_m:
                    continue
                upper, lower = lowest - below_m, 0.5 * lowest
            elif not known or static + mobile >= least:
                continue
            for question in range(2 if static >= least else 1):
                cells[n, 0], cells[n, 1], cells[n, 2] = row, column, static >= least
                there[n, 0], there[n, 1] = r, c
                places[n, 0] = place.x_m + (column + 0.5) * place.cell_m
                places[n, 1] = place.y_m + (row + 0.5) * place.cell_m
                places[n, 2] = lower if question else upper
                n += 1
    return cells[:n], there[:n], places[:n]


@njit(cache=True)
def answer(
    counts: np.ndarray,
    sums: np.ndarray,
    hanging: np.ndarray,
    log_odds: np.ndarray,
    cells: np.ndarray,
    there: np.ndarray,
    through: np.ndarray,
) -> np.ndarray:
    """Note what hangs, and drop the floor below it where the frame does not see through its height.

    Args:
        counts: Of `questions`; changed: no floor, or at least a ray, in hanging cells without an obstacle.
        sums: Likewise; changed: without that floor.
        hanging: Likewise; changed.
        log_odds: Same shape, of occupancy; one look at what hangs in a free or unseen cell may be a flying pixel.
        cells, there: Of `questions`.
        through: (n,) bool, whether the frame sees through each place.

    Returns:
        (n,) bool, the places that show that something hangs in their cell.
    """
    fresh = np.zeros(len(cells), np.bool_)
    for k in range(len(cells)):
        row, column = cells[k, 0], cells[k, 1]
        if cells[k, 2] == 1:
            fresh[k] = through[k]
            if through[k] and 0.0 < log_odds[there[k, 0], there[k, 1]] < np.inf:
                hanging[there[k, 0], there[k, 1]] = True
        elif not through[k]:
            counts[0, row, column] = 0
            sums[row * counts.shape[2] + column] = 0.0
        elif counts[0, row, column] == 0:
            counts[0, row, column] = RAY
    return fresh
