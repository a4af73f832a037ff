"""The whole stack among strangers: movers of laws that nothing was made for, from pictures, on both bodies.

Every seed is one walk per judging law of the experiment `prediction` and one with mixed laws; home, hall and office
and the two bodies take turns, so that each law meets all of them. Seeds 0, 1, ... judge; for choosing parameters there
are seeds from 100 on and the development laws. Raw contacts come first: a walk is contact-free only if the body touched
nothing in any frame. The class of a contact is that of the thing touched. NEES are of every instant at which a mover
has a track (4 if honest). `followed_share`: instants with a track among those at which a mover is within 3 m and in
unblocked sight, in whatever direction, also behind the robot.

Source: ours.
"""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from planning.planners.mission import MissionConfig
from sim.movers.law import MIXED, MoversConfig
from sim.truth import FIRST_STATIC_ID

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.consistency import squared
from ...evaluation.metrics.contact_classes import CLASSES
from ...evaluation.metrics.obstacles import track_errors
from ...evaluation.metrics.risk import CLASS_COUNT, RiskTally, risk_metrics, risk_of_run
from ...results.run_folder import RunFolder
from ...run.simulate import scene_of
from ..support.experiment import BODIES, Experiment, Outcome, Say, Target
from ..support.in_sight import Sightlines
from ..support.walks import column, falls_and_contacts, walk_all, walk_figures
from .prediction import JUDGING

LAWS = (*JUDGING, MIXED)
SCENES = ("home", "hall", "office")
LIMIT_S = MissionConfig().time_limit_s
SUMS = tuple(one.name for one in fields(RiskTally))


def config_of(law: str, seed: int, limit_s: float = LIMIT_S) -> Config:
    """Configuration of the walk of a law and a seed, at most `limit_s` long."""
    number = LAWS.index(law) + seed
    scene, body = SCENES[number % len(SCENES)], BODIES[number % len(BODIES)]
    config = on_body(Config(scene=scene, seed=seed, movers=MoversConfig(law)), body)
    return replace(config, mission=replace(config.mission, time_limit_s=limit_s))


def run(seeds: int, say: Say, laws: int = len(LAWS), limit_s: float = LIMIT_S) -> Outcome:
    """Seeds 0 to n - 1 of every law, or of the first few, each walk at most `limit_s` long."""
    chosen = LAWS[:laws]
    todo = [(law, seed) for seed in range(seeds) for law in chosen]
    found = walk_all([config_of(*one, limit_s) for one in todo], say, walked)
    all_of = partial(column, found)
    figures = {"walks": float(len(todo)), "contacts": float(np.sum(all_of("contacts")))}
    figures |= walk_figures(found)
    figures |= {f"contacts_{kind}": float(np.sum(all_of(f"contacts_{kind}"))) for kind in CLASSES}
    anees = {law: _share(_of(found, todo, law), "nees_sum", "nees_count") for law in chosen}
    figures |= {f"mover_anees_{law}": value for law, value in anees.items()}
    figures |= {
        "mover_anees_min": float(np.nanmin(list(anees.values()))),
        "mover_anees_max": float(np.nanmax(list(anees.values()))),
        "followed_share": _share(found, "followed", "near"),
    }
    risk = _risk(found)
    figures |= {name: float(value) for name, value in risk_metrics(risk).items()}
    return Outcome(figures, [*_table(found, todo), *_risk_table(risk)])


def walked(folder: RunFolder, config: Config) -> dict[str, float]:
    """Falls and contacts by class; of the movers nees_sum, nees_count, near, followed (instants); sums of the risk."""
    figures = falls_and_contacts(folder, config)
    risk = risk_of_run(folder)
    if risk is not None:
        figures |= {
            f"risk_{name}_{k}": float(value)
            for name, values in zip(SUMS, risk.sums(), strict=True)
            for k, value in enumerate(values)
        }
    truth, poses = (
        folder.read_csv("truth/obstacles.csv"),
        folder.read_trajectory("truth/trajectory.txt"),
    )
    if truth is None or poses is None:
        return figures
    scene = scene_of(config)
    movers = [str(k + 1) for k in range(len(scene.moving_objects))]
    assert len(movers) < FIRST_STATIC_ID
    errors = track_errors((folder.read_json("obstacles.json") or {}).get("tracks", []), truth)
    nees = squared(errors.whitened_of(movers))
    owned = set(zip(errors.stamps.tolist(), errors.identities, strict=True))
    words, states = truth.words("identity"), truth.matrix("stamp_s", "x_m", "y_m")
    places = np.array([states[[w == mover for w in words]] for mover in movers])
    sight, near, followed = Sightlines(scene), 0, 0
    eyes = dict(zip(poses.stamps.round(6).tolist(), poses.positions[:, :2], strict=True))
    for instant in np.moveaxis(places, 1, 0):
        stamp = float(instant[0, 0])
        eye = eyes.get(round(stamp, 6))
        if eye is None:
            continue
        for mover, seen in zip(movers, sight.near((eye[0], eye[1]), instant[:, 1:]), strict=True):
            near += int(seen)
            followed += int(seen and (stamp, mover) in owned)
    counts = {"nees_sum": nees.sum(), "nees_count": len(nees), "near": near, "followed": followed}
    return figures | {name: float(value) for name, value in counts.items()}


def _risk(found: list[dict[str, Any]]) -> RiskTally:
    """The decisions of all walks."""
    sums = (
        [np.nansum(column(found, f"risk_{name}_{k}")) for k in range(CLASS_COUNT)] for name in SUMS
    )
    return RiskTally(*map(np.array, sums))


def _risk_table(risk: RiskTally) -> list[str]:
    """One line per class of claimed risk."""
    return ["claimed risk of contact with what may move in the next 2.6 s, and what happened"] + [
        f"  {one.decisions:6d} decisions: claimed {one.claimed:.4f}, happened {one.happened:.4f}"
        f" ({one.low:.4f} to {one.high:.4f})"
        for one in risk.classes()
    ]


def _of(found: list[dict[str, Any]], todo: list[tuple[str, int]], law: str) -> list[dict[str, Any]]:
    """The walks of one law."""
    return [one for one, (name, _) in zip(found, todo, strict=True) if name == law]


def _share(found: list[dict[str, Any]], part: str, whole: str) -> float:
    """Ratio of two sums over walks; NaN without any."""
    total = float(np.nansum(column(found, whole)))
    return float(np.nansum(column(found, part))) / total if total else np.nan


def _table(found: list[dict[str, Any]], todo: list[tuple[str, int]]) -> list[str]:
    """One line per walk with a contact, a fall or a goal missed, and one per law."""
    lines = ["walks with a contact, a fall or a goal missed"]
    for one, (law, seed) in zip(found, todo, strict=True):
        if one["contacts"] or one["goals_missed"] or one.get("falls"):
            config = config_of(law, seed)
            kinds = [f"{one[f'contacts_{k}']:.0f} {k}" for k in CLASSES if one.get(f"contacts_{k}")]
            lines.append(
                f"  {law:22} {config.scene:6} seed {seed}, {config.robot.body}: {one['contacts']:.0f} contacts"
                f" ({', '.join(kinds)}), clearance {1e3 * one['min_clearance_m']:.0f} mm,"
                f" goals missed {one['goals_missed']:.0f}, falls {one.get('falls', 0.0):.0f}"
            )
    lines.append(f"{'law':22}  walks  contact-free  arrived   NEES  followed  time s")
    for law in dict.fromkeys(law for law, _ in todo):
        walks = _of(found, todo, law)
        lines.append(
            f"{law:22}  {len(walks):5d}  {np.mean(column(walks, 'contacts') == 0):12.2f}"
            f"  {np.mean(column(walks, 'goals_missed') == 0):7.2f}"
            f"  {_share(walks, 'nees_sum', 'nees_count'):5.1f}"
            f"  {_share(walks, 'followed', 'near'):8.2f}  {np.mean(column(walks, 'duration_s')):6.1f}"
        )
    return lines


EXPERIMENT = Experiment(
    id="strangers",
    title="The whole stack among movers of laws that nothing was made for, from pictures",
    run=run,
    targets={
        "contact_free_share": Target(">=", 0.97),
        "arrived_share": Target(">=", 0.97),
        "mover_anees_max": Target("<=", 6.0),
        "mover_anees_min": Target(">=", 2.0),
        "followed_share": Target(">=", 0.9),
        "risk_in_band": Target("==", 1.0),
    },
    seeds=6,
)
