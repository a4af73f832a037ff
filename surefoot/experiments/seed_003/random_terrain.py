"""Random terrain for the searches: floor seen once or often, furniture, and ground never seen.

Shared by the experiments on paths and the benchmark of the search, so that all judge the same grids.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

CELL_M = 0.05
FURNITURE_PER_CELL = 1 / 250  # things on a cell of floor: about 20 in the seed's 3.5 m square
PROBABILITY_FLOOR = (0.02, 0.15)  # seen often, seen once
PROBABILITY_SOLID = (0.7, 0.98)


class Grid(NamedTuple):
    """A map, and where to go on it; what the search takes.

    Args:
        probability: p of every cell.
        unknown: Cells never seen.
        start, goal: World frame, m; the map's lower left corner is the origin.
    """

    probability: Float[np.ndarray, "rows columns"]
    unknown: Bool[np.ndarray, "rows columns"]
    start: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]


def make(side: int, rng: np.random.Generator) -> Grid:
    """A square of floor with things on it and a shadow or two, to be crossed from corner to corner.

    Args:
        side: Cells along a side, at least 30.
        rng: Same state, same terrain.
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
    probability[unknown] = 1.0  # as the seed keeps it
    corner = np.array([side // 12, side // 12])
    ends = np.stack([corner, side - 1 - corner]) + rng.integers(-side // 15, side // 15 + 1, (2, 2))
    ends = np.clip(ends, 0, side - 1)
    if rng.random() < 0.5:
        ends[:, 1] = side - 1 - ends[:, 1]
    start, goal = (ends[:, ::-1] + 0.5) * CELL_M
    for end in ends:  # nobody is asked to start or end inside a thing
        near = np.hypot(*(np.indices((side, side)) - end[:, None, None])) <= 5
        probability[near & ~unknown] = low
    return Grid(probability, unknown, start, goal)
