"""The room of Han 2018: three moving robots, five goals that change with time, one camera and no map.

Every seed has other phases of the robots, textures, slip and noise; all runs and all contacts count. Only the first
and the last goal can be reached within their time. Three walkers: the paper's (swarm, flow, steps of 4 cm, no guard) and
ours at the printed speed on the first fifth of the seeds, and ours at its cruising speed on all. On the first twentieth
the same three walk `printed_room`, where every robot starts as printed. The published walker predicts one step, 0.65 s,
and forgets what leaves the picture other than by a lower corner; that is where it is touched.

Source: Han 2018 (seed 000), section 6.5.1, Fig. 9.
"""

from __future__ import annotations

from functools import partial
from itertools import islice

import numpy as np

from ...config.schema import Config
from ...evaluation.metrics.averages import rms
from ...evaluation.metrics.contact_classes import CLASSES
from ..support.columns import Row
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.walks import column, walk_all
from .swarm_walks import PRINTED_MPS, compared, config_of, figures_of

LIMIT_S = 300.0  # navigation study: goal 5 takes up to 285 s
FIRST_HOLDS_S = 70.0  # seed 000
FIFTH, TWENTIETH = 5, 20
NEARER_M = 0.5  # ours: a tenth of the room; body sway is a few centimetres
PAPER = {"contact_free_share": 1.0, "contacts": 0.0}
COLUMNS: tuple[Row, ...] = (
    ("contacts, both at the printed step", 0.0, "published_contacts", "printed_contacts"),
    (
        "  in the room with robots as printed",
        0.0,
        "room_published_contacts",
        "room_printed_contacts",
    ),
    ("walks without contact, share", 1.0, "published_contact_free_share", "contact_free_share"),
    ("first goal within 70 s, share", 1.0, "published_goal1_in_time_share", "goal1_in_time_share"),
    ("last goal reached, share", 1.0, "published_goal5_share", "goal5_share"),
)


def run(seeds: int, say: Say, body: str = "kinematic", limit_s: float = LIMIT_S) -> Outcome:
    """Seeds 0 to n - 1, each walk at most `limit_s` long."""
    fifth, twentieth = max(1, seeds // FIFTH), max(1, seeds // TWENTIETH)
    kinds = {
        "": _walkers("robots_room", (fifth, fifth, seeds), body, limit_s),
        "room_": _walkers("printed_room", (twentieth,) * 3, body, limit_s),
    }
    todo = [c for rooms in kinds.values() for configs in rooms.values() for c in configs]
    walks = iter(walk_all(todo, say, figures_of))
    found = {
        room: {name: list(islice(walks, len(configs))) for name, configs in walkers.items()}
        for room, walkers in kinds.items()
    }
    figures: dict[str, float] = {}
    tables: list[str] = []
    for room, walkers in found.items():
        rows = {name: _figures(group) for name, group in walkers.items()}
        for name, prefix in (("ours", ""), ("ours, 4 cm", "printed_"), ("published", "published_")):
            figures |= {f"{room}{prefix}{key}": value for key, value in rows[name].items()}
        runs = ", ".join(f"{len(group)} {name}" for name, group in walkers.items())
        scene = "printed_room" if room else "robots_room"
        tables += ["", f"{scene}, runs: {runs}", *compared(PAPER, rows)]
    table = ["seed  contacts  clearance   goal 1 s  goal 5 s  approach to 2, 3, 4 m"]
    for seed, metrics in enumerate(found[""]["ours"]):
        table.append(
            f"{seed:4d}  {metrics['contacts']:8.0f}  {1e3 * metrics['min_clearance_m']:6.0f} mm"
            f"  {metrics['goal1_s']:9.1f}  {metrics['goal5_s']:8.1f}"
            + "".join(f"  {metrics[f'goal{k}_approach_m']:5.2f}" for k in (2, 3, 4))
        )
    return Outcome(figures, table + tables, COLUMNS)


def _walkers(
    scene: str, counts: tuple[int, int, int], body: str, limit_s: float
) -> dict[str, list[Config]]:
    """The published walker, ours at the printed step, and ours, each on its number of seeds."""
    of = partial(config_of, scene, limit_s=limit_s, body=body)
    published, printed, ours = (range(count) for count in counts)
    return {
        "published": [of(seed, version="published") for seed in published],
        "ours, 4 cm": [of(seed, cruise_mps=PRINTED_MPS) for seed in printed],
        "ours": [of(seed) for seed in ours],
    }


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
        "position_rmse_m": rms(all_of("position_rmse_m")),
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
        "printed_contacts": Target("==", 0.0),
        "published_contacts": Target("==", 0.0),
        "room_contacts": Target("==", 0.0),
        "room_printed_contacts": Target("==", 0.0),
        "room_published_contacts": Target("==", 0.0),
    },
    published={
        f"{room}{walker}{name}": value
        for room in ("", "room_")
        for walker in ("", "printed_", "published_")
        for name, value in PAPER.items()
    },
    seeds=100,
)
