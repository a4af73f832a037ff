"""The room of Han 2018: three moving robots, five goals that change with time, one camera and no map.

Every seed has other phases of the robots, textures, slip and noise; all runs and all contacts count. Only the first
and the last goal can be reached within their time. For comparison, on the first fifth of the seeds: our planner at the
printed speed, and the published planner (swarm search, prediction by optical flow, no guard).

Source: Han 2018 (seed 000).
"""

from __future__ import annotations

from functools import partial
from itertools import islice

import numpy as np

from ...evaluation.metrics.contact_classes import CLASSES
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all
from .swarm_walks import PRINTED_MPS, config_of, figures_of

LIMIT_S = 300.0  # navigation study: goal 5 takes up to 285 s
FIRST_HOLDS_S = 70.0  # seed 000
FIFTH = 5
NEARER_M = 0.5  # ours: a tenth of the room; body sway is a few centimetres


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Seeds 0 to n - 1."""
    fifth = range(max(1, seeds // FIFTH))
    kinds = {
        "ours": [config_of("robots_room", seed, LIMIT_S, body=body) for seed in range(seeds)],
        "ours, printed speed": [
            config_of("robots_room", seed, LIMIT_S, PRINTED_MPS, body) for seed in fifth
        ],
        "published": [
            config_of("robots_room", seed, LIMIT_S, body=body, version="published")
            for seed in fifth
        ],
    }
    todo = [config for configs in kinds.values() for config in configs]
    walks = iter(walk_all(todo, say, figures_of))
    found = {name: list(islice(walks, len(configs))) for name, configs in kinds.items()}
    rows = {name: _figures(group) for name, group in found.items()}
    figures = dict(rows["ours"])
    for name, prefix in (("ours, printed speed", "printed"), ("published", "published")):
        figures |= {f"{prefix}_{key}": value for key, value in rows[name].items()}
    table = ["seed  contacts  clearance   goal 1 s  goal 5 s  approach to 2, 3, 4 m"]
    for seed, metrics in enumerate(found["ours"]):
        table.append(
            f"{seed:4d}  {metrics['contacts']:8.0f}  {1e3 * metrics['min_clearance_m']:6.0f} mm"
            f"  {metrics['goal1_s']:9.1f}  {metrics['goal5_s']:8.1f}"
            + "".join(f"  {metrics[f'goal{k}_approach_m']:5.2f}" for k in (2, 3, 4))
        )
    table += ["", "planner                runs  contact-free  contacts  goal 1 in time  goal 5"]
    for name, row in rows.items():
        table.append(
            f"{name:<21}  {len(kinds[name]):4d}  {row['contact_free_share']:12.2f}"
            f"  {row['contacts']:8.0f}  {row['goal1_in_time_share']:14.2f}  {row['goal5_share']:6.2f}"
        )
    return Outcome(figures, table)


def _figures(found: list[dict[str, float]]) -> dict[str, float]:
    all_of = partial(column, found)
    first = all_of("goal1_s")
    nearer = np.column_stack([all_of(f"goal{k}_approach_m") for k in (2, 3, 4)])
    return {
        "contact_free_share": float(np.mean(all_of("contacts") == 0)),
        "contacts": float(np.sum(all_of("contacts"))),
        "avoidable_contacts": float(np.sum(all_of("contacts_avoidable"))),
        **{f"contacts_{kind}": float(np.sum(all_of(f"contacts_{kind}"))) for kind in CLASSES},
        "goal1_in_time_share": float(np.mean(first < FIRST_HOLDS_S)),
        "goal5_share": float(np.mean(np.isfinite(all_of("goal5_s")))),
        "approach_share": float(np.mean((nearer > NEARER_M).all(axis=1))),
        "falls": float(np.sum(all_of("falls"))),
        "goal1_s_mean": float(np.nanmean(first)) if np.isfinite(first).any() else np.nan,
        "goal5_s_max": float(np.max(np.nan_to_num(all_of("goal5_s"), nan=np.inf))),
        "min_clearance_mm": 1e3 * float(np.min(all_of("min_clearance_m"))),
        "position_rmse_m": float(np.sqrt(np.mean(all_of("position_rmse_m") ** 2))),
    }


EXPERIMENT = Experiment(
    id="000-E3",
    title="Among three moving robots to five goals in turn, one camera and no map (Han 2018)",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share": Target(">=", 0.97),
        "avoidable_contacts": Target("==", 0.0),
        "goal1_in_time_share": Target(">=", 0.95),
        "goal5_share": Target("==", 1.0),
        "approach_share": Target("==", 1.0),
    },
    seeds=100,
)
