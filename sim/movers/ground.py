"""The ground of a mover: places that it reaches without touching anything static, and ways between them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..free_space import ClearanceMap
from ..scene import Place

MARGIN_M = 0.05  # ours: to static objects; more than the rounding to cells
AWAY_M = 0.7  # ours: nobody stops nearer to a goal of the robot
_STEP_M = 0.025  # ours: of the points that are checked along a line


class Ground:
    """Where a mover may be.

    Args:
        space: Clearance among the static objects.
        radius_m: Of the mover.
        at: Where it should start; it starts at the nearest free cell.
        start: The robot's, which it keeps off.
        goals: The robot's; it passes them but does not stop there.
    """

    def __init__(
        self,
        space: ClearanceMap,
        radius_m: float,
        at: Place,
        start: Place,
        goals: Sequence[Place],
    ) -> None:
        need = radius_m + MARGIN_M
        centres = space.centres
        off = np.hypot(*(centres - np.array(start)).T) - AWAY_M
        spare = np.minimum(space.clearance.ravel() - need, off).reshape(space.clearance.shape)
        free = ClearanceMap(space.origin, space.cell_m, spare)
        away = np.hypot(*(centres - np.array(at)).T)
        nearest = int(np.argmin(np.where(spare.ravel() >= 0.0, away, np.inf)))
        self.at: Place = at
        if free.at(at) < 0.0:
            self.at = (float(centres[nearest, 0]), float(centres[nearest, 1]))
        reach = free.reachable(self.at, 0.0)
        self._free = ClearanceMap(space.origin, space.cell_m, np.where(reach, spare, -1.0))
        rest = centres[reach.ravel()]
        quiet = np.ones(len(rest), np.bool_)
        for goal in goals:
            quiet &= np.hypot(*(rest - np.array(goal)).T) >= AWAY_M
        self._cells = rest[quiet] if quiet.any() else rest
        rows, columns = np.gradient(space.clearance, space.cell_m)
        self._slope = np.stack([columns, rows], axis=-1)
        self._clearance = space

    def allows(self, x: float, y: float) -> bool:
        """Whether it may stand there."""
        return self._free.at((x, y)) >= 0.0

    def wall(self, x: float, y: float) -> tuple[float, float, float]:
        """Distance from a place to the nearest static object, m, and the direction away from it."""
        row, column = self._clearance.cell((x, y))
        rows, columns = self._clearance.clearance.shape
        if not (0 <= row < rows and 0 <= column < columns):
            return 0.0, 0.0, 0.0
        away = self._slope[row, column]
        return float(self._clearance.clearance[row, column]), float(away[0]), float(away[1])

    def place(
        self, rng: np.random.Generator, within: Float[np.ndarray, "4"] | None = None
    ) -> Place:
        """A random place to stop at, if there is one within (x_min, y_min, x_max, y_max) there."""
        cells = self._cells
        if within is not None:
            inside = ((cells >= within[:2]) & (cells <= within[2:])).all(axis=1)
            cells = cells[inside] if inside.any() else cells
        x, y = cells[int(rng.integers(len(cells)))]
        return float(x), float(y)

    @property
    def extent(self) -> Float[np.ndarray, "4"]:
        """(x_min, y_min, x_max, y_max) of the places to stop at."""
        return np.concatenate([self._cells.min(axis=0), self._cells.max(axis=0)])

    def sees(self, a: Place, b: Place) -> bool:
        """Whether the straight line between two places is free."""
        share = np.linspace(0.0, 1.0, 2 + math.ceil(math.dist(a, b) / _STEP_M))
        x0, y0 = self._free.origin
        columns = np.rint((a[0] + (b[0] - a[0]) * share - x0) / self._free.cell_m).astype(np.int64)
        rows = np.rint((a[1] + (b[1] - a[1]) * share - y0) / self._free.cell_m).astype(np.int64)
        spare = self._free.clearance
        if rows.min() < 0 or columns.min() < 0:
            return False
        if rows.max() >= spare.shape[0] or columns.max() >= spare.shape[1]:
            return False
        return bool((spare[rows, columns] >= 0.0).all())

    def way(self, a: Place, b: Place) -> list[Place]:
        """Corners of a short way from one place to another, the last one included; empty if there is none."""
        if self.sees(a, b):
            return [b]
        cells = self._free.path(a, b, 0.0)
        if cells is None:
            return []
        places: list[Place] = [(float(x), float(y)) for x, y in cells]
        corners, at, k = [], a, 0
        while k < len(places) - 1:
            last = len(places) - 1
            while last > k + 1 and not self.sees(at, places[last]):
                last = k + 1 + (last - k - 1) // 2
            at, k = places[last], last
            corners.append(at)
        return [*corners, b]
