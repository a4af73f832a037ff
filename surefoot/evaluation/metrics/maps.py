"""Occupancy grid of a run against the true grid, over the observed cells.

There are two figures, because the state of a cell at the edge of an obstacle is ambiguous: the strict one
compares with the true state at the centre of the cell; the lenient one accepts a state that occurs anywhere in
the 3x3 neighbourhood, and so tolerates an error of one cell.
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
    """A map of three states; the lower left corner of cell [0, 0] is the origin, row indices grow along +y.

    Args:
        state: UNKNOWN, FREE or OCCUPIED.
        origin: (x, y) of the lower left corner, m.
        cell_m: Side length of a cell.
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
        """Centres of all cells, m."""
        rows, columns = self.state.shape
        x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        return np.stack([x, y], axis=-1) * self.cell_m + self.origin

    def at(self, points: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n"]:
        """State of the cell under each point; UNKNOWN outside."""
        # The offset makes a point on the edge between two cells fall into the same one in every row.
        cells = np.floor((points - self.origin) / self.cell_m + 1e-6).astype(np.int64)
        column, row = cells[..., 0], cells[..., 1]
        rows, columns = self.state.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        found = self.state[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return np.where(inside, found, UNKNOWN)


def read_map(path: Path) -> GridMap:
    """Read a saved map (Nav2 / map_server pair) by its .yaml file.

    Raises:
        InputError: A file is missing, truncated or of another format.
    """
    saved = nav2.load(path)
    state = np.where(saved.probability > 0.5, OCCUPIED, FREE)
    return GridMap(np.where(saved.known, state, UNKNOWN), saved.origin, saved.cell_m)


def map_metrics(mine: GridMap, truth: GridMap) -> dict[str, float]:
    """Figures over the cells known in both maps; empty if there are none.

    Returns:
        grid_cells (cells known in both), grid_correct_share (strict), grid_correct_share_one_cell (lenient),
        grid_occupied_correct_share and grid_free_correct_share (precision of each state, strict),
        grid_occupied_found_share (recall of truly occupied cells, lenient).
    """
    centres = mine.centres()
    true = truth.at(centres)
    judged = (mine.state != UNKNOWN) & (true != UNKNOWN)
    if not judged.any():
        return {}
    right = judged & (mine.state == true)
    near = judged & (right | _agrees_nearby(mine, truth))
    occupied, truly = judged & (mine.state == OCCUPIED), judged & (true == OCCUPIED)
    figures = {
        "grid_cells": float(np.count_nonzero(judged)),
        "grid_correct_share": float(right.sum() / judged.sum()),
        "grid_correct_share_one_cell": float(near.sum() / judged.sum()),
    }
    free = judged & (mine.state == FREE)
    if occupied.any():
        figures["grid_occupied_correct_share"] = float((right & occupied).sum() / occupied.sum())
    if free.any():
        figures["grid_free_correct_share"] = float((right & free).sum() / free.sum())
    if truly.any():
        grown = cv2.dilate(occupied.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        figures["grid_occupied_found_share"] = float((truly & grown).sum() / truly.sum())
    return figures


def wrong_cells(mine: GridMap, truth: GridMap) -> Int[np.ndarray, "rows columns"]:
    """0: correct or unknown; 1: wrong, but correct within one cell; 2: wrong."""
    true = truth.at(mine.centres())
    wrong = (mine.state != UNKNOWN) & (true != UNKNOWN) & (mine.state != true)
    return np.where(wrong, np.where(_agrees_nearby(mine, truth), 1, 2), 0)


def _agrees_nearby(mine: GridMap, truth: GridMap) -> np.ndarray:
    """Whether the true state agrees with ours anywhere in the 3x3 neighbourhood of a cell."""
    centres = mine.centres()
    agrees = np.zeros(mine.state.shape, dtype=bool)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            agrees |= truth.at(centres + np.array([dx, dy]) * mine.cell_m) == mine.state
    return agrees
