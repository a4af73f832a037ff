"""Priority of a target of the gaze, by its distance or by how overdue a look is.

Source: ours, from walks in simulation.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

NEAR_M, FAR_M = 1.2, 2.2
"""Ours, from walks in simulation: up to the first a target counts as near, beyond the second it does not."""

SEEK_MAX = 3.0  # priority of the most overdue target, relative to one that is just due


def nearness(away_m: float) -> float:
    """Share of its priority that a target has at a distance, in [0, 1]."""
    return min(max((FAR_M - away_m) / (FAR_M - NEAR_M), 0.0), 1.0)


def overdue(share: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Priority of targets out of sight for a share of the time after which a look is due: its square, at most `SEEK_MAX`."""
    return np.minimum(share**2, SEEK_MAX)
