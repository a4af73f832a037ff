"""Errors of the robot's pose and of the moving obstacles' tracks, and the consistency of their covariances.

Every seed is another furnished home, body and set of moving obstacles. Several localisers process the same walk of ten
metres: with tags and registration; with registration alone (no markers, so that the start is the origin); by dead
reckoning alone; and, on every fifth seed, with faulty inputs, and with tags alone: by the filter, by a fixed-lag smoother
during the walk (`live_lag`: its newest pose), and by the same ten seconds later (`fixed_lag`). Every fifth seed is also
walked with all errors of body, sensors and tags half and one and a half times as large.

NEES are per degree of freedom: 1 if consistent. Errors within a run are correlated, so each run counts as one sample of
its mean; the band contains the mean of that many samples with 95 % probability.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from perception.filtering.consistency import band
from sim.scenes import catalogue

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.averages import mean, rms
from ...evaluation.metrics.ospa import ospa
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from . import localisation_trial as trials
from .localisation_trial import Fault, TrackerTrial, Trial
from .localisation_walk import LENGTH_M, WalkInstant, walk

FAULTY_EVERY = 5  # one seed in five
LOST_S, DARK_S, JUMP_M, LATE_S, OUTLIERS = 40.0, 10.0, 0.5, 0.05, 0.3
NOISE = (0.5, 1.5)  # of body and sensors, in the noise that the localiser was made for
CUTOFF_M, ORDER = 0.5, 2.0
FAULTS = ("outliers", "blackout", "jump", "clock")

Figures = dict[str, float]


def one_walk(seed: int, body: str = "kinematic", length_m: float = LENGTH_M) -> Figures:
    """All figures of one seed; those of faults only every `FAULTY_EVERY` seeds."""
    config = on_body(Config(), body)
    scene = catalogue.load("home", seed)
    rng = np.random.default_rng([seed, 51])
    start, marks = scene.start, scene.landmarks
    runs = {
        "full": trials.make_trial(start, marks, config, rng),
        "no_tags": trials.make_trial(start, marks, config, rng, landmarks=False),
        "dead_reckoning": trials.make_trial(
            start, marks, config, rng, landmarks=False, registration=False
        ),
    }
    if seed % FAULTY_EVERY == 0:
        runs["tags"] = trials.make_trial(start, marks, config, rng, registration=False)
        runs["live_lag"] = trials.smoothed_live(runs["tags"], marks, config)
        for name, fault in faults(rng).items():
            runs[name] = trials.make_trial(start, marks, config, rng, fault=fault)
    tracking, fell = TrackerTrial(config), False
    for instant in walk(seed, config, length_m=length_m):
        fell = instant.fell
        if not fell:
            step(instant, runs, tracking)
    found = summary(runs, tracking) | {"falls": float(fell)}
    if "tags" in runs:
        for name, key in (("tags", "filter"), ("live_lag", "live_lag")):
            found[f"{key}_rmse_m"] = rms(runs[name].position_m)
            found[f"anees_{key}"] = float(np.mean(runs[name].nees))
        found["fixed_lag_rmse_m"] = rms(trials.fixed_lag_errors(runs["tags"], marks, config))
    return found


def noisy_walk(seed: int, body: str, factor: float) -> Figures:
    """NEES of one seed whose body and sensors have another noise than the localiser was made for."""
    config = on_body(Config(), body)
    scene = catalogue.load("home", seed)
    rng = np.random.default_rng([seed, 52])
    runs = {
        name: trials.make_trial(scene.start, scene.landmarks, config, rng, landmarks=tags)
        for name, tags in (("pose", True), ("no_landmarks", False))
    }
    tracking = TrackerTrial(config)
    for instant in walk(seed, config, factor):
        if not instant.fell:
            step(instant, runs, tracking)
    return {f"anees_{name}_noise_{factor}": mean(one.nees) for name, one in runs.items()}


def faults(rng: np.random.Generator) -> dict[str, Fault]:
    """Faults by name."""
    kinds = (
        trials.outliers(OUTLIERS, rng),
        trials.blackout(LOST_S, DARK_S),
        trials.jump(LOST_S, JUMP_M),
        trials.late(LATE_S),
    )
    return dict(zip(FAULTS, kinds, strict=True))


def step(instant: WalkInstant, runs: dict[str, Trial], tracking: TrackerTrial) -> None:
    """Process one instant with all localisers; the tracker uses the pose of the first."""
    tracks = tracking.obstacles
    for run in runs.values():
        run.step(instant, tracks)
    tracking.step(instant, next(iter(runs.values())).localiser.pose)


def summary(runs: dict[str, Trial], tracking: TrackerTrial) -> Figures:
    """Figures of one walk: root mean squares and mean NEES."""
    full, no_tags, dead_reckoning = runs["full"], runs["no_tags"], runs["dead_reckoning"]
    found = {
        "anees_pose": float(np.mean(full.nees)),
        "anees_no_landmarks": float(np.mean(no_tags.nees)),
        "position_rmse_m": rms(full.position_m),
        "position_rmse_no_landmarks_m": rms(no_tags.position_m),
        "dead_reckoning_rmse_m": rms(dead_reckoning.position_m),
        "heading_rmse_deg": rms(full.heading_deg),
        "heading_rmse_no_landmarks_deg": rms(no_tags.heading_deg),
        "in_view_share": float(np.mean(full.in_view)),
        "anees_obstacle": mean(tracking.nees),
        "anees_obstacle_all": mean(tracking.nees_all),
        "mover_position_rmse_m": rms(tracking.position_m),
        "velocity_rmse_mps": rms(tracking.velocity_mps),
        "ospa_m": mean([ospa(*pair, CUTOFF_M, ORDER) for pair in tracking.places if _any(pair)]),
    }
    for name in FAULTS:
        if name in runs:
            errors = runs[name].position_m
            found[f"{name}_anees"] = float(np.mean(runs[name].nees))
            found[f"{name}_rmse_m"] = rms(errors)
            found[f"{name}_end_m"] = rms(errors[-len(errors) // 10 :])
    return found


def run(
    seeds: int,
    say: Say,
    body: str = "kinematic",
    other_noise: bool = True,
    length_m: float = LENGTH_M,
) -> Outcome:
    """Seeds 0 to n - 1.

    Args:
        seeds: Number of homes.
        say: Takes lines of progress.
        body: Body that walks.
        other_noise: Also walks with more and with less noise than the localiser expects.
        length_m: Of the walks with the usual noise, m.
    """
    found = run_all(one_walk, [(seed, body, length_m) for seed in range(seeds)], say, "walks")
    fallen = [seed for seed, one in enumerate(found) if one["falls"]]
    lines = [f"seed {seed} fell" for seed in fallen]
    noisy: Figures = {}
    if other_noise:
        todo = [(seed, body, factor) for factor in NOISE for seed in range(0, seeds, FAULTY_EVERY)]
        noisy = noise_figures(run_all(noisy_walk, todo, say, "walks with another noise"))
    lines += [f"{name}: {value:.2f}" for name, value in noisy.items()]
    figures = combine(found) | noisy | {"falls": float(len(fallen))}
    return Outcome(figures, [*_table(found), *lines])


def noise_figures(found: list[Figures]) -> Figures:
    """Means over the walks of each factor of the noise, the least and the largest."""
    names = dict.fromkeys(name for one in found for name in one)
    figures = {name: mean([one[name] for one in found if name in one]) for name in names}
    return figures | {
        "noise_anees_min": min(figures.values()),
        "noise_anees_max": max(figures.values()),
    }


def combine(found: list[Figures]) -> Figures:
    """Figures over all walks: root mean squares, means of the NEES, and the consistency bands."""
    figures: Figures = {}
    for name in dict.fromkeys(name for one in found for name in one):
        values = np.array([one[name] for one in found if np.isfinite(one.get(name, math.nan))])
        root = "_rmse_" in name or name.endswith("_end_m")
        figures[name] = rms(values) if root else mean(values)
    for name, degrees in (("pose", 3), ("no_landmarks", 3), ("live_lag", 3), ("obstacle", 4)):
        count = sum(math.isfinite(one.get(f"anees_{name}", math.nan)) for one in found)
        low, high = (bound / degrees for bound in band(degrees, max(count, 1)))
        figures[f"anees_{name}_low"], figures[f"anees_{name}_high"] = low, high
        figures[f"anees_{name}_in_band"] = float(low <= figures[f"anees_{name}"] <= high)
    for name in ("fixed_lag", "live_lag"):
        figures[f"{name}_over_filter"] = figures[f"{name}_rmse_m"] / figures["filter_rmse_m"]
    worst = [one[f"{name}_anees"] for one in found for name in FAULTS if f"{name}_anees" in one]
    ends = [one[f"{name}_end_m"] for one in found for name in FAULTS if f"{name}_end_m" in one]
    figures["faults_anees_max"] = max(figures[f"{name}_anees"] for name in FAULTS)
    figures["faults_end_max_m"] = max(ends)
    figures["faults_runs"] = float(len(worst))
    return figures


def _table(found: list[Figures]) -> Iterator[str]:
    yield "seed   NEES: tags  none  tracks   cm: tags  none  dead   deg: tags  none   mm/s   OSPA cm"
    for seed, one in enumerate(found):
        yield (
            f"{seed:4d}   {one['anees_pose']:10.2f} {one['anees_no_landmarks']:5.2f}"
            f" {one['anees_obstacle']:7.2f}"
            f"   {100 * one['position_rmse_m']:8.2f} {100 * one['position_rmse_no_landmarks_m']:5.2f}"
            f" {100 * one['dead_reckoning_rmse_m']:5.2f}"
            f"   {one['heading_rmse_deg']:9.2f} {one['heading_rmse_no_landmarks_deg']:5.2f}"
            f" {1e3 * one['velocity_rmse_mps']:6.1f} {100 * one['ospa_m']:9.1f}"
        )
    for name in FAULTS:
        rows = [one for one in found if f"{name}_anees" in one]
        yield f"{name:>9}: " + "  ".join(
            f"NEES {one[f'{name}_anees']:.2f}, {100 * one[f'{name}_rmse_m']:.1f} cm, "
            f"at the end {100 * one[f'{name}_end_m']:.1f} cm;"
            for one in rows
        )


def _any(pair: tuple[np.ndarray, np.ndarray]) -> bool:
    return len(pair[0]) + len(pair[1]) > 0


EXPERIMENT = Experiment(
    id="localisation",
    title="Pose and tracks of moving obstacles over walks of 10 m: errors and consistency (NEES per degree of freedom)",
    run=run,
    body="kinematic",
    targets={
        "anees_pose_in_band": Target(">=", 1.0),
        "anees_live_lag_in_band": Target(">=", 1.0),
        "anees_obstacle_in_band": Target(">=", 1.0),
        "position_rmse_m": Target("<=", 0.03),
        "position_rmse_no_landmarks_m": Target("<=", 0.06),
        "heading_rmse_deg": Target("<=", 1.0),
        "velocity_rmse_mps": Target("<=", 0.02),
        "fixed_lag_over_filter": Target("<", 1.0),
        "faults_anees_max": Target("<", 3.0),
        "faults_end_max_m": Target("<=", 0.10),
        "noise_anees_min": Target(">=", 0.4),
        "noise_anees_max": Target("<=", 2.0),
    },
    seeds=50,
)
