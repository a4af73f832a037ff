"""001-E3: sixteen obstacles, four of them moving, thirty metres through via points; every contact counted.

The courses are walked by geometry (`course_walk`): slow and fast movers with the sensors' view, and with true
perception. The images option walks the first seeds of the slow course from pictures and sets the figures
beside those of the geometric sensor. Peers walk the fast courses in place of the guard.
"""

from __future__ import annotations

import os

from ...evaluation.metrics.contacts import Contact
from ..support.experiment import Experiment, Outcome, Say, Target
from .course_images import image_figures
from .course_trials import HEADER, PAPER_S, Trial, figures, row, try_all

PEERS = ("dynamic window", "velocity obstacles")
IMAGES = "SUREFOOT_IMAGE_SEEDS"
"""Variable of the environment: how many seeds to walk from pictures too (20 take 80 core minutes)."""


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Seeds 0 to n - 1 of slow and fast courses; peers on a quarter of them."""
    quarter = max(seeds // 4, 1)
    kinds = {
        "slow, sensors": [Trial("course", seed) for seed in range(seeds)],
        "fast, sensors": [Trial("fast_course", seed) for seed in range(seeds)],
        "fast, true perception": [
            Trial("fast_course", seed, perfect=True) for seed in range(seeds)
        ],
    }
    for peer in PEERS:
        kinds[f"fast, sensors: {peer}"] = [
            Trial("fast_course", seed, stepper=peer) for seed in range(quarter)
        ]
    walks = try_all([trial for trials in kinds.values() for trial in trials], say, body)
    table, found, begin = [HEADER], {}, 0
    for name, trials in kinds.items():
        found[name] = walks[begin : begin + len(trials)]
        begin += len(trials)
        table.append(row(name, found[name]))
    result = figures(found["slow, sensors"])
    result |= figures(found["fast, sensors"], "_fast")
    truth = figures(found["fast, true perception"], "_truth")
    result |= {
        name: truth[name]
        for name in ("contact_free_share_truth", "falls_truth", "time_s_mean_truth")
    }
    ours = figures(found["fast, sensors"][:quarter])
    peers = {peer: figures(found[f"fast, sensors: {peer}"]) for peer in PEERS}
    fewest = min(p["contacts"] for p in peers.values())
    result["contacts_over_best_peer"] = ours["contacts"] - fewest
    for peer, theirs in peers.items():
        ratio = ours["time_s_mean"] / theirs["time_s_mean"]
        result[f"time_over_{peer.replace(' ', '_')}"] = ratio
    for name, trials in kinds.items():
        for trial, one in zip(trials, found[name], strict=True):
            table += [f"  {name}, seed {trial.seed}: {_told(contact)}" for contact in one.contacts]
    images = int(os.environ.get(IMAGES, "0"))
    if images:
        seen, lines = image_figures(images, found["slow, sensors"][:images], say, body)
        result |= seen
        table += lines
    return Outcome(result, table)


def _told(contact: Contact) -> str:
    return (
        f"{contact.stamp_s:6.1f} s {contact.object_name}: {contact.kind}, unseen for {contact.unseen_s:.1f} s, "
        f"followed for {contact.followed_s:.0f} s, turned {contact.turned_s:.1f} s ago"
        + (", robot standing" if contact.standing else "")
    )


EXPERIMENT = Experiment(
    id="001-E3",
    title="Sixteen obstacles, four of them moving, a course of 30 m through via points",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share": Target(">=", 0.97),
        "avoidable_contacts": Target("==", 0.0),
        "contact_free_share_fast": Target(">=", 0.80),
        "avoidable_contacts_fast": Target("<=", 2.0),
        "contact_free_share_truth": Target(">=", 0.99),
        "arrived_share": Target(">=", 0.99),
        "on_time_share": Target(">=", 0.90),
        "contacts_over_best_peer": Target("<=", 0.0),
        "cycle_ms_p99": Target("<=", 5.0),
    },
    published={"time_s_mean": PAPER_S},
    seeds=100,
)
