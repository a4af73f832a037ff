"""Cells of a map that were seen free, and the part of an outline that lies over them.

Source: ours; clipping after Sutherland and Hodgman 1974.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

Ring = Float[np.ndarray, "_ 2"]
PIXEL_M = 0.01  # ours


@dataclass(frozen=True, eq=False)
class FreeCells:
    """Free cells of an occupancy map.

    Args:
        free: Row 0 at the smallest y.
        origin: Lower left corner of cell [0, 0], m.
        cell_m: Side of a cell.
    """

    free: Bool[np.ndarray, "rows columns"]
    origin: Float[np.ndarray, "2"]
    cell_m: float

    @cached_property
    def floor(self) -> FreeCells:
        """The free cells that belong to a block of two by two."""
        if min(self.free.shape) < 2:
            return FreeCells(np.zeros(self.free.shape, np.bool_), self.origin, self.cell_m)
        block = self.free[1:, 1:] & self.free[:-1, 1:] & self.free[1:, :-1] & self.free[:-1, :-1]
        kept = np.zeros(self.free.shape, np.bool_)
        for rows in (np.s_[1:], np.s_[:-1]):
            for columns in (np.s_[1:], np.s_[:-1]):
                kept[rows, columns] |= block
        return FreeCells(kept, self.origin, self.cell_m)

    @property
    def pixel_m(self) -> float:
        """Side of a pixel of outlines that follow cells: about a centimetre, a whole number of them to a cell."""
        return self.cell_m / max(1, round(self.cell_m / PIXEL_M))

    def corner(self, low: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Lower left corner of the pixel that holds a place, m."""
        return np.asarray(
            np.floor((low - self.origin) / self.pixel_m + 1e-9) * self.pixel_m + self.origin
        )

    def at(self, xy: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
        """Whether places lie in a free cell; outside the map none does."""
        cell = np.floor((xy - self.origin) / self.cell_m + 1e-9).astype(np.int64)
        rows, columns = self.free.shape
        inside = ((cell >= 0) & (cell < [columns, rows])).all(axis=-1)
        if not self.free.size:
            return np.asarray(inside)
        row = np.clip(cell[..., 1], 0, rows - 1)
        column = np.clip(cell[..., 0], 0, columns - 1)
        return np.asarray(inside & self.free[row, column])

    def below(self, ring: Ring) -> Float[np.ndarray, "m 2"]:
        """Lower left corners of the free cells in the bounding box of an outline, m."""
        rows, columns = self.free.shape
        low = np.floor((ring.min(axis=0) - self.origin) / self.cell_m).astype(np.int64)
        high = np.floor((ring.max(axis=0) - self.origin) / self.cell_m).astype(np.int64) + 1
        x0, y0 = np.clip(low, 0, [columns, rows])
        x1, y1 = np.clip(high, 0, [columns, rows])
        row, column = np.nonzero(self.free[y0:y1, x0:x1])
        return np.asarray(np.stack([column + x0, row + y0], axis=1) * self.cell_m + self.origin)

    def overlaps(self, ring: Ring) -> list[Ring]:
        """The part of an outline in each free cell; parts below a square millimetre count as none."""
        half = 0.5 * self.cell_m
        parts = []
        for corner in self.below(ring):
            part = clipped(ring, corner + half, half)
            if len(part) >= 3 and abs(area(part)) > 1e-6:
                parts.append(part)
        return parts

    def crosses(self, a: Float[np.ndarray, "2"], b: Float[np.ndarray, "2"]) -> bool:
        """Whether a line segment runs through the inside of a free cell."""
        corners = self.below(np.stack([a, b]))
        if not len(corners):
            return False
        step = b - a
        low, high = corners - a + 1e-7, corners + self.cell_m - a - 1e-7
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = low / step, high / step
        parallel = np.abs(step) < 1e-12
        outside = (parallel & ((low > 0.0) | (high < 0.0))).any(axis=1)
        first, last = np.where(parallel, -np.inf, first), np.where(parallel, np.inf, last)
        enter = np.minimum(first, last).max(axis=1)
        leave = np.maximum(first, last).min(axis=1)
        return bool((~outside & (np.maximum(enter, 0.0) < np.minimum(leave, 1.0) - 1e-9)).any())


def area(ring: Ring) -> float:
    """Signed area of an outline, m^2: positive if it runs counter-clockwise."""
    x, y = ring.T
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def clipped(ring: Ring, centre: Float[np.ndarray, "2"], half_m: float) -> Ring:
    """The part of an outline inside an upright square; pieces of a concave one stay joined along its border."""
    part = ring - centre
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            if len(part) < 3:
                return part[:0]
            inside = half_m - sign * part[:, axis]
            after, inside_after = np.roll(part, -1, axis=0), np.roll(inside, -1)
            kept = []
            for k in range(len(part)):
                if inside[k] >= 0.0:
                    kept.append(part[k])
                if inside[k] * inside_after[k] < 0.0:
                    share = inside[k] / (inside[k] - inside_after[k])
                    kept.append(part[k] + share * (after[k] - part[k]))
            part = np.array(kept).reshape(-1, 2)
    return part + centre
