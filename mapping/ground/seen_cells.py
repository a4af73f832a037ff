"""Cells of a surface that were seen: a small raster that grows, on a lattice of the map frame.

Cells are looked up in the image, not pixels in the raster: so no cell between two pixels is missed far away.

Source: ours.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

CELL_M = 0.02  # ours
MOST = 8  # ours: views that a cell remembers
CLOSED = np.ones((3, 3), np.uint8)


class SeenCells:
    """How often each cell was seen; cell (row, column) covers row, column to row + 1, column + 1 times `CELL_M` (y, x)."""

    def __init__(self) -> None:
        self._first = np.zeros(2, int)  # row and column of the first cell
        self._count = np.zeros((0, 0), np.int8)

    @property
    def is_empty(self) -> bool:
        """Whether no cell is seen."""
        return not bool((self._count > 0).any())

    def places(self) -> Float[np.ndarray, "n 2"]:
        """(x, y) of the middles of all seen cells, m."""
        return self._middles(np.argwhere(self._count > 0))

    def holds(self, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Whether the cells of points are seen."""
        index, inside = self._index(points)
        found = np.zeros(len(points), np.bool_)
        found[inside] = self._count[tuple(index[inside].T)] > 0
        return found

    def away_from(self, point: Float[np.ndarray, "2"]) -> float:
        """Distance of the nearest seen cell from a point, m; infinite if none is seen."""
        places = self.places()
        return math.sqrt(float(((places - point) ** 2).sum(axis=1).min(initial=np.inf)))

    def is_near(self, points: Float[np.ndarray, "n 2"], reach_m: float) -> bool:
        """Whether a seen cell is in the rectangle round points, widened by a reach."""
        low = np.floor((points.min(axis=0) - reach_m) / CELL_M).astype(int)[::-1] - self._first
        high = np.floor((points.max(axis=0) + reach_m) / CELL_M).astype(int)[::-1] - self._first
        (i, j), (m, n) = np.maximum(low, 0), np.maximum(high + 1, 0)
        return bool((self._count[i:m, j:n] > 0).any())

    def meets(self, other: SeenCells) -> bool:
        """Whether their rectangles meet, and none is empty."""
        low = np.maximum(self._first, other._first)
        high = np.minimum(self._first + self._count.shape, other._first + other._count.shape)
        return bool((low < high).all())

    def add(self, points: Float[np.ndarray, "n 2"]) -> None:
        """See the cells of points once more; no two points in one cell."""
        if not len(points):
            return
        index = np.floor(points / CELL_M).astype(int)
        self._reach_to(index.min(axis=0)[::-1], index.max(axis=0)[::-1] + 1)
        at = tuple((index[:, ::-1] - self._first).T)
        self._count[at] = np.minimum(self._count[at] + 1, MOST)

    def take(self, points: Float[np.ndarray, "n 2"]) -> None:
        """See the cells of points once less: something else is there now."""
        index, inside = self._index(points)
        at = tuple(index[inside].T)
        self._count[at] = np.maximum(self._count[at] - 2, 0)

    def unite(self, other: SeenCells) -> None:
        """Add the cells of another raster."""
        self.add(other.places())

    def keep(self, kept: Bool[np.ndarray, "n"]) -> None:
        """Forget the seen cells that are not kept, in the order of `places`; the raster shrinks."""
        at = np.argwhere(self._count > 0)
        self._count[tuple(at[~kept].T)] = 0
        left = at[kept]
        if not len(left):
            self._count = np.zeros((0, 0), np.int8)
            return
        low, high = left.min(axis=0), left.max(axis=0) + 1
        self._count = self._count[low[0] : high[0], low[1] : high[1]].copy()
        self._first = self._first + low

    def mask(self, margin: int) -> tuple[np.ndarray, Float[np.ndarray, "2"]]:
        """Seen cells as an image with a margin, small gaps closed, and (x, y) of the middle of its first pixel, m."""
        padded = np.pad((self._count > 0).astype(np.uint8), margin)
        first = (self._first[::-1] - margin + 0.5) * CELL_M
        return cv2.morphologyEx(padded, cv2.MORPH_CLOSE, CLOSED), first

    def _middles(self, index: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return (index[:, ::-1] + self._first[::-1] + 0.5) * CELL_M

    def _index(
        self, points: Float[np.ndarray, "n 2"]
    ) -> tuple[Int[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """Row and column of points, and which are in the raster."""
        index = np.floor(points / CELL_M).astype(int)[:, ::-1] - self._first
        return index, np.asarray(((index >= 0) & (index < self._count.shape)).all(axis=1))

    def _reach_to(self, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> None:
        """Grow the raster so that it holds cells from low up to high."""
        if not self._count.size:
            self._first = low
            self._count = np.zeros(tuple(high - low), np.int8)
            return
        before = np.maximum(self._first - low, 0)
        after = np.maximum(high - self._first - self._count.shape, 0)
        if before.any() or after.any():
            self._count = np.pad(self._count, ((before[0], after[0]), (before[1], after[1])))
            self._first = self._first - before


def lattice(low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 2"]:
    """Middles of all cells of a rectangle (x, y), m."""
    x0, y0 = np.floor(low / CELL_M).astype(int)
    x1, y1 = np.floor(high / CELL_M).astype(int) + 1
    y, x = np.mgrid[y0:y1, x0:x1]
    return (np.column_stack([x.ravel(), y.ravel()]) + 0.5) * CELL_M
