"""Compiled inner loops of the potential: every cell's strongest pull, and what lies too near to a solid."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def spread(
    probability: np.ndarray, solid: np.ndarray, weights: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Greatest weighted probability round every cell, and whether a solid cell lies near it.

    Args:
        probability: (rows, columns) float64; cells outside count as 0.
        solid: Same shape, bool.
        weights: (2 reach + 1, 2 reach + 1), pull of the cell at (down, right) from the middle.
        near: Same shape, bool: a solid cell there blocks.
    """
    rows, columns = probability.shape
    reach = weights.shape[0] // 2
    padded = np.zeros((rows + 2 * reach, columns + 2 * reach))
    hard = np.zeros((rows + 2 * reach, columns + 2 * reach), np.bool_)
    padded[reach : reach + rows, reach : reach + columns] = probability
    hard[reach : reach + rows, reach : reach + columns] = solid
    potential = np.zeros((rows, columns))
    blocked = np.zeros((rows, columns), np.bool_)
    for down in range(weights.shape[0]):
        for right in range(weights.shape[1]):
            weight = weights[down, right]
            if weight > 0.0:
                for row in range(rows):
                    target = potential[row]
                    source = padded[row + down, right : right + columns]
                    for column in range(columns):
                        target[column] = max(target[column], weight * source[column])
            if near[down, right]:
                for row in range(rows):
                    flags = blocked[row]
                    marks = hard[row + down, right : right + columns]
                    for column in range(columns):
                        flags[column] |= marks[column]
    return potential, blocked
