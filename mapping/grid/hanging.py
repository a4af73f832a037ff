"""Obstacles that hang: table tops, bars and seats, with room below them that a camera sees.

A floor point proves that nothing stands at its place. It says nothing of a top above it, which from near is beyond the
upper border of the image. A look shows that something hangs in a cell if it has obstacle points in it, all well above
the floor, and sees through below them. What was known of the floor then no longer applies. From the second such look
on, as the first may be of flying pixels, floor points count only in a frame that sees through the height of what
hangs. A thing that moves does not hang: floor at its place frees it.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from . import _hanging_kernels
from ._terrain_kernels import Placement
from .evidence import OBSTACLE_POINTS

LOWEST_M = 0.10  # ours: the foot of what stands is seen below this height
BELOW_M = 0.08  # ours: this far below its lowest points, or half as high, a look sees through
SeesThrough = Callable[[Float[np.ndarray, "n 3"]], Bool[np.ndarray, "n"]]
"""Whether a frame sees through places: (n, 3), world frame and height above the floor, m."""


def note(
    counts: Int32[np.ndarray, "3 rows columns"],
    sums: Float[np.ndarray, "t 3"],
    hanging: Bool[np.ndarray, "a b"],
    height_m: Float32[np.ndarray, "a b"],
    log_odds: Float32[np.ndarray, "a b"],
    place: Placement,
    sees_through: SeesThrough,
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Note what a look shows to hang, and let floor below count only where the look sees through its height.

    Args:
        counts: Points of each kind (floor, static, moving) in each cell of a window; changed: no floor, or at least a
            ray, in hanging cells without an obstacle.
        sums: Of `cell_points.gather`, over the same points; changed: without that floor.
        hanging: Cells of the map in which something hangs; changed.
        height_m: Its height above the floor.
        log_odds: Of occupancy.
        place: The window in the map.
        sees_through: Of the frame.

    Returns:
        Rows and columns in the map of the free cells in which the look shows something that hangs: that they are free
        was known of their floor.
    """
    cells, there, places = _hanging_kernels.questions(
        counts, sums, hanging, height_m, place, OBSTACLE_POINTS, LOWEST_M, BELOW_M
    )
    if len(cells) == 0:
        return there[:, 0], there[:, 1]
    through = sees_through(places)
    fresh = _hanging_kernels.answer(counts, sums, hanging, log_odds, cells, there, through)
    row, column = there[fresh].T
    free = log_odds[row, column] < 0.0
    return row[free], column[free]
