"""Tracks against true obstacles: association at every instant, and errors.

A track belongs to the true obstacle that its last detection was nearest to. At each instant, tracks are assigned
to their obstacles so that the sum of distances is smallest. A track of an object that the truth does not list is
not judged, even near a listed obstacle; a track that has lost its obstacle is judged wherever it is.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from ...results.tables import Table
from .averages import rms
from .consistency import consistency_metrics, whitened
from .ospa import ospa

GATE_M = 0.2  # ours: two radii of a moving obstacle; a detection further away is another object
FORBIDDEN_M = 1e3  # cost of a forbidden pair, larger than any sum of allowed ones
UNLISTED = ""
MOVING = 0.5  # probability of moving above which a track counts as moving
STATIC_MPS = 0.005  # ours: an obstacle that is never faster is static

TRUE_STATE = ("x_m", "y_m", "vx_mps", "vy_mps")


@dataclass(frozen=True)
class TrackErrors:
    """Assigned pairs of track and true obstacle at all instants, one row each.

    Args:
        stamps: s.
        identities: Identity of the true obstacle.
        tracks: Number of the track.
        errors: Estimated minus true (x, y, vx, vy), m and m/s.
        whitened: The errors, whitened by their covariance.
        present: Number of instants at which each true obstacle exists.
        owners: Number of a track to the true obstacles that its detections were nearest to, "" for one that the truth
            does not list.
    """

    stamps: Float[np.ndarray, "n"]
    identities: tuple[str, ...]
    tracks: tuple[int, ...]
    errors: Float[np.ndarray, "n 4"]
    whitened: Float[np.ndarray, "n 4"]
    present: dict[str, int]
    owners: dict[int, set[str]]

    def whitened_of(self, wanted: Collection[str]) -> Float[np.ndarray, "m 4"]:
        """Whitened errors of some true obstacles, obstacle by obstacle, each in order of time."""
        names = np.array(self.identities, dtype=object)
        return np.concatenate(
            [np.zeros((0, 4)), *(self.whitened[names == name] for name in wanted)]
        )


def track_errors(tracks: list[dict[str, Any]], truth: Table) -> TrackErrors:
    """Assign the tracks of a run to the true obstacles.

    Args:
        tracks: Entries of obstacles.json: stamp, track, mean (4), covariance (4x4) and seen, the stamp of
            the last detection (default: this frame).
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
    ever: dict[int, set[str]] = defaultdict(set)
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
            if float(entry.get("seen", stamp)) >= stamp:
                owners[int(entry["track"])] = (
                    identities[rows[nearest]] if gaps[nearest] < GATE_M else UNLISTED
                )
                ever[int(entry["track"])].add(owners[int(entry["track"])])
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
        dict(ever),
    )


def likeliest_moving(entries: Iterable[Mapping[str, Any]]) -> dict[int, float]:
    """Track number to its probability of moving: the larger of those at its end and at its last detection.

    Args:
        entries: Entries of obstacles.json: stamp, track, moving and seen.
    """
    by_track: dict[int, list[Mapping[str, Any]]] = defaultdict(list)
    for entry in entries:
        if entry.get("moving") is not None:
            by_track[int(entry["track"])].append(entry)
    found = {}
    for track, rows in by_track.items():
        last = max(rows, key=lambda row: float(row["stamp"]))
        detected = [row for row in rows if row.get("seen", row["stamp"]) >= row["stamp"]]
        seen = max(detected, key=lambda row: float(row["stamp"]), default=last)
        found[track] = max(float(last["moving"]), float(seen["moving"]))
    return found


def moving(truth: Table) -> tuple[str, ...]:
    """Identities of the true obstacles that ever move, in order of appearance."""
    velocities = truth.matrix("vx_mps", "vy_mps")
    fast = np.linalg.norm(velocities, axis=1) > STATIC_MPS
    words = truth.words("identity")
    return tuple(dict.fromkeys(word for word, is_fast in zip(words, fast, strict=True) if is_fast))


def obstacle_metrics(tracks: list[dict[str, Any]], truth: Table) -> dict[str, float | bool]:
    """Figures of moving and static obstacles.

    Returns:
        For each kind that exists, with the prefix moving_obstacle or static_obstacle: _count; _tracked_share
        (instants with an assigned track; an occluded obstacle counts as missed); and, if any was tracked,
        _position_rmse_m, _velocity_rmse_mps, _track_changes (how often the track of an obstacle changed its
        number), and the consistency figures of the NEES. ospa_m if any obstacle moves. false_movers: tracks that
        count as moving and whose detections were never nearest to anything that moves.
    """
    errors = track_errors(tracks, truth)
    movers = moving(truth)
    figures: dict[str, float | bool] = {}
    for kind, wanted in (
        ("moving_obstacle", movers),
        ("static_obstacle", tuple(i for i in errors.present if i not in movers)),
    ):
        if not wanted:
            continue
        chosen = np.array([identity in wanted for identity in errors.identities], dtype=bool)
        instants = sum(errors.present[identity] for identity in wanted)
        figures[f"{kind}_count"] = float(len(wanted))
        figures[f"{kind}_tracked_share"] = float(chosen.sum() / instants)
        if not chosen.any():
            continue
        e = errors.errors[chosen]
        figures |= {
            f"{kind}_position_rmse_m": rms(np.linalg.norm(e[:, :2], axis=1)),
            f"{kind}_velocity_rmse_mps": rms(np.linalg.norm(e[:, 2:], axis=1)),
            f"{kind}_track_changes": float(_changes(errors, wanted)),
        }
        figures |= consistency_metrics(errors.whitened_of(wanted), kind)
    figures["false_movers"] = float(
        sum(
            probability > MOVING and not errors.owners.get(track, set()) & set(movers)
            for track, probability in likeliest_moving(tracks).items()
        )
    )
    if movers:
        figures["ospa_m"] = float(np.mean(ospa_over_time(tracks, truth)[1]))
    return figures


def ospa_over_time(
    tracks: list[dict[str, Any]], truth: Table
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Instants, s, and the OSPA distance between the tracks classified as moving and the moving obstacles, m.

    An occluded moving obstacle counts as missed, a static object classified as moving as a false track.
    """
    movers = set(moving(truth))
    estimated: dict[float, list[list[float]]] = defaultdict(list)
    for entry in tracks:
        if entry.get("moving", 1.0) > MOVING:
            estimated[float(entry["stamp"])].append(entry["mean"][:2])
    positions, words = truth.matrix("x_m", "y_m"), truth.words("identity")
    true: dict[float, list[np.ndarray]] = {}
    for stamp, word, position in zip(truth.numbers("stamp_s"), words, positions, strict=True):
        present = true.setdefault(float(stamp), [])
        if word in movers:
            present.append(position)
    stamps = sorted(true)
    values = [
        ospa(np.array(estimated[s]).reshape(-1, 2), np.array(true[s]).reshape(-1, 2))
        for s in stamps
    ]
    return np.array(stamps), np.array(values)


def _pairs(
    apart: Float[np.ndarray, "n m"], allowed: Bool[np.ndarray, "n m"]
) -> list[tuple[int, int]]:
    rows, columns = linear_sum_assignment(np.where(allowed, apart, FORBIDDEN_M))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if allowed[i, j]]


def _changes(errors: TrackErrors, wanted: tuple[str, ...]) -> int:
    changes = 0
    for identity in wanted:
        numbers = [
            t for t, i in zip(errors.tracks, errors.identities, strict=True) if i == identity
        ]
        changes += sum(a != b for a, b in pairwise(numbers))
    return changes
