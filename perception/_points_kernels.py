"""Compiled inner loop of back-projection."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def back_project(z: np.ndarray, rays: np.ndarray, out: np.ndarray) -> None:
    """out[v, u] = (x z, y z, z) for rays (h, w, 2) and depths (h, w)."""
    height, width = z.shape
    for v in range(height):
        for u in range(width):
            distance = z[v, u]
            out[v, u, 0] = rays[v, u, 0] * distance
            out[v, u, 1] = rays[v, u, 1] * distance
            out[v, u, 2] = distance
