"""Clearance, contacts, path length, and goals reached."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from planning.commands import WalkCommand

from ...results.tables import Table

REACHED_M = 0.3  # navigation study: a via point counts as reached within 0.3 m


def contact_intervals(
    stamps: Float[np.ndarray, "n"], clearances: Float[np.ndarray, "n"], objects: Sequence[str]
) -> list[tuple[float, float, str]]:
    """Contacts as (begin, end, object), s; contact with another object begins a new one."""
    intervals: list[tuple[float, float, str]] = []
    touching = ""
    for stamp, clearance, nearest in zip(stamps, clearances, objects, strict=True):
        now = nearest if clearance <= 0.0 else ""
        if now and now == touching:
            intervals[-1] = (intervals[-1][0], float(stamp), nearest)
        elif now:
            intervals.append((float(stamp), float(stamp), nearest))
        touching = now
    return intervals


def nearest_objects(clearance: Table) -> list[str]:
    """Name of the nearest object in each row of clearance.csv; older runs name the column "thing"."""
    return clearance.words("object" if "object" in clearance.columns else "thing")


def contact_metrics(clearance: Table) -> dict[str, float]:
    """min_clearance_m (negative: penetration), median_clearance_m, contacts, contact_seconds.

    A sample stands for half of the time to the one before and half of that to the one after.
    """
    stamps, gaps = clearance.numbers("stamp_s"), clearance.numbers("clearance_m")
    intervals = contact_intervals(stamps, gaps, nearest_objects(clearance))
    between = np.diff(stamps, prepend=stamps[:1], append=stamps[-1:])
    return {
        "min_clearance_m": float(np.nanmin(gaps)),
        "median_clearance_m": float(np.nanmedian(gaps)),
        "contacts": float(len(intervals)),
        "contact_seconds": float(np.sum((between[:-1] + between[1:])[gaps <= 0.0]) / 2.0),
    }


def walk_metrics(
    stamps: Float[np.ndarray, "n"],
    positions: Float[np.ndarray, "n d"],
    sessions: Sequence[Bool[np.ndarray, "n"]] = (),
) -> dict[str, float]:
    """duration_s, path_m (length of the path) and straight_m (distance from first to last), in the dimensions given.

    Of several sessions, duration and path are the sums over them, without the way from one to the next.
    """
    parts = sessions or [np.ones(len(stamps), bool)]
    steps = np.concatenate([np.diff(positions[mine], axis=0) for mine in parts])
    return {
        "duration_s": float(sum(np.ptp(stamps[mine]) for mine in parts)),
        "path_m": float(np.sum(np.linalg.norm(steps, axis=1))),
        "straight_m": float(np.linalg.norm(positions[-1] - positions[0])),
    }


def goal_metrics(
    positions: Float[np.ndarray, "n d"], goals: Sequence[Sequence[float]]
) -> dict[str, float]:
    """Goals reached by the true trajectory in their order; a goal counts only after the one before it.

    Returns:
        goals, goals_passed (within REACHED_M), goal_nearest_m (smallest distance to the first goal not
        reached, or to the last one), goal_final_m (distance of the final position from the last goal).
    """
    if not goals:
        return {}
    begin, passed, nearest = 0, 0, np.inf
    for goal in goals:
        apart = np.linalg.norm(positions[begin:, :2] - np.asarray(goal[:2], float), axis=1)
        nearest = float(np.min(apart))
        within = np.flatnonzero(apart <= REACHED_M)
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


BODY_RADIUS_M = 0.15  # S_r, seed 001


class Touch:
    """Objects that the robot touches at present, and whether it stands."""

    def __init__(self) -> None:
        self._touched: set[int] = set()
        self.standing = True

    def step(self, command: WalkCommand) -> None:
        """Take the present footstep."""
        self.standing = command.forward_m == 0.0 and command.lateral_m == 0.0

    def begun(self, gaps_m: Mapping[int, float], apart_m: float) -> list[int]:
        """Objects whose contact begins at this instant.

        Args:
            gaps_m: Clearance of each object.
            apart_m: Clearance that ends a contact (hysteresis).
        """
        new = [key for key, gap in gaps_m.items() if gap <= 0.0 and key not in self._touched]
        self._touched |= set(new)
        self._touched -= {key for key, gap in gaps_m.items() if gap > apart_m}
        return new
