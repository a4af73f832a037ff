"""The narrow course of Han 2018: gates between polygons and hemispheres, with a goal that moves ahead.

The path through the centres of the gates is 4.96 m, which the paper walks in 124 steps of 0.04 m. All steps from
start to last goal count, including those on the spot. Three walkers: the paper's (swarm, flow, steps of 4 cm, no guard),
ours at the printed step, and ours at its cruising speed of 4.6 cm per step. `step_mm` is the mean way of a step over
the floor. A step of 40 mm advances 38: feet slip by 1.2 mm, the first step looks and the second is half a one. The way
of 4.90 m to the last goal's tolerance then takes 128 steps; 124 at the printed step would need feet that do not slip.

Source: Han 2018 (seed 000), section 6.5.2, Fig. 10.
"""

from __future__ import annotations

from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from ..support.columns import Row
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all
from .swarm_walks import PRINTED_MPS, compared, config_of, figures_of

LIMIT_S = 120.0  # ours: 1.5 times 124 steps
PAPER = {"collisions": 0.0, "steps": 124.0, "step_mm": 40.0}
COLUMNS: tuple[Row, ...] = (
    ("contacts of all walks", PAPER["collisions"], "published_collisions", "collisions"),
    ("steps, largest number", PAPER["steps"], "published_steps", "steps"),
    ("  ours at the printed step", PAPER["steps"], "", "printed_steps"),
    ("way of a step, mm", PAPER["step_mm"], "published_step_mm", "step_mm"),
    ("walks that arrive, share", 1.0, "published_arrived_share", "arrived_share"),
)


def run(seeds: int, say: Say, body: str = "kinematic", limit_s: float = LIMIT_S) -> Outcome:
    """Seeds 0 to n - 1, each walk at most `limit_s` long; one that does not arrive counts with all its steps."""
    of = partial(config_of, "narrow_course", limit_s=limit_s, body=body)
    kinds = {
        "published": [of(seed, version="published") for seed in range(seeds)],
        "ours, 4 cm": [of(seed, cruise_mps=PRINTED_MPS) for seed in range(seeds)],
        "ours": [of(seed) for seed in range(seeds)],
    }
    walks = iter(walk_all([c for configs in kinds.values() for c in configs], say, figures_of))
    found = {name: list(islice(walks, seeds)) for name in kinds}
    rows = {name: _figures(group) for name, group in found.items()}
    figures = dict(rows["ours"])
    for name, prefix in (("ours, 4 cm", "printed"), ("published", "published")):
        figures |= {f"{prefix}_{key}": value for key, value in rows[name].items()}
    table = ["seed  contacts  clearance  steps  walked m  arrived s"]
    for seed, metrics in enumerate(found["ours"]):
        table.append(
            f"{seed:4d}  {metrics['contacts']:8.0f}  {1e3 * metrics['min_clearance_m']:6.0f} mm"
            f"  {metrics['footsteps']:5.0f}  {metrics['walked_m']:8.2f}  {metrics['goal3_s']:9.1f}"
        )
    return Outcome(figures, [*table, "", *compared(PAPER, rows)], COLUMNS)


def _figures(found: list[dict[str, Any]]) -> dict[str, float]:
    all_of = partial(column, found)
    steps, walked = all_of("footsteps"), all_of("walked_m")
    return {
        "collisions": float(np.sum(all_of("contacts"))),
        "steps": float(np.max(steps)),
        "steps_median": float(np.median(steps)),
        "arrived_share": float(np.mean(np.isfinite(all_of("goal3_s")))),
        "min_clearance_mm": 1e3 * float(np.min(all_of("min_clearance_m"))),
        "falls": float(np.sum(all_of("falls"))),
        "walked_m_mean": float(np.mean(walked)),
        "step_mm": 1e3 * float(np.mean(walked / steps)),
    }


EXPERIMENT = Experiment(
    id="000-E4",
    title="Narrow course of polygons and hemispheres with moving goals (Han 2018)",
    run=run,
    body="kinematic",
    targets={
        "collisions": Target("==", 0.0),
        "steps": Target("<=", 124.0),
        "arrived_share": Target("==", 1.0),
        "printed_collisions": Target("==", 0.0),
        "printed_steps": Target("<=", 124.0),
        "published_collisions": Target("==", 0.0),
        "published_steps": Target("<=", 124.0),
        "published_arrived_share": Target("==", 1.0),
    },
    published={
        f"{prefix}{name}": value
        for prefix in ("", "printed_", "published_")
        for name, value in PAPER.items()
    },
    seeds=10,
)
