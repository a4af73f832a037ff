"""GOSPA: one distance between tracks and true objects that counts missed objects and false tracks by number.

Unlike OSPA it is not divided by the number of objects, so one false track costs the same among many.

Source: Rahmathullah, Garcia-Fernandez, Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017,
eq. (1) with alpha = 2.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

CUTOFF_M = 0.5  # ours, as of OSPA: further apart it is another object
ORDER = 2.0  # ours: as the root of a mean square


def gospa(
    estimated: Float[np.ndarray, "n d"],
    true: Float[np.ndarray, "m d"],
    cutoff_m: float = CUTOFF_M,
    order: float = ORDER,
) -> float:
    """Generalised optimal sub-pattern assignment distance, m.

    Args:
        estimated, true: Positions, m; either may be empty.
        cutoff_m: Distance beyond which a pair is a missed object and a false track, positive.
        order: p >= 1.
    """
    half = cutoff_m**order / 2.0
    if not len(estimated) or not len(true):
        return float((half * (len(estimated) + len(true))) ** (1.0 / order))
    apart = np.linalg.norm(estimated[:, None] - true[None], axis=-1)
    cost = np.minimum(apart, cutoff_m) ** order
    rows, columns = linear_sum_assignment(cost)
    pairs = cost[rows, columns]
    alone = len(estimated) + len(true) - 2 * len(pairs)
    return float((pairs.sum() + half * alone) ** (1.0 / order))
