"""The whole stack in the furnished home among moving people, on the dynamic body.

Like the experiment `home`, but with simulated servos, soles and gravity, odometry from footstep to footstep, and
cameras that sway with the head. Every contact counts; its class says whether the robot could have avoided it.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from planning.planners.mission import MissionConfig

from ...config.presets import on_body
from ...config.schema import Config
from ...evaluation.metrics.contact_classes import CLASSES
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import ROW, column, falls_and_contacts, row, walk_all, walk_figures


def config_of(
    seed: int, body: str = "dynamic", limit_s: float = MissionConfig.time_limit_s
) -> Config:
    """Configuration of a walk in the home of a seed with a body."""
    mission = MissionConfig(time_limit_s=limit_s)
    return on_body(Config(scene="home", seed=seed, mission=mission), body)


def run(
    seeds: int, say: Say, body: str = "dynamic", limit_s: float = MissionConfig.time_limit_s
) -> Outcome:
    """Seeds 0 to n - 1, each walk at most `limit_s` long."""
    found = walk_all(
        [config_of(seed, body, limit_s) for seed in range(seeds)], say, falls_and_contacts
    )
    all_of = partial(column, found)
    figures = walk_figures(found) | {
        "contacts": float(np.sum(all_of("contacts"))),
        "avoidable_contacts": float(np.sum(all_of("contacts_avoidable"))),
    }
    figures |= {f"contacts_{kind}": float(np.sum(all_of(f"contacts_{kind}"))) for kind in CLASSES}
    rows = [f"{seed:4d}  {row(metrics)}" for seed, metrics in enumerate(found)]
    return Outcome(figures, [f"seed  {ROW}", *rows])


EXPERIMENT = Experiment(
    id="INT-1",
    title="The whole stack at home among moving people, on the dynamic body",
    run=run,
    body="dynamic",
    targets={
        "contact_free_share": Target(">=", 0.95),
        "avoidable_contacts": Target("==", 0.0),
        "arrived_share": Target(">=", 0.95),
        "falls": Target("==", 0.0),
    },
    seeds=20,
)
