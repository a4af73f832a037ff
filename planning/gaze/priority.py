"""Priority of a target by its distance, shared by tracks and untracked targets.

Source: ours, from walks in simulation.
"""

from __future__ import annotations

NEAR_M, FAR_M = 1.2, 2.2
"""Ours, from walks in simulation: up to the first a target counts as near, beyond the second it does not."""

SEEK_MAX = 3.0  # priority of the most overdue target, relative to one that is just due


def nearness(away_m: float) -> float:
    """Share of its priority that a target has at a distance, in [0, 1]."""
    return min(max((FAR_M - away_m) / (FAR_M - NEAR_M), 0.0), 1.0)
