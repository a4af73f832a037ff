"""Contact edges of obstacles with the floor: the edge image I_E, and its groups.

Source: seed 000, section 3.2 (the 2x1 mask: obstacle above, ground below).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

from . import _monocular_kernels as kernels

REACH_PX = 3  # seed 000: grouped 8-connected after a dilation of 3 px
BESIDE_PX = 4  # ours: two pixels of the half resolution at which corners are found
MIN_COLUMNS = 5  # ours: narrower edges are noise; 0.1 m at 6 m has eight


@dataclass(frozen=True, eq=False)
class Edges:
    """The edge pixels of one picture.

    Args:
        image: I_E, 255 where a pixel is not ground and the one below it is.
        columns, rows: (n,), of every edge pixel, row by row.
        labels: (n,), index into `groups`, -1 for noise.
        groups: For each obstacle the lowest edge pixel (u, v) of each of its columns, (m, 2), columns ascending;
            obstacles from left to right by their mean column.
        start, order: Pixels sorted by column: those of column u are order[start[u]:start[u + 1]].
    """

    image: UInt8[np.ndarray, "h w"]
    columns: Int[np.ndarray, "n"]
    rows: Int[np.ndarray, "n"]
    labels: Int[np.ndarray, "n"]
    groups: tuple[Int[np.ndarray, "_ 2"], ...]
    start: Int[np.ndarray, "w1"]
    order: Int[np.ndarray, "n"]

    def group_below(
        self, pixels: Float[np.ndarray, "k 2"], farthest_px: float
    ) -> Int[np.ndarray, "k"]:
        """Group with the nearest edge below each pixel (u, v), within a distance; -1 for none."""
        found = np.empty(len(pixels), np.int32)
        u, v = (np.ascontiguousarray(pixels[:, k], np.float64) for k in (0, 1))
        kernels.group_below(
            u, v, self.start, self.order, self.rows, self.labels, farthest_px, found
        )
        return found

    def group_beside(
        self, pixels: Float[np.ndarray, "k 2"], farthest_px: float
    ) -> Int[np.ndarray, "k"]:
        """The same, or else of the nearest columns within `BESIDE_PX`: a corner of an outline lies on its border."""
        found = self.group_below(pixels, farthest_px)
        for aside in range(2, BESIDE_PX + 1, 2):
            for side in (-aside, aside):
                other = self.group_below(pixels + np.array([side, 0.0]), farthest_px)
                found = np.where(found < 0, other, found)
        return found


def find_edges(ground: UInt8[np.ndarray, "h w"]) -> Edges:
    """Edge pixels of a ground image, grouped into obstacles: pixels up to 3 px apart belong together.

    Args:
        ground: I_g, 255 on the floor.

    Source: seed 000, section 3.2; the grouping is ours.
    """
    width = ground.shape[1]
    image = np.zeros_like(ground)
    columns, rows = np.empty(16 * width, np.int32), np.empty(16 * width, np.int32)
    count = kernels.mark_edges(ground, image, columns, rows)
    if count > len(rows):  # more than expected: again with larger arrays
        columns, rows = np.empty(count, np.int32), np.empty(count, np.int32)
        kernels.mark_edges(ground, image, columns, rows)
    columns, rows = columns[:count], rows[:count]
    parent, order = np.empty(count, np.int32), np.empty(count, np.int32)
    start = np.empty(width + 1, np.int32)
    kernels.group_edges(columns, rows, width, REACH_PX, parent, start, order)
    by_column = np.lexsort((rows, columns, parent))
    group, column = parent[by_column], columns[by_column]
    ends = np.ones(count, dtype=bool)  # of a column of a group
    ends[:-1] = (group[1:] != group[:-1]) | (column[1:] != column[:-1])
    last = by_column[ends]
    bounds = np.flatnonzero(np.diff(parent[last])) + 1
    lowest = [
        (int(parent[members[0]]), np.stack([columns[members], rows[members]], axis=1))
        for members in np.split(last, bounds)
        if len(members) >= MIN_COLUMNS
    ]
    lowest.sort(key=lambda found: (float(found[1][:, 0].mean()), found[0]))
    labels = np.full(count, -1, np.int32)
    relabel = np.full(count, -1, np.int32)
    for index, (root, _) in enumerate(lowest):
        relabel[root] = index
    if count:
        labels = relabel[parent]
    return Edges(image, columns, rows, labels, tuple(edge for _, edge in lowest), start, order)
