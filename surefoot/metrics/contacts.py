"""Did it arrive, and did it touch anything on the way: clearance, contacts, path, goal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..run_tables import Table

ARRIVED_M = 0.3  # navigation study: a via point counts as reached when passed within 0.3 m


def contact_intervals(
    stamps: Float[np.ndarray, "n"], clearances: Float[np.ndarray, "n"], things: Sequence[str]
) -> list[tuple[float, float, str]]:
    """Times (from, to, thing) without a gap between robot and thing; a change of thing begins another."""
    intervals: list[tuple[float, float, str]] = []
    touching = ""
    for stamp, clearance, thing in zip(stamps, clearances, things, strict=True):
        now = thing if clearance <= 0.0 else ""
        if now and now == touching:
            intervals[-1] = (intervals[-1][0], float(stamp), thing)
        elif now:
            intervals.append((float(stamp), float(stamp), thing))
        touching = now
    return intervals


def contact_metrics(clearance: Table) -> dict[str, float]:
    """min_clearance_m (negative: depth of the contact), contacts, contact_seconds."""
    stamps, gaps = clearance.numbers("stamp_s"), clearance.numbers("clearance_m")
    intervals = contact_intervals(stamps, gaps, clearance.words("thing"))
    return {
        "min_clearance_m": float(np.nanmin(gaps)),
        "median_clearance_m": float(np.nanmedian(gaps)),
        "contacts": float(len(intervals)),
        "contact_seconds": float(sum(end - begin for begin, end, _ in intervals)),
    }


def walk_metrics(
    stamps: Float[np.ndarray, "n"], positions: Float[np.ndarray, "n d"]
) -> dict[str, float]:
    """duration_s, path_m (length of the way on the floor) and straight_m (from first to last)."""
    steps = np.diff(positions[:, :2], axis=0)
    return {
        "duration_s": float(stamps[-1] - stamps[0]),
        "path_m": float(np.sum(np.linalg.norm(steps, axis=1))),
        "straight_m": float(np.linalg.norm(positions[-1, :2] - positions[0, :2])),
    }


def goal_metrics(
    positions: Float[np.ndarray, "n d"], goals: Sequence[Sequence[float]]
) -> dict[str, float]:
    """How near the true way came to each goal, in their order; the next counts only after the last.

    Returns:
        goals, goals_passed (came within ARRIVED_M), goal_nearest_m (to the first goal not passed, or to
        the last one), goal_final_m (from where it stopped to the last goal).
    """
    if not goals:
        return {}
    begin, passed, nearest = 0, 0, np.inf
    for goal in goals:
        apart = np.linalg.norm(positions[begin:, :2] - np.asarray(goal[:2], float), axis=1)
        nearest = float(np.min(apart))
        within = np.flatnonzero(apart <= ARRIVED_M)
        if len(within) == 0:
            break
        passed, begin = passed + 1, begin + int(within[0])
    last = np.asarray(goals[-1][:2], float)
    return {
        "goals": float(len(goals)),
        "goals_passed": float(passed),
        "goal_nearest_m": nearest,
        "goal_final_m": float(np.linalg.norm(positions[-1, :2] - last)),
    }
