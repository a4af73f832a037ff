"""The referee on RGB-D odometry: a leaderboard of accuracy and honesty, conformal regions, and our failure alarm.

Leaderboard: `leaderboard`, on the shared recordings and on Replica's office rendered with sensor noise.

Conformal: the score of a frame is the error of its motion since the frame before, whitened by the claimed covariance
(by the same 1 cm and 0.5 deg everywhere, where a method claims none). The first half of a recording gives the
radius of the 90 % region of each method, the second half tests it. Motions are taken because their errors are nearly
independent; those of poses are not, and no region fitted to a part of a trajectory would hold on the rest. The coverage
is that over all recordings; in a single one it is higher or lower, as the table says. Chance moves it too, by the motions
that it is fitted on as much as by those it is tested on: by 1.3 % (one deviation) with four noises on four different sets
of Replica's views if motions are independent. Where a method fails in bursts they are not, and chance moves it more;
the table says how many motions count as one.

Alarm: weights and threshold were chosen on the first half of Replica's trajectory and on 7-Scenes' sweep
(`perception.odometry.alarm`); this reports on its second half, 7-Scenes' pan and TUM's cabinet, with other breaks.

Source: ours; Lei et al. 2018 (split conformal prediction).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from perception.filtering.consistency import chi_square_quantile
from perception.primitives.errors import InputError
from perception.primitives.frame import Frame

from ...evaluation.metrics.calibration import (
    SHARE,
    conformal_radius,
    correlation_time,
    coverage_sigma,
)
from ...evaluation.metrics.consistency import squared, whitened
from ...recordings.open import open_recording
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Part, Say, Target, combined
from .leaderboard import METHODS, WITHOUT, Track, row, tracked
from .odometry import SETS
from .odometry_alarm import Broken, alarms
from .replica_room import ReplicaRoom

REPLICA_EVERY = 4  # of the 2000 poses; all of them would take the peers an hour
PLAIN = np.array([0.01] * 3 + [math.radians(0.5)] * 3)
"""Of methods without covariances; only the ratio counts."""
SHORTEST = 15  # motions in half a recording; with fewer no radius is known
LEAST = 200
"""Motions in the second halves: chance moves the coverage by 3 % (one deviation) or less."""


def run(seeds: int, say: Say, sets: int = len(SETS) + 1) -> Outcome:
    """The recordings once; Replica with the noise of every seed, and the alarms.

    Args:
        seeds: Number of noises of Replica, each on views of its own.
        say: Takes lines of progress.
        sets: Only the first recordings; without Replica no alarms either.
    """
    frames: dict[str, list[Frame]] = {}
    missing = []
    for name, folder in list(SETS.items())[:sets]:
        try:
            frames[name] = list(open_recording(real_data.folder(folder)).frames())
        except InputError as error:
            missing.append(f"{name:<16} {error}")
    room = ReplicaRoom(real_data.folder("replica_office0")) if sets > len(SETS) else None
    tracks: dict[str, list[Track]] = {name: [] for name in METHODS}
    parts: list[Part] = [({}, missing)]
    for seed in range(seeds):
        shown = {} if seed else dict(frames)
        if room is not None:
            rng, first = np.random.default_rng(seed), seed % REPLICA_EVERY
            shown["replica"] = list(room.frames(rng, REPLICA_EVERY, first))
        for recording, given in shown.items():
            for method in METHODS:
                say(f"{recording}: {method}")
                track = tracked(method, given, calibrated=recording == "replica")
                figures, line = row(recording, method, track)
                parts.append((figures, [line]))
                if track is not None:
                    tracks[method].append(track)
    parts.append(conformal(tracks))
    if room is not None:
        parts.append(alarms(_to_break(frames, room), np.random.default_rng(1), say))
    return combined(*parts)


def conformal(tracks: dict[str, list[Track]]) -> Part:
    """Coverage of the 90 % regions on the second halves, by method."""
    figures: dict[str, float] = {}
    table = []
    exact = math.sqrt(chi_square_quantile(SHARE, 6))
    for method, found in tracks.items():
        halves = [pair for pair in map(_halves, found) if min(map(len, pair)) >= SHORTEST]
        if not halves:
            continue
        claims = any(track.claims for track in found)
        held = [second <= conformal_radius(first) for first, second in halves]
        inside = float(np.mean(np.concatenate(held)))
        claimed = float(np.mean(np.concatenate([second <= exact for _, second in halves])))
        count, each = sum(map(len, held)), [float(np.mean(one)) for one in held]
        outside = [
            half > conformal_radius(first) for first, second in halves for half in (first, second)
        ]
        alike = correlation_time(outside)
        chance = coverage_sigma(sum(len(first) for first, _ in halves), count)
        chance *= math.sqrt(alike)
        table.append(
            f"{method:<12} 90 % regions of {count} motions: {inside:.1%} inside the conformal ones (chance +-{chance:.1%}, "
            f"{alike:.1f} motions count as one, of single recordings {min(each):.0%} to {max(each):.0%}), "
            + (f"{claimed:.1%} inside the claimed ones" if claims else WITHOUT)
        )
        if count >= LEAST:
            figures[f"{method}_conformal_90"] = inside
            figures |= {f"{method}_claimed_90": claimed} if claims else {}
    every = [value for name, value in figures.items() if name.endswith("_conformal_90")]
    figures["conformal_90_min"] = min(every, default=float("nan"))
    figures["conformal_90_max"] = max(every, default=float("nan"))
    return figures, table


def _halves(track: Track) -> tuple[Float[np.ndarray, "a"], Float[np.ndarray, "b"]]:
    """Whitened lengths of the errors of the motions of the first and of the second half."""
    errors, claims = track.steps()
    half = len(errors) // 2
    if not track.claims:
        claims = np.broadcast_to(np.diag(PLAIN**2), claims.shape)
    scores = np.sqrt(squared(whitened(errors, claims)))
    first, second = scores[:half], scores[half:]
    return first[np.isfinite(first)], second[np.isfinite(second)]


def _to_break(frames: dict[str, list[Frame]], room: ReplicaRoom) -> Iterator[Broken]:
    """The recordings that the alarm was not chosen on."""
    for name, longest in (("sevenscenes_pan", 8), ("tum_fr3_cabinet", 6)):
        if name in frames:
            yield Broken(name, frames[name], 8, 10, longest)
    for every, apart in ((5, 40), (2, 80), (1, 250)):
        shown = list(room.frames(np.random.default_rng(100 + every), every, len(room.poses) // 2))
        yield Broken(f"replica 1/{every}", shown, 20, apart, 10)


EXPERIMENT = Experiment(
    id="referee",
    title="RGB-D odometry of Surefoot and its peers: accuracy, honesty, conformal regions, failure alarm",
    run=run,
    targets={
        "conformal_90_min": Target(">=", 0.87),
        "conformal_90_max": Target("<=", 0.93),
        "alarm_recall": Target(">=", 0.9),
        "alarm_false_per_1000": Target("<=", 2.0),
    },
    seeds=4,
)
