"""A saved occupancy grid against the true one, over the cells that the robot has seen.

Two figures, because a cell on the rim of an obstacle can be called either way: the strict one asks for
the state of the true map at the very centre of the cell; the other accepts a cell whose state is found
anywhere in the three by three neighbourhood, and so forgives an error of one cell and no more.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int

from mapping.io import nav2

UNKNOWN, FREE, OCCUPIED = -1, 0, 1


@dataclass(frozen=True)
class GridMap:
    """A map of three states; cell [0, 0] has its lower left corner at the origin, rows go along +y.

    Args:
        state: UNKNOWN, FREE or OCCUPIED.
        origin: (x, y) of the lower left corner, m.
        cell_m: Side of a cell.
    """

    state: Int[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(left, right, bottom, top), m."""
        rows, columns = self.state.shape
        left, bottom = (float(v) for v in self.origin)
        return left, left + columns * self.cell_m, bottom, bottom + rows * self.cell_m

    def centres(self) -> Float[np.ndarray, "rows columns 2"]:
        """Of every cell, m."""
        rows, columns = self.state.shape
        x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        return np.stack([x, y], axis=-1) * self.cell_m + self.origin

    def at(self, points: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n"]:
        """State of the cell under each point; UNKNOWN outside."""
        # A centre that falls on the edge of two cells must fall the same way in every row.
        cells = np.floor((points - self.origin) / self.cell_m + 1e-6).astype(np.int64)
        column, row = cells[..., 0], cells[..., 1]
        rows, columns = self.state.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = self.state[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return np.where(inside, found, UNKNOWN)


def read_map(path: Path) -> GridMap:
    """A saved map (Nav2 / map_server pair) by its .yaml file.

    Raises:
        InputError: A file is missing, truncated or not of this format.
    """
    saved = nav2.load(path)
    state = np.where(saved.probability > 0.5, OCCUPIED, FREE)
    return GridMap(np.where(saved.known, state, UNKNOWN), saved.origin, saved.cell_m)


def map_metrics(mine: GridMap, truth: GridMap) -> dict[str, float]:
    """Figures over the cells known in both maps; empty if there are none.

    Returns:
        grid_cells (how many were judged), grid_correct_share (strict), grid_correct_share_one_cell
        (right within the neighbours), grid_occupied_correct_share and grid_free_correct_share (of the
        cells that say so, strict), grid_occupied_found_share (of the true obstacles' cells that were
        judged, how many we call occupied, or have such a neighbour).
    """
    centres = mine.centres()
    true = truth.at(centres)
    judged = (mine.state != UNKNOWN) & (true != UNKNOWN)
    if not judged.any():
        return {}
    right = judged & (mine.state == true)
    near = judged & (right | _neighbour_says(mine, truth))
    ours, theirs = judged & (mine.state == OCCUPIED), judged & (true == OCCUPIED)
    figures = {
        "grid_cells": float(np.count_nonzero(judged)),
        "grid_correct_share": float(right.sum() / judged.sum()),
        "grid_correct_share_one_cell": float(near.sum() / judged.sum()),
    }
    free = judged & (mine.state == FREE)
    if ours.any():
        figures["grid_occupied_correct_share"] = float((right & ours).sum() / ours.sum())
    if free.any():
        figures["grid_free_correct_share"] = float((right & free).sum() / free.sum())
    if theirs.any():
        grown = cv2.dilate(ours.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        figures["grid_occupied_found_share"] = float((theirs & grown).sum() / theirs.sum())
    return figures


def wrong_cells(mine: GridMap, truth: GridMap) -> Int[np.ndarray, "rows columns"]:
    """0 right or not judged, 1 wrong by one cell at most, 2 wrong."""
    true = truth.at(mine.centres())
    wrong = (mine.state != UNKNOWN) & (true != UNKNOWN) & (mine.state != true)
    return np.where(wrong, np.where(_neighbour_says(mine, truth), 1, 2), 0)


def _neighbour_says(mine: GridMap, truth: GridMap) -> np.ndarray:
    """Whether the truth has our cell's state within one of our cells around it."""
    centres = mine.centres()
    agrees = np.zeros(mine.state.shape, dtype=bool)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            agrees |= truth.at(centres + np.array([dx, dy]) * mine.cell_m) == mine.state
    return agrees
