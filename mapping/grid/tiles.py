"""Layers of cells on an endless lattice, kept in square tiles: memory grows with the area that was seen.

Source: ours; tiles of a map as in the submaps of Bosse et al. 2004 (Atlas), but in one frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Int

TILE = 64  # ours: cells along a side; 3.2 m, so that a frame touches four to nine tiles

Key = tuple[int, int]
"""Column and row of a tile."""


class Tiles:
    """Named layers of the same cells."""

    def __init__(self, empty: Mapping[str, np.generic]) -> None:
        """No tiles.

        Args:
            empty: Value and type of each layer where nothing was entered.
        """
        self._side = TILE
        self._empty = {name: np.array(value) for name, value in empty.items()}
        self._tiles: dict[Key, dict[str, np.ndarray]] = {}

    def __len__(self) -> int:
        """Number of tiles."""
        return len(self._tiles)

    def __getitem__(self, key: Key) -> dict[str, np.ndarray]:
        """The layers of a tile, to change in place."""
        return self._tiles[key]

    def keys_in(self, low: Int[np.ndarray, "2"], shape: tuple[int, int]) -> list[Key]:
        """The tiles that a window meets.

        Args:
            low: Lattice cell (x, y) of its cell [0, 0].
            shape: Its rows and columns.
        """
        return [key for key in self._places(low, shape) if key in self._tiles]

    def make(self, low: Int[np.ndarray, "2"], seen: Bool[np.ndarray, "rows columns"]) -> list[Key]:
        """The tiles that hold a seen cell of a window, made where they are not there; one far cell makes one tile.

        Args:
            low: Lattice cell (x, y) of the window's cell [0, 0].
            seen: Cells of the window.
        """
        rows, columns = np.nonzero(seen)
        cells = np.stack([columns, rows], axis=1) + low
        keys = [(column, row) for column, row in np.unique(cells // self._side, axis=0).tolist()]
        for key in keys:
            if key not in self._tiles:
                side = (self._side, self._side)
                self._tiles[key] = {n: np.full(side, value) for n, value in self._empty.items()}
        return keys

    def _places(self, low: Int[np.ndarray, "2"], shape: tuple[int, int]) -> list[Key]:
        """Where the tiles of a window are, whether they are there or not."""
        rows, columns = shape
        first = np.asarray(low) // self._side
        last = np.add(low, [columns - 1, rows - 1]) // self._side
        return [
            (column, row)
            for row in range(int(first[1]), int(last[1]) + 1)
            for column in range(int(first[0]), int(last[0]) + 1)
        ]

    def read(
        self, low: Int[np.ndarray, "2"], shape: tuple[int, int], names: Sequence[str] = ()
    ) -> dict[str, np.ndarray]:
        """Copies of the layers with these names, or of all, in a window."""
        chosen = names or tuple(self._empty)
        found = {name: np.full(shape, self._empty[name]) for name in chosen}
        for key, there, here in self._overlaps(low, shape):
            for name in chosen:
                found[name][here] = self._tiles[key][name][there]
        return found

    def write(self, low: Int[np.ndarray, "2"], window: Mapping[str, np.ndarray]) -> None:
        """Enter the layers of a window where there are tiles."""
        shape = next(iter(window.values())).shape
        for key, there, here in self._overlaps(low, (shape[0], shape[1])):
            for name, values in window.items():
                self._tiles[key][name][there] = values[here]

    def _overlaps(
        self, low: Int[np.ndarray, "2"], shape: tuple[int, int]
    ) -> Iterator[tuple[Key, tuple[slice, slice], tuple[slice, slice]]]:
        """Each tile in a window, and the common rows and columns in the tile and in the window."""
        rows, columns = shape
        for key in self.keys_in(low, shape) if rows and columns else ():
            x, y = (
                int(number) * self._side - int(corner)
                for number, corner in zip(key, low, strict=True)
            )
            top, left = max(y, 0), max(x, 0)
            bottom, right = min(y + self._side, rows), min(x + self._side, columns)
            there = (slice(top - y, bottom - y), slice(left - x, right - x))
            yield key, there, (slice(top, bottom), slice(left, right))
