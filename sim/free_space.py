"""Free space for a round body among static objects, for scenes that can be crossed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from .scene import Extent, Place
from .shapes import Shape, distance

ROBOT_TOP_M = 0.5  # ours: shapes above this height do not block the robot


@dataclass(frozen=True, eq=False)
class ClearanceMap:
    """Distance of every cell to the nearest object, m, negative inside it.

    Args:
        origin: (x, y) of the first cell's centre, m.
        cell_m: Side of a cell.
        clearance: Indexed [row (y), column (x)].
    """

    origin: tuple[float, float]
    cell_m: float
    clearance: Float[np.ndarray, "rows columns"]

    @property
    def centres(self) -> Float[np.ndarray, "n 2"]:
        """Centres of all cells in order, m."""
        return _grid(self.origin, self.clearance.shape, self.cell_m)

    def at(self, point: tuple[float, float]) -> float:
        """Clearance of the cell that contains a point; minus infinity outside."""
        row, column = self.cell(point)
        rows, columns = self.clearance.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return -np.inf
        return float(self.clearance[row, column])

    def cell(self, point: tuple[float, float]) -> tuple[int, int]:
        """[row, column] of the cell that contains a point."""
        return (
            round((point[1] - self.origin[1]) / self.cell_m),
            round((point[0] - self.origin[0]) / self.cell_m),
        )

    def with_disc(self, centre: Place, radius_m: float) -> ClearanceMap:
        """The map with one more disc."""
        away = np.hypot(*(self.centres - np.array(centre)).T) - radius_m
        return ClearanceMap(
            self.origin, self.cell_m, np.minimum(self.clearance, away.reshape(self.clearance.shape))
        )

    def reachable(self, start: Place, radius_m: float) -> Bool[np.ndarray, "rows columns"]:
        """Cells that a disc of that radius can reach from the start (four neighbours)."""
        labels, _ = ndimage.label(self.clearance >= radius_m)
        row, column = self.cell(start)
        label = labels[row, column]
        return np.asarray((labels == label) & (label > 0))

    def path(self, start: Place, goal: Place, radius_m: float) -> Float[np.ndarray, "n 2"] | None:
        """A shortest path of cells for a disc, m; None if there is none."""
        free = self.clearance >= radius_m
        steps = _distances(free, self.cell(start))
        at = self.cell(goal)
        if steps[at] < 0:
            return None
        cells = [at]
        while steps[at] > 0:
            row, column = at
            at = min(
                ((row + i, column + j) for i, j in _NEIGHBOURS),
                key=lambda cell: steps[cell] if steps[cell] >= 0 else np.iinfo(np.int64).max,
            )
            cells.append(at)
        back = np.array(cells[::-1], dtype=float)
        return np.asarray(back[:, ::-1] * self.cell_m + np.array(self.origin))


def clearance_map(
    extent: Extent, shapes: Sequence[Shape], cell_m: float = 0.05, top_m: float = ROBOT_TOP_M
) -> ClearanceMap:
    """Clearance inside the walls of a room, from walls and all shapes below a top, by default the robot's."""
    x_min, y_min, x_max, y_max = extent
    shape = (int((y_max - y_min) / cell_m), int((x_max - x_min) / cell_m))
    origin = (x_min + cell_m / 2, y_min + cell_m / 2)
    centres = _grid(origin, shape, cell_m)
    least = np.minimum(
        (centres - np.array([x_min, y_min])).min(axis=1),
        (np.array([x_max, y_max]) - centres).min(axis=1),
    )
    for one in shapes:
        if one.bottom_m < top_m:
            least = np.minimum(least, distance(one, centres))
    return ClearanceMap(origin, cell_m, least.reshape(shape))


_NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def _grid(
    origin: tuple[float, float], shape: tuple[int, ...], cell_m: float
) -> Float[np.ndarray, "n 2"]:
    x = origin[0] + np.arange(shape[1]) * cell_m
    y = origin[1] + np.arange(shape[0]) * cell_m
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _distances(
    free: Bool[np.ndarray, "rows columns"], start: tuple[int, int]
) -> Int[np.ndarray, "rows columns"]:
    """Steps from the start to every free cell, -1 where it is unreachable (breadth-first search)."""
    steps = np.full(free.shape, -1, np.int64)
    if not free[start]:
        return steps
    steps[start] = 0
    ring, count = [start], 0
    while ring:
        count += 1
        found = []
        for row, column in ring:
            for i, j in _NEIGHBOURS:
                near = (row + i, column + j)
                inside = 0 <= near[0] < free.shape[0] and 0 <= near[1] < free.shape[1]
                if inside and free[near] and steps[near] < 0:
                    steps[near] = count
                    found.append(near)
        ring = found
    return steps
