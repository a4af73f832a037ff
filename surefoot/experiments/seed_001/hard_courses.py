"""001-hard: thirty obstacles, twelve of them moving at up to twice the robot's speed."""

from __future__ import annotations

from ..support.experiment import Experiment, Outcome, Say, Target
from .course_trials import HEADER, Trial, figures, row, try_all
from .moving_courses import PEERS

SCENE = "hard_course"


def run(seeds: int, say: Say, body: str = "kinematic") -> Outcome:
    """Seeds 0 to n - 1 with true perception and from the sensors; peers on a quarter of them."""
    quarter = max(seeds // 4, 1)
    kinds = {
        "true perception": [Trial(SCENE, seed, perfect=True) for seed in range(seeds)],
        "sensors": [Trial(SCENE, seed) for seed in range(seeds)],
    }
    for peer in PEERS:
        kinds[f"true perception: {peer}"] = [
            Trial(SCENE, seed, perfect=True, stepper=peer) for seed in range(quarter)
        ]
    walks = try_all([trial for trials in kinds.values() for trial in trials], say, body)
    table, found, begin = [HEADER], {}, 0
    for name, trials in kinds.items():
        found[name] = walks[begin : begin + len(trials)]
        begin += len(trials)
        table.append(row(name, found[name]))
    result = figures(found["sensors"]) | figures(found["true perception"], "_truth")
    ours = figures(found["true perception"][:quarter])
    peers = [figures(found[f"true perception: {peer}"]) for peer in PEERS]
    result["contacts_over_best_peer_truth"] = ours["contacts"] - min(p["contacts"] for p in peers)
    return Outcome(result, table)


EXPERIMENT = Experiment(
    id="001-hard",
    title="Thirty obstacles, twelve of them moving at 0.05 to 0.20 m/s, in 8 x 8 m",
    run=run,
    body="kinematic",
    targets={
        "contact_free_share_truth": Target(">=", 0.92),
        "avoidable_contacts": Target("<=", 5.0),
        "arrived_share": Target(">=", 0.95),
        "contacts_over_best_peer_truth": Target("<=", 0.0),
    },
    seeds=100,
)
