"""Obstacles that hang: table tops, bars and seats, with room below them that a camera sees.

A floor point proves that nothing stands at its place. It says nothing of a top above it, which from near is beyond the
upper border of the image. A cell hangs if a look shows obstacle points in it, all well above the floor, and sees
through below them. What was known of its floor then no longer applies, and later floor points count only in a frame
that sees through the height of what hangs. A thing that moves does not hang: floor at its place frees it.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int32

from ._terrain_kernels import RAY
from .evidence import OBSTACLE_POINTS

LOWEST_M = 0.10  # ours: the foot of what stands is seen below this height
BELOW_M = 0.08  # ours: this far below its lowest points, two standard deviations below their mean
SeesThrough = Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, "n"]]
"""Whether a frame sees through places: (n, 3), world frame and height above the floor, m."""


def note(
    counts: Int32[np.ndarray, "3 rows columns"],
    sums: Float[np.ndarray, "t 3"],
    hanging: Bool[np.ndarray, "rows columns"],
    height_m: Float[np.ndarray, "rows columns"],
    origin: Float[np.ndarray, "2"],
    cell_m: float,
    sees_through: SeesThrough,
) -> Bool[np.ndarray, "rows columns"]:
    """Note what a look shows to hang, and let floor below count only where the look sees through its height.

    Args:
        counts: Points of each kind (floor, static, moving) in each cell of a window; changed: no floor, or at least a
            ray, in hanging cells without an obstacle.
        sums: Of `cell_points.gather`, over the same points; changed: without that floor.
        hanging: Cells of the window in which something hangs; changed.
        height_m: Its height above the floor.
        origin: Lower left corner of the window, world frame, m.
        cell_m: Side of a cell.
        sees_through: Of the frame.

    Returns:
        The cells that now hang and did not before.
    """
    static, columns = counts[1].ravel(), counts.shape[2]
    flat = np.flatnonzero(static >= OBSTACLE_POINTS)
    mean_m, mean_m2 = (sums[static.size + flat, :2] / static[flat, None]).T
    lowest_m = mean_m - 2.0 * np.sqrt(np.maximum(mean_m2 - mean_m**2, 0.0))
    high = lowest_m > LOWEST_M
    hanging.flat[flat[~high]] = False
    new = high & ~hanging.flat[flat]
    without = np.flatnonzero(hanging & (counts[1] + counts[2] < OBSTACLE_POINTS))
    cells = np.concatenate([flat[new], without])
    fresh = np.zeros_like(hanging)
    if len(cells) == 0:
        return fresh
    row, column = np.divmod(cells, columns)
    heights_m = np.concatenate([lowest_m[new] - BELOW_M, height_m.flat[without]])
    across = origin + cell_m * (np.column_stack([column, row]) + 0.5)
    through = sees_through(np.column_stack([across, heights_m]))
    fresh.flat[flat[new]] = through[: len(cells) - len(without)]
    hanging |= fresh
    seen = through[len(cells) - len(without) :]
    below, free = without[~seen], without[seen]
    counts[0].flat[below], sums[below] = 0, 0.0
    counts[0].flat[free[counts[0].flat[free] == 0]] = RAY
    return fresh
