"""The side on which to pass: the one with fewer obstacles.

Source: Kang 2013 (seed 004), eq. (22); the tie is ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

TIE = 0.02  # ours: a sum nearer to zero than this is a tie
DEPTH_M = 0.3  # ours: obstacles farther than the nearest one by more than this come later


def direction(total: float, gap_left_m: float, gap_right_m: float) -> int:
    """D: +1 to pass on the left, -1 on the right.

    Args:
        total: Sum of all complexity measures, right positive.
        gap_left_m, gap_right_m: Free width on either side of the obstacles, m; decides a tie, then left.

    Source: seed 004, eq. (22): D = sign(sum CM), D > 0 left.
    """
    if abs(total) < TIE:
        return -1 if gap_right_m > gap_left_m else 1
    return 1 if total > 0.0 else -1


def blocking(
    left_m: Float[np.ndarray, "n"],
    right_m: Float[np.ndarray, "n"],
    distance_m: Float[np.ndarray, "n"],
    corridor_m: float,
) -> Bool[np.ndarray, "n"]:
    """The obstacles in the corridor ahead that are at most DEPTH_M farther than the nearest one.

    Args:
        left_m, right_m: Lateral positions of the edges, left positive, m.
        distance_m: Forward distances.
        corridor_m: Width of the corridor straight ahead, m.

    Source: ours, for eq. (23): the group that blocks a corridor of w_r + 2 c.
    """
    inside = (left_m > -corridor_m / 2) & (right_m < corridor_m / 2)
    if not inside.any():
        return np.asarray(inside)
    return np.asarray(inside & (distance_m <= distance_m[inside].min() + DEPTH_M))
