"""Classes of contacts by what the robot could know of the object that it touched.

A contact with anything that does not move is avoidable, also beside a moving obstacle. A contact with a moving obstacle
belongs to the first class that applies:

- `unseen`: it had not been detected for two seconds;
- `late`: it had been tracked for less than six seconds;
- `reversal`: it had reversed within the last six seconds;
- `avoidable`: all others.

That the robot stood still is no excuse; it is counted beside the classes.

Source: navigation study (classes and their times).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ...results.tables import Table
from .contacts import contact_intervals, nearest_objects
from .obstacles import moving, track_errors

CLASSES = ("unseen", "late", "reversal", "avoidable")
"""Each contact has exactly one."""

STANDING_S, STANDING_M = 1.3, 0.01  # ours: two steps in place; slip and sway stay below 1 cm
UNSEEN_S, LATE_S, REVERSAL_S = 2.0, 6.0, 6.0  # navigation study
LOST_S = 2.0  # ours: after a longer gap without a track, tracking begins anew


@dataclass(frozen=True)
class Contact:
    """One contact of the robot with an object.

    Args:
        stamp_s: Its beginning.
        object_name: Name of the object.
        moves: Whether the object moves.
        unseen_s: Time since its last detection, s; infinite if it was never detected.
        followed_s: Time since its track began, s.
        turned_s: Time since it last reversed, s; infinite if it never did.
        standing: Whether the robot stood still.
    """

    stamp_s: float
    object_name: str
    moves: bool
    unseen_s: float = math.inf
    followed_s: float = 0.0
    turned_s: float = math.inf
    standing: bool = False

    @property
    def kind(self) -> str:
        """One of `CLASSES`."""
        if not self.moves:
            return "avoidable"
        if self.unseen_s > UNSEEN_S:
            return "unseen"
        if self.followed_s < LATE_S:
            return "late"
        return "reversal" if self.turned_s < REVERSAL_S else "avoidable"


def contacts_of_run(
    clearance: Table,
    trajectory: Float[np.ndarray, "n 4"],
    obstacles: Table,
    tracks: list[dict[str, Any]],
) -> list[Contact]:
    """The contacts of a recorded walk, in order.

    Args:
        clearance: Columns stamp_s, clearance_m, object (the name of what was touched).
        trajectory: True poses (stamp, x, y, yaw) of the robot.
        obstacles: True obstacles, columns stamp_s, identity, x_m, y_m, vx_mps, vy_mps, radius_m, name.
        tracks: Entries of obstacles.json.
    """
    stamps, gaps = clearance.numbers("stamp_s"), clearance.numbers("clearance_m")
    found = contact_intervals(stamps, gaps, nearest_objects(clearance))
    if not found:
        return []
    errors = track_errors(tracks, obstacles)
    seen = {(float(one["stamp"]), int(one["track"])): float(one["seen"]) for one in tracks}
    matched = [
        (float(stamp), identity, seen[float(stamp), track])
        for stamp, identity, track in zip(
            errors.stamps, errors.identities, errors.tracks, strict=True
        )
    ]
    movers = movers_by_name(obstacles)
    return [
        _contact(begin, touched, movers.get(touched), trajectory, obstacles, matched)
        for begin, _, touched in found
    ]


def class_counts(contacts: Sequence[Contact]) -> dict[str, float]:
    """Number of contacts of each class, contacts_<class>, and contacts_standing."""
    kinds = [one.kind for one in contacts]
    counts = {f"contacts_{kind}": float(kinds.count(kind)) for kind in CLASSES}
    return counts | {"contacts_standing": float(sum(one.standing for one in contacts))}


def movers_by_name(obstacles: Table) -> dict[str, str]:
    """Name to identity of the obstacles that ever move."""
    moves = set(moving(obstacles))
    named = zip(obstacles.words("name"), obstacles.words("identity"), strict=True)
    return {name: identity for name, identity in named if identity in moves}


def _contact(
    stamp: float,
    name: str,
    mover: str | None,
    trajectory: Float[np.ndarray, "n 4"],
    obstacles: Table,
    matched: list[tuple[float, str, float]],
) -> Contact:
    lately = trajectory[(trajectory[:, 0] <= stamp) & (trajectory[:, 0] >= stamp - STANDING_S)]
    standing = len(lately) > 0 and float(np.ptp(lately[:, 1:3], axis=0).max()) < STANDING_M
    if mover is None:
        return Contact(stamp, name, False, standing=standing)
    turned = stamp - _reversed_at(stamp, mover, obstacles)
    mine = [(at, seen) for at, identity, seen in matched if identity == mover and at <= stamp]
    if not mine:
        return Contact(stamp, name, True, turned_s=turned, standing=standing)
    since = mine[-1][0]
    for at, _ in reversed(mine):
        if since - at > LOST_S:
            break
        since = at
    unseen = stamp - max(seen for _, seen in mine)
    return Contact(stamp, name, True, unseen, stamp - since, turned, standing)


def _reversed_at(stamp: float, mover: str, obstacles: Table) -> float:
    """Time of the last reversal of a moving obstacle; -inf if it has not reversed."""
    rows = [k for k, identity in enumerate(obstacles.words("identity")) if identity == mover]
    states = obstacles.matrix("stamp_s", "vx_mps", "vy_mps")[rows]
    states = states[states[:, 0] <= stamp]
    back = np.einsum("ij,ij->i", states[1:, 1:], states[:-1, 1:]) < 0.0
    return float(states[1:, 0][back].max()) if back.any() else -np.inf
