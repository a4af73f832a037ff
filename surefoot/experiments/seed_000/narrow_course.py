"""The narrow course of Han 2018: gates between polygons and hemispheres, with a goal that moves ahead.

The path through the centres of the gates is 4.96 m, which the paper walks in 124 steps of 0.04 m. All steps from
start to last goal count, including those on the spot. Our cruising speed gives steps of 4.6 cm; the figures `printed_*`
limit them to 4 cm.

Source: Han 2018 (seed 000).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all
from .swarm_walks import PRINTED_MPS, config_of, figures_of

LIMIT_S = 120.0  # ours: 1.5 times 124 steps


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Seeds 0 to n - 1; a run that does not arrive counts with all its steps."""
    configs = [config_of("narrow_course", seed, LIMIT_S, body=body) for seed in range(seeds)]
    configs += [
        config_of("narrow_course", seed, LIMIT_S, PRINTED_MPS, body) for seed in range(seeds)
    ]
    everything = walk_all(configs, say, figures_of)
    found, slow = everything[:seeds], everything[seeds:]

    all_of = partial(column, found)
    slow_steps = column(slow, "footsteps")
    table = ["seed  contacts  clearance  steps  walked m  arrived s"]
    for seed, metrics in enumerate(found):
        table.append(
            f"{seed:4d}  {metrics['contacts']:8.0f}  {1e3 * metrics['min_clearance_m']:6.0f} mm"
            f"  {metrics['footsteps']:5.0f}  {metrics['walked_m']:8.2f}  {metrics['goal3_s']:9.1f}"
        )
    return Outcome(
        {
            "collisions": float(np.sum(all_of("contacts"))),
            "steps": float(np.max(all_of("footsteps"))),
            "steps_median": float(np.median(all_of("footsteps"))),
            "arrived_share": float(np.mean(np.isfinite(all_of("goal3_s")))),
            "min_clearance_mm": 1e3 * float(np.min(all_of("min_clearance_m"))),
            "falls": float(np.sum(all_of("falls"))),
            "printed_steps": float(np.max(slow_steps)),
            "printed_steps_median": float(np.median(slow_steps)),
            "printed_collisions": float(np.sum(column(slow, "contacts"))),
            "walked_m_mean": float(np.mean(all_of("walked_m"))),
        },
        table,
    )


EXPERIMENT = Experiment(
    id="000-E4",
    title="Narrow course of polygons and hemispheres with moving goals (Han 2018)",
    run=run,
    body="kinematic",
    targets={
        "collisions": Target("==", 0.0),
        "steps": Target("<=", 124.0),
        "arrived_share": Target("==", 1.0),
    },
    published={"steps": 124.0},
    seeds=10,
)
