"""Tracks against the true obstacles: who is who at every instant, and how wrong.

A track is of the thing that it was last seen on. At each instant tracks and true obstacles of one another are
paired so that the sum of their distances is smallest. Tracks of things that the truth does not list are not
judged, however near a listed one passes by; one that has lost its thing is, wherever it has gone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from ...results.tables import Table
from .consistency import consistency_metrics, whitened
from .ospa import ospa
from .trajectory import rms

GATE_M = 0.2  # ours: two radii of a mover; what is seen further apart is another thing
FAR_M = 1e3  # so that a pair that may not be never breaks one that may
NOBODY = ""
BELIEVED = 0.5  # probability of moving above which a track counts as a mover
MOVES_MPS = 0.005  # ours: below this over the whole run a thing stands

TRUE_STATE = ("x_m", "y_m", "vx_mps", "vy_mps")


@dataclass(frozen=True)
class TrackErrors:
    """Matched pairs of all instants, one row each.

    Args:
        stamps: s.
        identities: Of the true obstacle.
        tracks: Number of the track.
        errors: Estimated minus true (x, y, vx, vy), m and m/s.
        whitened: These in units of their own covariance.
        present: For each true obstacle, at how many instants it could have been matched: from the first
            instant of the run on.
    """

    stamps: Float[np.ndarray, "n"]
    identities: tuple[str, ...]
    tracks: tuple[int, ...]
    errors: Float[np.ndarray, "n 4"]
    whitened: Float[np.ndarray, "n 4"]
    present: dict[str, int]

    def whitened_of(self, wanted: Collection[str]) -> Float[np.ndarray, "m 4"]:
        """Those of these true obstacles, thing by thing: what follows in time follows in order."""
        names = np.array(self.identities, dtype=object)
        return np.concatenate(
            [np.zeros((0, 4)), *(self.whitened[names == name] for name in wanted)]
        )


def track_errors(tracks: list[dict[str, Any]], truth: Table) -> TrackErrors:
    """Pair the tracks of a run with the true obstacles.

    Args:
        tracks: Entries with stamp, track, mean (4), covariance (4 x 4), and whether it was seen in this frame
            (if not told: it was), as obstacles.json lists them.
        truth: Columns stamp_s, identity, x_m, y_m, vx_mps, vy_mps.
    """
    by_stamp: dict[float, list[dict[str, Any]]] = defaultdict(list)
    for entry in tracks:
        by_stamp[float(entry["stamp"])].append(entry)
    true_states, identities = truth.matrix(*TRUE_STATE), truth.words("identity")
    true_rows: dict[float, list[int]] = defaultdict(list)
    for row, stamp in enumerate(truth.numbers("stamp_s")):
        true_rows[float(stamp)].append(row)
    present: dict[str, int] = defaultdict(int)
    found: list[tuple[float, str, int, np.ndarray, np.ndarray]] = []
    owners: dict[int, str] = {}
    for stamp in sorted(true_rows):
        rows, entries = true_rows[stamp], by_stamp.get(stamp, [])
        for row in rows:
            present[identities[row]] += 1
        if not entries:
            continue
        means = np.array([entry["mean"] for entry in entries], dtype=np.float64)
        apart = np.linalg.norm(means[:, None, :2] - true_states[None, rows, :2], axis=-1)
        for entry, gaps in zip(entries, apart, strict=True):
            nearest = int(np.argmin(gaps))
            if entry.get("seen", True):
                owners[int(entry["track"])] = (
                    identities[rows[nearest]] if gaps[nearest] < GATE_M else NOBODY
                )
        own = np.array(
            [[owners.get(int(e["track"])) == identities[r] for r in rows] for e in entries]
        )
        for i, j in _pairs(apart, own):
            covariance = np.array(entries[i]["covariance"], dtype=np.float64)
            error = means[i] - true_states[rows[j]]
            found.append((stamp, identities[rows[j]], int(entries[i]["track"]), error, covariance))
    errors = np.array([f[3] for f in found]).reshape(-1, 4)
    covariances = np.array([f[4] for f in found]).reshape(-1, 4, 4)
    return TrackErrors(
        np.array([f[0] for f in found], dtype=np.float64),
        tuple(f[1] for f in found),
        tuple(f[2] for f in found),
        errors,
        whitened(errors, covariances),
        dict(present),
    )


def moving(truth: Table) -> tuple[str, ...]:
    """Identities of the true obstacles that move at some time, in order of appearance."""
    velocities = truth.matrix("vx_mps", "vy_mps")
    fast = np.linalg.norm(velocities, axis=1) > MOVES_MPS
    words = truth.words("identity")
    return tuple(dict.fromkeys(word for word, is_fast in zip(words, fast, strict=True) if is_fast))


def obstacle_metrics(tracks: list[dict[str, Any]], truth: Table) -> dict[str, float | bool]:
    """Figures of the obstacles that move (mover_...) and of those that stand (standing_...).

    Returns:
        For each kind that exists: <kind>_count; _followed_share (of all instants, those with a track on
        it; a thing behind a wall counts as missed); and, where any was followed,
        <kind>_position_rmse_m, _velocity_rmse_mps, _track_changes (times the track on a thing changed its
        number), and the consistency figures of the NEES. ospa_m where something moves.
    """
    errors = track_errors(tracks, truth)
    movers = moving(truth)
    figures: dict[str, float | bool] = {}
    for kind, wanted in (
        ("mover", movers),
        ("standing", tuple(i for i in errors.present if i not in movers)),
    ):
        if not wanted:
            continue
        chosen = np.array([identity in wanted for identity in errors.identities], dtype=bool)
        instants = sum(errors.present[identity] for identity in wanted)
        figures[f"{kind}_count"] = float(len(wanted))
        figures[f"{kind}_followed_share"] = float(chosen.sum() / instants)
        if not chosen.any():
            continue
        e = errors.errors[chosen]
        figures |= {
            f"{kind}_position_rmse_m": rms(np.linalg.norm(e[:, :2], axis=1)),
            f"{kind}_velocity_rmse_mps": rms(np.linalg.norm(e[:, 2:], axis=1)),
            f"{kind}_track_changes": float(_changes(errors, wanted)),
        }
        figures |= consistency_metrics(errors.whitened_of(wanted), kind)
    if movers:
        figures["ospa_m"] = float(np.mean(ospa_over_time(tracks, truth)[1]))
    return figures


def ospa_over_time(
    tracks: list[dict[str, Any]], truth: Table
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Instants, s, and the OSPA distance between what is believed to move and what does, m.

    A mover out of sight counts as missed, standing furniture believed to move as invented.
    """
    movers = set(moving(truth))
    believed: dict[float, list[list[float]]] = defaultdict(list)
    for entry in tracks:
        if entry.get("moving", 1.0) > BELIEVED:
            believed[float(entry["stamp"])].append(entry["mean"][:2])
    places, words = truth.matrix("x_m", "y_m"), truth.words("identity")
    true: dict[float, list[np.ndarray]] = {}
    for stamp, word, place in zip(truth.numbers("stamp_s"), words, places, strict=True):
        at = true.setdefault(float(stamp), [])
        if word in movers:
            at.append(place)
    stamps = sorted(true)
    values = [
        ospa(np.array(believed[s]).reshape(-1, 2), np.array(true[s]).reshape(-1, 2)) for s in stamps
    ]
    return np.array(stamps), np.array(values)


def _pairs(
    apart: Float[np.ndarray, "n m"], allowed: Bool[np.ndarray, "n m"]
) -> list[tuple[int, int]]:
    rows, columns = linear_sum_assignment(np.where(allowed, apart, FAR_M))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if allowed[i, j]]


def _changes(errors: TrackErrors, wanted: tuple[str, ...]) -> int:
    changes = 0
    for identity in wanted:
        numbers = [
            t for t, i in zip(errors.tracks, errors.identities, strict=True) if i == identity
        ]
        changes += sum(a != b for a, b in pairwise(numbers))
    return changes
