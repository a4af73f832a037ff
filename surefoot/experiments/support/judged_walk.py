"""What a walk among movers says about tracks and predictions: coverage of regions, NEES, followed share, GOSPA."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.obstacle import Obstacle
from planning.safety.ahead import Ahead
from planning.safety.prediction import MotionPatterns
from sim.truth import FIRST_STATIC_ID

from ...config.schema import Config
from ...evaluation.metrics.consistency import squared
from ...evaluation.metrics.gospa import gospa
from ...evaluation.metrics.obstacles import GATE_M, MOVING, TRUE_STATE, TrackErrors, track_errors
from ...evaluation.metrics.regions import in_region
from ...results.tables import Table
from ...run.simulate import scene_of
from .in_sight import Sightlines
from .plain_tracker import ACCELERATION, PlainTracker
from .watched_walk import WatchedInstant, watched_walk

HORIZONS_S = (1.0, 2.0, 4.0)
SHARE = 0.9
RECENT_S = 3.0  # tracks and movers that GOSPA compares were detected within this time
KNEE_M = 0.15  # height at which a mover has to be in the picture
ON_FURNITURE_M = 0.12  # a track nearer to something that stands shows it


@dataclass(frozen=True)
class Judged:
    """Sums over the instants of a walk.

    Args:
        inside, forecasts: At each horizon: truths within their region, and forecasts.
        nees, tracked: Sum of the NEES, and number of instants with a track.
        near, followed: Instants at which a mover is near and in unblocked sight, and those with a track.
        viewed, viewed_followed: The same for movers in the field of view.
        ours_m, plain_m, instants: Sums of GOSPA, and number of instants.
    """

    inside: tuple[float, ...]
    forecasts: tuple[float, ...]
    nees: float
    tracked: float
    near: float
    followed: float
    viewed: float
    viewed_followed: float
    ours_m: float
    plain_m: float
    instants: float

    def __add__(self, other: Judged) -> Judged:
        both: dict[str, Any] = {}
        for name, a in vars(self).items():
            b = getattr(other, name)
            lists = isinstance(a, tuple)
            both[name] = tuple(p + q for p, q in zip(a, b, strict=True)) if lists else a + b
        return Judged(**both)


@dataclass
class _Log:
    """Instants of a walk."""

    stamps: list[float] = field(default_factory=list)
    places: list[np.ndarray] = field(default_factory=list)
    truth: list[tuple[float, ...]] = field(default_factory=list)
    entries: list[dict[str, Any]] = field(default_factory=list)
    forecasts: dict[tuple[float, int], Ahead] = field(default_factory=dict)
    near: list[np.ndarray] = field(default_factory=list)
    viewed: list[np.ndarray] = field(default_factory=list)
    ours: list[float] = field(default_factory=list)
    plain: list[float] = field(default_factory=list)


def judged(config: Config, seconds: float, acceleration: float = ACCELERATION) -> Judged:
    """Walk, track and judge.

    Args:
        config: Scene, seed and laws of the movers.
        seconds: Length of the walk.
        acceleration: Of the plain tracker.
    """
    scene = scene_of(config)
    sight, log = Sightlines(scene), _Log()
    patterns, plain = MotionPatterns(), PlainTracker(config.tracker, acceleration)
    lens = config.robot.tof_camera.camera
    seen_s = np.full(len(scene.moving_objects), -math.inf)
    for one in watched_walk(config, seconds):
        movers = np.array([row[1:3] for row in one.truth if row[0] < FIRST_STATIC_ID])
        eye = (one.pose.x, one.pose.y)
        near = sight.near(eye, movers)
        knees = one.camera.inverse().apply(np.insert(movers, 2, KNEE_M, axis=1))
        viewed = near & (knees[:, 2] > 0.0) & lens.contains(lens.project(knees))
        if one.heard is not None:
            for seen in one.heard.detections:
                apart = np.hypot(*(movers - one.pose.apply(seen.position[None])).T)
                seen_s[apart < GATE_M] = one.stamp_s
            plain.update(one.stamp_s, one.heard.detections, one.heard.robot, one.heard.visible)
        patterns.update([track.gone_straight() for track in one.obstacles])
        _note(log, one, patterns)
        log.places.append(movers)
        log.near.append(near)
        log.viewed.append(viewed)
        lately = seen_s >= one.stamp_s - RECENT_S
        true, unseen = movers[lately], movers[~lately]
        ours = [(t.position, t.seen_s, bool(t.moving > MOVING)) for t in one.obstacles]
        theirs = [(t.mean[:2], t.seen_s, t.moves) for t in plain.tracks]
        log.ours.append(gospa(_counted(ours, one.stamp_s, sight, unseen), true))
        log.plain.append(gospa(_counted(theirs, one.stamp_s, sight, unseen), true))
    return _summed(log, config.seed)


def _note(log: _Log, one: WatchedInstant, patterns: MotionPatterns) -> None:
    """Record tracks, their forecasts and the truth."""
    log.stamps.append(one.stamp_s)
    log.truth += [(one.stamp_s, *map(float, row[:5])) for row in one.truth]
    for track in one.obstacles:
        log.entries.append(_entry(one.stamp_s, track))
        log.forecasts[one.stamp_s, track.track] = Ahead.of(
            track, one.stamp_s, np.array(HORIZONS_S), patterns
        )


def _entry(stamp_s: float, track: Obstacle) -> dict[str, Any]:
    return {
        "stamp": stamp_s,
        "track": track.track,
        "mean": track.state.mean,
        "covariance": track.state.covariance,
        "seen": track.seen_s,
        "moving": track.moving,
    }


def _counted(
    tracks: list[tuple[np.ndarray, float, bool]],
    stamp_s: float,
    sight: Sightlines,
    unseen: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, "n 2"]:
    """Positions of the tracks seen lately.

    Left out are tracks on furniture that do not claim to move, and those on movers that were not detected lately.
    """
    found = []
    for place, seen_s, moves in tracks:
        if seen_s < stamp_s - RECENT_S:
            continue
        if not moves and sight.on_furniture(place, ON_FURNITURE_M):
            continue
        if not (np.hypot(*(unseen - place).T) < GATE_M).any():
            found.append(place)
    return np.array(found).reshape(-1, 2)


def _summed(log: _Log, seed: int) -> Judged:
    errors = errors_of(log.entries, log.truth)
    stamps, places = np.array(log.stamps), np.array(log.places)
    index = {stamp: k for k, stamp in enumerate(log.stamps)}
    movers = range(1, places.shape[1] + 1)
    owned = np.zeros(places.shape[:2], np.bool_)
    rng = np.random.default_rng([seed, 60])
    inside, forecasts = np.zeros(len(HORIZONS_S)), np.zeros(len(HORIZONS_S))
    pairs = zip(errors.stamps.tolist(), errors.identities, errors.tracks, strict=True)
    for stamp, identity, track in pairs:
        mover = int(identity)
        if mover not in movers:
            continue
        owned[index[stamp], mover - 1] = True
        path = places[:, mover - 1]
        for k, horizon in enumerate(HORIZONS_S):
            later = stamp + horizon
            if later > stamps[-1]:
                continue
            true = np.array([np.interp(later, stamps, path[:, axis]) for axis in (0, 1)])
            ahead = log.forecasts[stamp, track]
            parts = (ahead.weights[k], ahead.means[k], ahead.covariances[k])
            inside[k] += in_region(true, *parts, SHARE, rng)
            forecasts[k] += 1
    nees = squared(errors.whitened_of([str(mover) for mover in movers]))
    near, viewed = np.array(log.near), np.array(log.viewed)
    counts = (near.sum(), (near & owned).sum(), viewed.sum(), (viewed & owned).sum())
    sums = (nees.sum(), len(nees), *counts, np.sum(log.ours), np.sum(log.plain), len(stamps))
    return Judged(tuple(inside.tolist()), tuple(forecasts.tolist()), *map(float, sums))


def errors_of(entries: list[dict[str, Any]], truth: list[tuple[float, ...]]) -> TrackErrors:
    """Assigned pairs of tracks and true obstacles, rows (stamp, identity, x, y, vx, vy)."""
    columns = [list(column) for column in zip(*truth, strict=True)]
    names = ("stamp_s", "identity", *TRUE_STATE)
    words = {name: [repr(v) for v in values] for name, values in zip(names, columns, strict=True)}
    words["identity"] = [str(int(v)) for v in columns[1]]
    return track_errors(entries, Table("truth", words))
