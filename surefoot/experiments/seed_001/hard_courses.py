"""Courses with thirty obstacles, twelve of them moving at up to twice the robot's speed.

Source: ours, after Yoo and Kim 2010 (seed 001), section V-C.
"""

from __future__ import annotations

from ..support.experiment import Experiment, Outcome, Say, Target
from .course_trials import BASELINES, Trial, figures, walk_groups

SCENE = "hard_course"


def run(seeds: int, say: Say, body: str = "kinematic", baselines: bool = True) -> Outcome:
    """Seeds 0 to n - 1 with error-free perception and with sensors; `baselines` on a quarter of them."""
    quarter = max(seeds // 4, 1)
    groups = {
        "error-free perception": [Trial(SCENE, seed, perfect=True) for seed in range(seeds)],
        "sensors": [Trial(SCENE, seed) for seed in range(seeds)],
    }
    peers = BASELINES if baselines else ()
    for name in peers:
        groups[name] = [Trial(SCENE, seed, perfect=True, stepper=name) for seed in range(quarter)]
    found, table = walk_groups(groups, say, body)
    result = figures(found["sensors"]) | figures(found["error-free perception"], "_truth")
    if baselines:
        ours = figures(found["error-free perception"][:quarter])["contacts"]
        fewest = min(figures(found[name])["contacts"] for name in peers)
        result["contacts_over_best_peer_truth"] = ours - fewest
    return Outcome(result, table)


EXPERIMENT = Experiment(
    id="001-hard",
    title="Thirty obstacles, twelve of them moving at 0.05 to 0.20 m/s, in 8 m x 8 m",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share_truth": Target(">=", 0.98),
        "contact_free_share": Target(">=", 0.9),
        "avoidable_contacts": Target("<=", 5.0),
        "arrived_share": Target(">=", 0.95),
        "contacts_over_best_peer_truth": Target("<=", 0.0),
    },
    seeds=100,
)
