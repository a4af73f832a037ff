"""Compiled inner loop of splitting: the peaks of a height map that stand out."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def peaks(height, order, prominence):  # type: ignore[no-untyped-def]
    """Label of the prominent peak that each cell belongs to.

    height (r, c), NaN outside; order (k,) flat indices of the cells inside, highest first. Cells join the
    peak of a higher neighbour; where two peaks meet, the lower one is swallowed unless it stands out by
    `prominence` over the meeting place. Returns (r, c) int64: flat index of the peak, -1 outside.
    """
    rows, columns = height.shape
    parent = np.full(rows * columns, -1, np.int64)
    for n in range(len(order)):
        cell = order[n]
        r, c = cell // columns, cell % columns
        best = -1
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                i, j = r + dr, c + dc
                if (dr == 0 and dc == 0) or i < 0 or j < 0 or i >= rows or j >= columns:
                    continue
                other = i * columns + j
                if parent[other] < 0:
                    continue
                while parent[other] != other:
                    other = parent[other]
                if best < 0:
                    best = other
                elif other != best:
                    high, low = best, other
                    a, b = height[high // columns, high % columns], height[low // columns, low % columns]
                    if b > a:
                        high, low, b = low, high, a
                    if b - height[r, c] < prominence:
                        parent[low] = high
                        best = high
                    else:  # both stand out: the meeting place goes to the higher, they stay two
                        best = high
        parent[cell] = cell if best < 0 else best
    labels = np.full((rows, columns), -1, np.int64)
    for n in range(len(order)):
        cell = order[n]
        root = cell
        while parent[root] != root:
            root = parent[root]
        labels[cell // columns, cell % columns] = root
    return labels
