"""Did it arrive, and did it touch anything on the way: clearance, contacts and their classes, path, goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planning.commands import WalkCommand

from ...results.tables import Table

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


BODY_RADIUS_M = 0.15  # S_r, seed 001
UNSEEN_S, LATE_S = 2.0, 6.0  # navigation study: classes of contacts
LONG_AGO_S = 6.0  # the same: a reversal as long ago as this explains nothing
CLASSES = ("avoidable", "unseen", "late", "reversal", "other")
"""Of contacts; each has exactly one. Beside it a contact may be one of a standing robot."""


@dataclass(frozen=True)
class Contact:
    """One contact, from its beginning to its end.

    Args:
        stamp_s: Beginning.
        thing: What was touched.
        moves: Whether it moves.
        unseen_s: Time since it was seen last, s; infinite: never seen.
        followed_s: Time since it was first seen, without being lost in between, s.
        turned_s: Time since it last reversed, s; infinite for what stands.
        standing: Whether the robot stood.
        kind: One of `CLASSES`.
    """

    stamp_s: float
    thing: str
    moves: bool
    unseen_s: float
    followed_s: float
    turned_s: float
    standing: bool
    kind: str = "other"


def class_of(contact: Contact) -> str:
    """Why it may have come to a contact.

    Avoidable: followed for 6 s, seen within 2 s, and no reversal within 6 s; what stands and was ever
    seen is avoidable in any case. Else, in this order, unseen, late, or soon after a reversal.

    Source: navigation study.
    """
    seen = contact.unseen_s <= UNSEEN_S
    if not contact.moves:
        return "avoidable" if np.isfinite(contact.unseen_s) else "unseen"
    if seen and contact.followed_s >= LATE_S and contact.turned_s >= LONG_AGO_S:
        return "avoidable"
    if not seen:
        return "unseen"
    if contact.followed_s < LATE_S:
        return "late"
    return "reversal" if contact.turned_s < LONG_AGO_S else "other"


class Touch:
    """Which things are being touched, and whether the robot stands."""

    def __init__(self) -> None:
        self._touched: set[int] = set()
        self.standing = True

    def step(self, command: WalkCommand) -> None:
        """The footstep that is made now."""
        self.standing = command.forward_m == 0.0 and command.lateral_m == 0.0

    def begun(self, gaps_m: Mapping[int, float], apart_m: float) -> list[int]:
        """Things whose contact begins at this instant.

        Args:
            gaps_m: By thing.
            apart_m: Gap at which a contact is over, so that one touch does not count twice.
        """
        new = [thing for thing, gap in gaps_m.items() if gap <= 0.0 and thing not in self._touched]
        self._touched |= set(new)
        self._touched -= {thing for thing, gap in gaps_m.items() if gap > apart_m}
        return new
