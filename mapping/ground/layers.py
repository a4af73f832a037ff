"""Surfaces as a grid with height and variance in layers.

Source: layers after Triebel, Pfaff and Burgard 2006 (multi-level surface maps); the rest ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from .surface import Surface

LAYERS = 3  # ours: a bridge over ground over a hole


@dataclass(frozen=True, eq=False)
class HeightLayers:
    """A square grid round the robot; cell (row, column) has its middle at (column, row) cells from `first_m`.

    Args:
        height_m: (layers, rows, columns), the lowest first; NaN where there is none.
        variance_m2: Of the height.
        first_m: x and y of the middle of the first cell, body frame.
        cell_m: Side of a cell.
    """

    height_m: Float32[np.ndarray, "layers n n"]
    variance_m2: Float32[np.ndarray, "layers n n"]
    first_m: float
    cell_m: float


def height_layers(
    surfaces: Sequence[Surface], half_m: float = 1.5, cell_m: float = 0.05, layers: int = LAYERS
) -> HeightLayers:
    """Heights of all surfaces per cell.

    Args:
        surfaces: Body frame.
        half_m: Half the side of the grid.
        cell_m: Side of a cell.
        layers: Heights that a cell holds at most; the highest are dropped.
    """
    n = 2 * round(half_m / cell_m) + 1
    first = -(n // 2) * cell_m
    axis = first + cell_m * np.arange(n)
    height = np.full((len(surfaces) + layers, n, n), np.nan, np.float32)
    variance = height.copy()
    for k, one in enumerate(surfaces):
        low, high = one.outline.min(axis=0), one.outline.max(axis=0)
        columns = slice(*np.searchsorted(axis, (low[0], high[0])))
        rows = slice(*np.searchsorted(axis, (low[1], high[1])))
        x, y = np.meshgrid(axis[columns], axis[rows])
        points = np.stack([x, y], axis=-1)
        z, sigma = one.height_at(points)
        inside = one.contains(points)
        height[k, rows, columns] = np.where(inside, z, np.nan)
        variance[k, rows, columns] = np.where(inside, sigma**2, np.nan)
    order = np.argsort(height, axis=0)[:layers]  # NaN last
    return HeightLayers(
        np.take_along_axis(height, order, axis=0),
        np.take_along_axis(variance, order, axis=0),
        first,
        cell_m,
    )
