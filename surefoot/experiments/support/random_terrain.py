"""Random occupancy grids for path search: floor cells, furniture and unknown regions.

The experiments on paths and the benchmark of the search share them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

CELL_M = 0.05
FURNITURE_PER_CELL = 1 / 250  # about 20 objects in seed 003's 3.5 m square
PROBABILITY_FLOOR = (0.02, 0.15)  # observed often, observed once
PROBABILITY_SOLID = (0.7, 0.98)


class Grid(NamedTuple):
    """A grid with start and goal, as the search takes them.

    Args:
        probability: Occupancy probability of every cell.
        unknown: Cells that were never observed.
        start, goal: World frame, m; the map's lower left corner is the origin.
    """

    probability: Float[np.ndarray, "rows columns"]
    unknown: Bool[np.ndarray, "rows columns"]
    start: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]


def make(side: int, rng: np.random.Generator) -> Grid:
    """A square grid with furniture and up to two unknown squares; start and goal in opposite corners.

    Args:
        side: Cells along a side, at least 30.
        rng: Determines the terrain.
    """
    low, high = PROBABILITY_FLOOR
    probability = np.where(rng.random((side, side)) < 0.2, high, low)
    for _ in range(round(side * side * FURNITURE_PER_CELL)):
        row, column = rng.integers(0, side, 2)
        depth, width = rng.integers(1, 5, 2)
        probability[row : row + depth, column : column + width] = rng.uniform(*PROBABILITY_SOLID)
    unknown = np.zeros((side, side), np.bool_)
    for _ in range(rng.integers(0, 3)):
        row, column = rng.integers(0, side, 2)
        unknown[row : row + side // 3, column : column + side // 3] = True
    probability[unknown] = 1.0  # as seed 003 stores unknown cells
    corner = np.array([side // 12, side // 12])
    ends = np.stack([corner, side - 1 - corner]) + rng.integers(-side // 15, side // 15 + 1, (2, 2))
    ends = np.clip(ends, 0, side - 1)
    if rng.random() < 0.5:
        ends[:, 1] = side - 1 - ends[:, 1]
    start, goal = (ends[:, ::-1] + 0.5) * CELL_M
    for end in ends:  # start and goal are free
        near = np.hypot(*(np.indices((side, side)) - end[:, None, None])) <= 5
        probability[near & ~unknown] = low
    return Grid(probability, unknown, start, goal)
