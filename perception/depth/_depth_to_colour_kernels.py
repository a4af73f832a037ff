"""Compiled loops of the occlusion test between two cameras."""

from __future__ import annotations

import numpy as np

from ..primitives.compiled import njit


@njit(cache=True)
def nearest(pixels: np.ndarray, z: np.ndarray, height: int, width: int, cell: int) -> np.ndarray:
    """Smallest z in every cell of the other image; infinity in empty cells.

    Args:
        pixels: (n, 2), u and v in the other image, px; NaN where a point is not in front of it.
        z: (n,), along the other camera's axis, m.
        height, width: Of the other image, px.
        cell: Edge of a cell, px.
    """
    rows, columns = (height + cell - 1) // cell, (width + cell - 1) // cell
    found = np.full((rows, columns), np.inf, np.float32)
    for i in range(len(z)):
        u, v = pixels[i, 0], pixels[i, 1]
        if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
            continue
        row, column = int(v + 0.5) // cell, int(u + 0.5) // cell
        if z[i] < found[row, column]:
            found[row, column] = z[i]
    return found


@njit(cache=True)
def sampled(
    pixels: np.ndarray, z: np.ndarray, rgb: np.ndarray, depths: np.ndarray, cell: int, slack: float
) -> np.ndarray:
    """Colours (n, 3) of the points visible to the other camera; black for occluded ones."""
    height, width = rgb.shape[:2]
    colours = np.zeros((len(z), 3), np.uint8)
    for i in range(len(z)):
        u, v = pixels[i, 0], pixels[i, 1]
        if not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
            continue
        row, column = int(v + 0.5), int(u + 0.5)
        if z[i] > depths[row // cell, column // cell] + slack * z[i]:
            continue
        for k in range(3):
            colours[i, k] = rgb[row, column, k]
    return colours
