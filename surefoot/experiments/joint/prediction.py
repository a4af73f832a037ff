"""Tracks and predictions of movers that follow other laws than any part was made for.

A robot walks a given route and glances around (`support.watched_walk`); the pipeline sees the movers through its
time-of-flight camera. Per law of the movers: the share of instants at which a mover 1, 2 and 4 s later is inside the
region of 90 % of the mixture predicted for its track; the NEES of its state (4 if honest); and GOSPA beside a plain
constant-velocity tracker on the same detections. All instants with a track count, in view or not. GOSPA compares the
tracks and the movers that were detected within the last 3 s; a track on furniture counts if it claims to move. `followed` is the share of instants with a track among those at which a mover is within 3 m and in
unblocked sight, in whatever direction; `in view` where it also is in the field of view.

Development: to and fro, waypoints and curves, seeds 100, 101, ...; parameters are chosen on these alone. Judging: all
other laws, seeds 0, 1, ...; scenes in turn: hall, home, office. Extremes are over all laws.

Source: ours.
"""

from __future__ import annotations

import numpy as np

from sim.movers.law import LAWS, MoversConfig
from sim.scene import TO_AND_FRO

from ...config.schema import Config
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.judged_walk import HORIZONS_S, Judged, judged
from ..support.trials import run_all

DEVELOPMENT = (TO_AND_FRO, "waypoints", "curves")
JUDGING = tuple(law for law in LAWS if law not in DEVELOPMENT)
DEVELOPMENT_SEED = 100
SCENES = ("hall", "home", "office")
SECONDS = 100.0  # somebody who stands for a minute walks before the end


def config_of(law: str, seed: int) -> Config:
    """Configuration of a walk among movers of a law; to and fro they need a scene that has some."""
    scenes = SCENES[:2] if law == TO_AND_FRO else SCENES
    return Config(scene=scenes[seed % len(scenes)], seed=seed, movers=MoversConfig(law))


def run(seeds: int, say: Say, seconds: float = SECONDS) -> Outcome:
    """Every law with n seeds."""
    todo = [(law, seed + DEVELOPMENT_SEED) for law in DEVELOPMENT for seed in range(seeds)]
    todo += [(law, seed) for law in JUDGING for seed in range(seeds)]
    walks = run_all(judged, [(config_of(*one), seconds) for one in todo], say, "walks")
    found: dict[str, Judged] = {}
    for (law, _), walk in zip(todo, walks, strict=True):
        found[law] = found[law] + walk if law in found else walk
    figures = {
        name: value for law, one in found.items() for name, value in of_law(law, one).items()
    }
    ratios = np.array([figures[f"gospa_ratio_{law}"] for law in found])
    covered = [figures[f"coverage_90_{law}_{t:.0f}s"] for law in found for t in HORIZONS_S]
    anees = [figures[f"mover_anees_{law}"] for law in found]
    figures |= {
        "coverage_90_min": float(np.min(covered)),
        "coverage_90_max": float(np.max(covered)),
        "mover_anees_min": float(np.min(anees)),
        "mover_anees_max": float(np.max(anees)),
        "followed_share": _ratio(sum(w.followed for w in walks), sum(w.near for w in walks)),
        "gospa_ratio_max": float(ratios.max()),
        "gospa_gain_mean": float(1.0 - ratios.mean()),
    }
    return Outcome(figures, table(found, seeds))


def of_law(law: str, one: Judged) -> dict[str, float]:
    """Figures of one law; NaN where nothing was seen."""
    figures = {
        f"coverage_90_{law}_{t:.0f}s": _ratio(one.inside[k], one.forecasts[k])
        for k, t in enumerate(HORIZONS_S)
    }
    return figures | {
        f"mover_anees_{law}": _ratio(one.nees, one.tracked),
        f"followed_share_{law}": _ratio(one.followed, one.near),
        f"gospa_ratio_{law}": _ratio(one.ours_m, one.plain_m),
    }


def _ratio(part: float, whole: float) -> float:
    """NaN where nothing was seen, as in a short walk."""
    return part / whole if whole else np.nan


def table(found: dict[str, Judged], seeds: int) -> list[str]:
    """One line per law."""
    lines = [
        f"{'law':22}  90 % region holds 1, 2, 4 s   NEES  followed  in view  GOSPA  plain tracker"
    ]
    for law, one in found.items():
        if law == DEVELOPMENT[0]:
            lines.append(f"development, seeds {DEVELOPMENT_SEED} to {DEVELOPMENT_SEED + seeds - 1}")
        if law == JUDGING[0]:
            lines.append(f"judging, seeds 0 to {seeds - 1}")
        figures = list(of_law(law, one).values())
        lines.append(
            f"{law:22}  {figures[0]:8.2f} {figures[1]:6.2f} {figures[2]:6.2f}  {figures[3]:12.1f}"
            f"  {figures[4]:8.2f}  {one.viewed_followed / max(one.viewed, 1.0):7.2f}"
            f"  {_ratio(one.ours_m, one.instants):5.3f} m  {_ratio(one.plain_m, one.instants):5.3f} m"
        )
    return lines


EXPERIMENT = Experiment(
    id="prediction",
    title="Tracks and predictions of movers by law, also laws that nothing was chosen on",
    run=run,
    targets={
        "coverage_90_min": Target(">=", 0.85),
        "coverage_90_max": Target("<=", 0.95),
        "mover_anees_min": Target(">=", 2.0),
        "mover_anees_max": Target("<=", 6.0),
        "gospa_ratio_max": Target("<=", 1.0),
        "gospa_gain_mean": Target(">=", 0.2),
    },
    seeds=6,
)
