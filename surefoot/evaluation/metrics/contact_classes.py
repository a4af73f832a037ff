"""Classes of contacts by what the robot could know of the object it touched.

A contact belongs to the first class that applies, in this order:

- `standing`: the robot stood still;
- `unseen`: the moving object had not been detected for two seconds;
- `late`: it had been tracked for less than six seconds;
- `reversal`: it had reversed within the last four seconds;
- `other`: it had reversed four to six seconds before;
- `avoidable`: all other contacts, including every contact with a static object.

Source: navigation study (classes and their times).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from ...results.tables import Table
from .contacts import contact_intervals, nearest_objects
from .obstacles import moving, track_errors

CLASSES = ("standing", "unseen", "late", "reversal", "other", "avoidable")
STANDING_S, STANDING_M = 1.3, 0.01  # ours: two steps in place; slip and sway stay below 1 cm
UNSEEN_S, LATE_S, REVERSAL_S, STEADY_S = 2.0, 6.0, 4.0, 6.0  # navigation study
LOST_S = 2.0  # ours: after a longer gap without a track, tracking begins anew


def contact_classes(
    clearance: Table,
    trajectory: Float[np.ndarray, "n 4"],
    obstacles: Table,
    tracks: list[dict[str, Any]],
) -> list[tuple[float, str, str]]:
    """Time, object and class of each contact, in order.

    Args:
        clearance: Columns stamp_s, clearance_m, object.
        trajectory: True poses (stamp, x, y, yaw) of the robot.
        obstacles: True obstacles, columns stamp_s, identity, x_m, y_m, vx_mps, vy_mps, radius_m.
        tracks: Entries of obstacles.json.
    """
    stamps, gaps = clearance.numbers("stamp_s"), clearance.numbers("clearance_m")
    contacts = contact_intervals(stamps, gaps, nearest_objects(clearance))
    if not contacts:
        return []
    errors = track_errors(tracks, obstacles)
    seen = {(float(one["stamp"]), int(one["track"])): float(one["seen"]) for one in tracks}
    matched = [
        (float(stamp), identity, seen[float(stamp), track])
        for stamp, identity, track in zip(
            errors.stamps, errors.identities, errors.tracks, strict=True
        )
    ]
    found = []
    for begin, _, touched in contacts:
        mover = _mover(begin, trajectory, obstacles)
        kind = "avoidable"
        if mover is not None:
            kind = _kind(begin, mover, trajectory, obstacles, matched)
        found.append((begin, touched, kind))
    return found


def class_counts(classes: list[tuple[float, str, str]]) -> dict[str, float]:
    """Number of contacts of each class: contacts_<class>."""
    kinds = [kind for _, _, kind in classes]
    return {f"contacts_{kind}": float(kinds.count(kind)) for kind in CLASSES}


def _mover(stamp: float, trajectory: Float[np.ndarray, "n 4"], obstacles: Table) -> str | None:
    """The moving obstacle that touched the robot; None if all are too far away."""
    x, y = trajectory[np.argmin(np.abs(trajectory[:, 0] - stamp)), 1:3]
    states = obstacles.matrix("stamp_s", "x_m", "y_m", "radius_m")
    movers = moving(obstacles)
    nearest, found = 0.15, None  # half the diagonal of the robot with its swing foot, m
    for row, identity in enumerate(obstacles.words("identity")):
        at, ox, oy, radius = states[row]
        if identity in movers and abs(at - stamp) < 1e-6:
            gap = float(np.hypot(ox - x, oy - y) - radius)
            if gap < nearest:
                nearest, found = gap, identity
    return found


def _kind(
    stamp: float,
    mover: str,
    trajectory: Float[np.ndarray, "n 4"],
    obstacles: Table,
    matched: list[tuple[float, str, float]],
) -> str:
    lately = trajectory[(trajectory[:, 0] <= stamp) & (trajectory[:, 0] >= stamp - STANDING_S)]
    if len(lately) and np.ptp(lately[:, 1:3], axis=0).max() < STANDING_M:
        return "standing"
    mine = [(at, seen) for at, identity, seen in matched if identity == mover and at <= stamp]
    if not mine or stamp - max(seen for _, seen in mine) > UNSEEN_S:
        return "unseen"
    since = mine[-1][0]
    for at, _ in reversed(mine):
        if since - at > LOST_S:
            break
        since = at
    if stamp - since < LATE_S:
        return "late"
    steady = stamp - _reversed_at(stamp, mover, obstacles)
    if steady < STEADY_S:
        return "reversal" if steady < REVERSAL_S else "other"
    return "avoidable"


def _reversed_at(stamp: float, mover: str, obstacles: Table) -> float:
    """Time of the last reversal of a moving obstacle; -inf if it has not reversed."""
    rows = [k for k, identity in enumerate(obstacles.words("identity")) if identity == mover]
    states = obstacles.matrix("stamp_s", "vx_mps", "vy_mps")[rows]
    states = states[states[:, 0] <= stamp]
    back = np.einsum("ij,ij->i", states[1:, 1:], states[:-1, 1:]) < 0.0
    return float(states[1:, 0][back].max()) if back.any() else -np.inf
