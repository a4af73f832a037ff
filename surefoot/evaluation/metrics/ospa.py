"""OSPA: one distance between tracks and true objects that includes missed objects and false tracks.

Tracks and objects are assigned so that the sum of their distances, cut off at a maximum, is smallest; each
unassigned one costs the cut-off.

Source: Schuhmacher, Vo, Vo, "A consistent metric for performance evaluation of multi-object filters",
IEEE Transactions on Signal Processing 56 (2008), eq. (3).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

CUTOFF_M = 0.5  # ours: three body radii; further apart it is another object
ORDER = 1.0  # ours: mean error per object, easiest to read


def ospa(
    estimated: Float[np.ndarray, "n d"],
    true: Float[np.ndarray, "m d"],
    cutoff_m: float = CUTOFF_M,
    order: float = ORDER,
) -> float:
    """Optimal sub-pattern assignment distance, in [0, cutoff_m], m.

    Args:
        estimated, true: Positions, m; either may be empty.
        cutoff_m: Cost of a missed object or a false track, positive.
        order: p >= 1; larger weighs outliers more.

    Returns:
        0 for two empty sets, the cut-off if only one is empty.
    """
    few, many = sorted((np.asarray(estimated), np.asarray(true)), key=len)
    if len(many) == 0:
        return 0.0
    if len(few) == 0:
        return cutoff_m
    apart = np.linalg.norm(few[:, None] - many[None], axis=-1)
    cost = np.minimum(apart, cutoff_m) ** order
    rows, columns = linear_sum_assignment(cost)
    left_over = (len(many) - len(few)) * cutoff_m**order
    return float(((cost[rows, columns].sum() + left_over) / len(many)) ** (1.0 / order))
