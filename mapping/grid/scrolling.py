"""A square window on an endless lattice that scrolls with the robot: an offset moves, the data does not.

The lattice is fixed in the world, with the start position in the centre of one of its cells. The window is
the N x N part of it with the robot in the centre cell. Every layer is a torus: a cell that leaves on one side
is reused for one that enters on the other. The window never rotates.

Source: seed 003, section 3, eq. (1) and (2), Fig. 5 and 6.
"""

from __future__ import annotations

from typing import SupportsIndex

import numpy as np
from jaxtyping import Float, Float32, Int, Shaped

from perception.primitives.errors import InputError


def whole_cells(
    offset: Float[np.ndarray, "2"],
    step: Float[np.ndarray, "2"],
    cell_m: float,
    literal: bool = False,
) -> tuple[Int[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Split a step into whole cells to shift by and a remainder inside the centre cell.

    Args:
        offset: R, the robot in its centre cell, each in [-S_c/2, S_c/2), world axes, m.
        step: M, displacement of the robot, world axes, m.
        cell_m: S_c, side of a cell.
        literal: Drop the old R, as eq. (2) is printed; drifts, for comparison only.

    Returns:
        A, the cells crossed along each axis, and the new R, m.

    Source: seed 003, eq. (1) and (2).
    """
    cells = np.floor((offset + step) / cell_m + 0.5).astype(np.int64)  # eq. (1)
    moved = step if literal else offset + step
    return cells, moved - cells * cell_m  # eq. (2)


class Window:
    """Position of the window, and the layers that scroll with it."""

    def __init__(
        self, cells: int, cell_m: float, position_world: Float[np.ndarray, "2"], literal: bool
    ) -> None:
        """N (odd) cells along a side; the robot starts at the position (2,), m, in the centre of its cell."""
        self._n, self._cell_m, self._literal = cells, cell_m, literal
        self._start = _finite(position_world)
        self._anchor = self._start - 0.5 * cell_m  # lower left corner of lattice cell (0, 0)
        self._first = np.array([-(cells // 2), -(cells // 2)])  # lattice cell (x, y) of [0, 0]
        self._corner = np.array([0, 0])  # its index in the layers, (x, y)
        self._rest = np.zeros(2)  # R
        self._layers: list[tuple[np.ndarray, float]] = []
        self._centres: tuple[tuple[int, int], np.ndarray] | None = None

    @property
    def cell_m(self) -> float:
        """S_c, side of a cell, m."""
        return self._cell_m

    @property
    def position(self) -> Float[np.ndarray, "2"]:
        """Position of the robot, world frame, m: centre of the centre cell plus R."""
        return self._start + (self._first + self._n // 2) * self.cell_m + self._rest

    @property
    def offset(self) -> Float[np.ndarray, "2"]:
        """R, position of the robot in the centre cell, m, each in [-S_c/2, S_c/2)."""
        return self._rest.copy()

    @property
    def origin(self) -> Float[np.ndarray, "2"]:
        """Lower left corner of cell [0, 0], world frame, m."""
        return self._start + (self._first - 0.5) * self.cell_m

    def cell_of(self, xy: Float[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n 2"]:
        """Cells [row, column] of world positions, m; indices outside [0, N) are outside the grid."""
        lattice = np.floor((xy - self._anchor) * (1.0 / self.cell_m)).astype(np.int64)
        return (lattice - self._first)[..., ::-1]

    def centre_of(self, row: SupportsIndex, column: SupportsIndex) -> Float[np.ndarray, "2"]:
        """Centre of a cell, world frame, m."""
        return self._start + (self._first + np.array([int(column), int(row)])) * self.cell_m

    def centres(self) -> Float[np.ndarray, "rows columns 2"]:
        """Centres of all cells, world frame, m; read-only, cached until the grid moves."""
        at = (int(self._first[0]), int(self._first[1]))
        if self._centres is None or self._centres[0] != at:
            along = np.arange(self._n)
            columns, rows = np.meshgrid(along, along)
            lattice = self._first + np.stack([columns, rows], axis=-1)
            centres = np.asarray(self._start + lattice * self.cell_m)
            centres.setflags(write=False)
            self._centres = (at, centres)
        return self._centres[1]

    def new_layer(self, fill: float) -> Float32[np.ndarray, "rows columns"]:
        """Add a layer that scrolls with the grid; entering cells get `fill`.

        The array is the torus itself: read it with `unrolled`, write it with `rolled`.
        """
        layer = np.full((self._n, self._n), fill, np.float32)
        self._add_layer(layer, fill)
        return layer

    def _add_layer(self, layer: np.ndarray, fill: float) -> None:
        """Add an (n, n) array of any type to the layers."""
        self._layers.append((layer, fill))

    def unrolled(self, layer: Shaped[np.ndarray, "n n"]) -> Shaped[np.ndarray, "n n"]:
        """A layer in world order, as a copy."""
        return np.roll(layer, (-self._corner[1], -self._corner[0]), (0, 1))

    def rolled(self, view: Shaped[np.ndarray, "n n"]) -> Shaped[np.ndarray, "n n"]:
        """A mask or values in world order, reordered as the layers are stored."""
        return np.roll(view, (self._corner[1], self._corner[0]), (0, 1))

    def _placement(self) -> dict[str, np.ndarray]:
        return {"start": self._start.copy(), "first": self._first.copy(), "rest": self._rest.copy()}

    def _place(self, first: Int[np.ndarray, "2"], rest: Float[np.ndarray, "2"]) -> None:
        """Restore the position of a saved window, before any layer is written."""
        self._first = first.astype(np.int64)
        self._corner = (self._first + self._n // 2) % self._n
        self._rest = rest.astype(np.float64)

    def move(self, position_world: Float[np.ndarray, "2"]) -> None:
        """Follow the robot to a position, (2,), m; cells that enter are unseen (p = 1, t = 0).

        Raises:
            InputError: The position is not finite.
        """
        self.shift(_finite(position_world) - self.position)

    def shift(self, step_world: Float[np.ndarray, "2"]) -> None:
        """Follow the robot by a displacement M, (2,), m, world axes.

        Source: seed 003, eq. (1) and (2), cases (a) and (b).
        """
        cells, self._rest = whole_cells(self._rest, step_world, self.cell_m, self._literal)
        if not cells.any():
            return  # case (a)
        n = self._n
        self._first += cells
        self._corner = (self._corner + cells) % n  # case (b): the offset moves, the data does not
        columns = _entering(int(cells[0]), int(self._corner[0]), n)
        rows = _entering(int(cells[1]), int(self._corner[1]), n)
        for layer, fill in self._layers:
            for part in columns:
                layer[:, part] = fill
            for part in rows:
                layer[part] = fill


def _entering(shift: int, corner: int, n: int) -> list[slice]:
    """Slices of a layer that enter when the window, now at `corner`, has moved by `shift` cells."""
    count = min(abs(shift), n)
    first = (corner + (n - count if shift > 0 else 0)) % n
    return [slice(first, min(first + count, n)), slice(0, max(first + count - n, 0))]


def _finite(position: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    if not np.isfinite(position).all():
        raise InputError(
            f"grid: position {position} is not finite; keep the last pose until the localiser has a new one"
        )
    return position.astype(np.float64)
