"""The side on which to pass: away from where more stands.

Source: seed 004, eq. (22); the tie is the specification's.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

TIE = 0.02  # specification: sums nearer to zero than this say nothing


def direction(total: float, gap_left_m: float, gap_right_m: float, tie: float = TIE) -> int:
    """D: +1 to pass on the left, -1 on the right.

    Args:
        total: Sum of all complexity measures, right positive.
        gap_left_m, gap_right_m: Free way on either side of what blocks, m; decides a tie, then left.
        tie: Half-width of the band in which the sum says nothing.

    Source: seed 004, eq. (22): D = sign(sum CM), D > 0 left.
    """
    if abs(total) < tie:
        return -1 if gap_right_m > gap_left_m else 1
    return 1 if total > 0.0 else -1


def blocking(
    left_m: Float[np.ndarray, "n"],
    right_m: Float[np.ndarray, "n"],
    distance_m: Float[np.ndarray, "n"],
    corridor_m: float,
    depth_m: float = 0.3,
) -> Bool[np.ndarray, "n"]:
    """Which obstacles stand in the way: those in the corridor ahead, no farther than the nearest and a bit.

    Args:
        left_m, right_m: Where the edges lie across the way, y, left positive, m.
        distance_m: Forward distances.
        corridor_m: Width of the corridor about straight ahead, m.
        depth_m: Obstacles farther than the nearest one in the corridor by more than this come later.

    Source: the specification's reading of eq. (23): the group that blocks a corridor of w_r + 2 c.
    """
    inside = (left_m > -corridor_m / 2) & (right_m < corridor_m / 2)
    if not inside.any():
        return np.asarray(inside)
    return np.asarray(inside & (distance_m <= distance_m[inside].min() + depth_m))
