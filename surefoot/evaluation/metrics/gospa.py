"""GOSPA: one distance between tracks and true objects that counts missed objects and false tracks by number.

Unlike OSPA it is not divided by the number of objects, so one false track costs the same among many.

Source: Rahmathullah, Garcia-Fernandez, Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017,
eq. (1) with alpha = 2.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

CUTOFF_M = 0.5  # ours, as of OSPA: a pair further apart is a missed object and a false track
ORDER = 2.0  # ours: p, as the root of a mean square


def gospa(estimated: Float[np.ndarray, "n d"], true: Float[np.ndarray, "m d"]) -> float:
    """Generalised optimal sub-pattern assignment distance of positions, m; either set may be empty."""
    half = CUTOFF_M**ORDER / 2.0
    if not len(estimated) or not len(true):
        return float((half * (len(estimated) + len(true))) ** (1.0 / ORDER))
    apart = np.linalg.norm(estimated[:, None] - true[None], axis=-1)
    cost = np.minimum(apart, CUTOFF_M) ** ORDER
    rows, columns = linear_sum_assignment(cost)
    pairs = cost[rows, columns]
    alone = len(estimated) + len(true) - 2 * len(pairs)
    return float((pairs.sum() + half * alone) ** (1.0 / ORDER))
