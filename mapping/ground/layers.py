"""Surfaces as a grid with height and variance in layers, and which of them a robot can step to.

Source: layers after Triebel, Pfaff and Burgard 2006 (multi-level surface maps); the rest ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from .surface import Surface

LAYERS = 3  # ours: a bridge over ground over a hole
STEP_AWAY_M = 0.10  # ours: gap between surfaces that a step crosses, by what is not seen of them


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


def reachable(surfaces: Sequence[Surface], most_step_m: float, most_slope_rad: float) -> list[int]:
    """Indices of the surfaces that steps lead to from where the robot stands, by their mean heights.

    Args:
        surfaces: Body frame.
        most_step_m: Greatest difference of height of a step.
        most_slope_rad: Greatest slope of a surface.
    """
    flat = [math.atan(float(np.linalg.norm(one.height[1:]))) <= most_slope_rad for one in surfaces]
    found = [k for k, one in enumerate(surfaces) if one.contains(np.zeros(2)) and flat[k]]
    for k in found:  # grows
        for other, one in enumerate(surfaces):
            if flat[other] and other not in found and _step_m(surfaces[k], one) <= most_step_m:
                found.append(other)
    return sorted(found)


def _step_m(one: Surface, two: Surface) -> float:
    """Difference of height where two surfaces are nearest; infinite if that is too far apart."""
    a, b = _along(one), _along(two)
    away = np.linalg.norm(a[:, None] - b, axis=2)
    i, j = np.unravel_index(int(away.argmin()), away.shape)
    apart = 0.0 if bool(one.contains(b).any() or two.contains(a).any()) else float(away[i, j])
    if apart > STEP_AWAY_M:
        return math.inf
    return abs(float(one.height_at(a[i])[0] - two.height_at(b[j])[0]))


def _along(surface: Surface) -> np.ndarray:
    """Points along the outline, 5 cm apart at most."""
    start, end = surface.outline, np.roll(surface.outline, -1, axis=0)
    count = int(np.ceil(np.linalg.norm(end - start, axis=1).max() / 0.05)) + 1
    share = np.linspace(0.0, 1.0, count, endpoint=False)[:, None, None]
    return np.asarray((start + share * (end - start)).reshape(-1, 2))
