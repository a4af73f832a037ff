"""A goal upstairs, reached from sensors alone: walks of `surefoot simulate storeys`, judged by their truth.

A Unitree G1 with a kinematic body, its depth camera, gyro and joints, without landmarks: nothing of the scene is known to it but
its start and the place of the goal. Arrived is who says so and truly stands within half a metre of the goal; the map is right
where the floors differ in height as they truly do.

Parameters were chosen on seeds 0 to 51, and walks of seeds 2000 to 2089 were looked into; judged are seeds from 2090.

Source: ours.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...config.presets import fitted
from ...config.schema import Config
from ...evaluation.evaluate import evaluate
from ...progress import silent
from ...results.run_folder import RunFolder
from ...run.loop import Cycle
from ...run.simulate import simulate
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.trials import run_all
from .stairs_walk import ROBOT

FIRST_SEED, SCENE = 2090, "storeys"
NEAR_M = 0.5  # from the goal to where the robot truly stands


@dataclass(frozen=True)
class Walk:
    """One walk: its figures, whether it arrived, and its times of a footstep, ms: room for the body, and search."""

    seed: int
    arrived: bool
    figures: dict[str, float]
    room_ms: tuple[float, ...]
    plan_ms: tuple[float, ...]


def walk(seed: int) -> Walk:
    """One walk."""
    config = fitted(Config(scene=SCENE, robot=ROBOT, seed=seed))
    times: dict[str, list[float]] = {"room": [], "plan": []}

    def note(cycle: Cycle) -> None:
        for stage, ms in ({} if cycle.decision is None else cycle.decision.timing_ms).items():
            times[stage].append(ms)

    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "run"
        summary = simulate(config, out, False, silent, report=False, watch=note)
        run = RunFolder.open(summary.folder)
        figures = {k: v for k, v in evaluate(run).items() if isinstance(v, (int, float))}
    figures["fell"] = float(summary.fell_at_s is not None)
    arrived = summary.succeeded and figures["goal_final_m"] <= NEAR_M
    return Walk(seed, arrived, figures, tuple(times["room"]), tuple(times["plan"]))


def run(seeds: int, say: Say) -> Outcome:
    """One walk per seed."""
    walks = run_all(walk, [(FIRST_SEED + k,) for k in range(seeds)], say, "walks")
    return Outcome(summary(walks), table(walks))


def summary(walks: list[Walk]) -> dict[str, float]:
    """Shares, sums and worst of all walks."""

    def each(name: str) -> np.ndarray:
        return np.array([one.figures.get(name, np.nan) for one in walks])

    return {
        "arrived_share": float(np.mean([one.arrived for one in walks])),
        "contacts": float(each("contacts").sum()),
        "feet_on_edges": float(each("feet_on_edges").sum()),
        "feet_struck": float(each("feet_struck").sum()),
        "fell": float(each("fell").sum()),
        "floor_error_max_m": float(each("floor_error_max_m").max()),
        "floor_nees": float(np.nanmean(each("floor_nees"))),
        "position_error_final_max_m": float(each("goal_final_m").max()),
        "clearance_min_m": float(each("min_clearance_m").min()),
        "pose_nees": float(np.nanmean(each("pose_anees")) / 3.0),
        "footsteps": float(each("footsteps").sum()),
        "room_ms_p99": float(np.percentile([t for one in walks for t in one.room_ms], 99)),
        "plan_ms_p99": float(np.percentile([t for one in walks for t in one.plan_ms], 99)),
    }


def table(walks: list[Walk]) -> list[str]:
    """One line a walk."""
    lines = ["seed  arrived  to the goal, m  footsteps  least clearance, m  floors differ by, mm"]
    for one in walks:
        f = one.figures
        lines.append(
            f"{one.seed:4d}  {'yes' if one.arrived else 'no':<7} {f.get('goal_final_m', np.nan):14.2f} {f.get('footsteps', 0):10.0f} "
            f"{f.get('min_clearance_m', np.nan):18.2f} {1000 * f.get('floor_error_max_m', np.nan):20.1f}"
        )
    return lines


EXPERIMENT = Experiment(
    id="storeys",
    title="A goal upstairs by depth images and joints alone: who arrives, contacts, and both floors in the map",
    run=run,
    targets={
        "arrived_share": Target("==", 1.0),
        "contacts": Target("==", 0.0),
        "feet_on_edges": Target("==", 0.0),
        "fell": Target("==", 0.0),
        "floor_error_max_m": Target("<=", 0.02),
    },
    seeds=10,
)
