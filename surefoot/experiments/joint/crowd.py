"""A unicycle of 2 m/s through a corridor of 6 m with 4, 8 and 12 pedestrians: ours, and planners under the same interface.

The task is printed with DRA-MPPI: social-force pedestrians, constant-velocity predictions, five decisions a second,
100 runs. The length of the way is not printed; here it is 35 m, as in the corridor scenario of that laboratory's
simulator. Pedestrians see the robot, as there; rows `_unseen` have pedestrians that do not.

Chosen on seeds 1000 to 1049: the via point, 12 m ahead. Judged on seeds 0, 1, ...
Published at 12 pedestrians: 98 % safe, 19.9 s; about 100 ms a decision at 4.

Source: Trevisan et al. 2025 (arXiv 2506.21205), section V.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from perception.primitives.robot_model import RobotModel
from planning.safety.guard import Guard
from planning.safety.guard_settings import GuardConfig
from planning.safety.step_filter import StepFilter, Unfiltered

from ...evaluation.metrics.averages import mean
from ...evaluation.metrics.risk import wilson
from ..support.crowd_world import Passage, passage
from ..support.dynamic_window import DynamicWindow
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.mppi import PathIntegral
from ..support.trials import run_all
from ..support.velocity_obstacles import VelocityObstacles

COUNTS = (4, 8, 12)


def ours(robot: RobotModel) -> StepFilter:
    """Our guard."""
    return Guard(GuardConfig(), robot)


def unchecked(robot: RobotModel) -> StepFilter:
    """Straight on."""
    return Unfiltered()


PLANNERS: dict[str, Callable[[RobotModel], StepFilter]] = {
    "ours": ours,
    "dynamic_window": DynamicWindow,
    "velocity_obstacles": VelocityObstacles,
    "mppi": PathIntegral,
    "straight_on": unchecked,
}


def run(seeds: int, say: Say) -> Outcome:
    """Every planner with every number of pedestrians."""
    kinds = [(who, count, True) for who in PLANNERS for count in COUNTS]
    kinds += [(who, COUNTS[-1], False) for who in PLANNERS]
    todo = [(PLANNERS[who], n, sees, seed) for who, n, sees in kinds for seed in range(seeds)]
    walks = run_all(passage, todo, say, "runs")
    figures: dict[str, float] = {}
    lines = ["planner             people  sees us  safe, 95 % band     time     decision p99"]
    for k, (who, count, sees) in enumerate(kinds):
        own = walks[k * seeds : (k + 1) * seeds]
        safe, seconds, worst_ms = _figures(own)
        low, high = wilson(safe, float(seeds))
        name = f"{count}" + ("" if sees else "_unseen") + ("" if who == "ours" else f"_{who}")
        figures |= {f"safe_share_{name}": safe, f"time_s_{name}": seconds}
        lines.append(
            f"{who:20}{count:6}  {'yes' if sees else 'no':7}  {safe:4.2f} ({low:.2f} to {high:.2f})"
            f"  {seconds:6.1f} s  {worst_ms:8.1f} ms"
        )
    mine = [walks[k * seeds : (k + 1) * seeds] for k, kind in enumerate(kinds) if kind[0] == "ours"]
    figures["decision_ms_p99"] = _figures([one for part in mine for one in part])[2]
    return Outcome(figures, lines)


def _figures(runs: Sequence[Passage]) -> tuple[float, float, float]:
    """Share of safe runs that arrived, mean time of these, s, and 99th percentile of the time of a decision, ms."""
    arrived = [one.seconds for one in runs if one.arrived]
    taken = np.concatenate([one.decisions_ms[1:] for one in runs])
    return (
        len(arrived) / len(runs),
        mean(arrived),
        float(np.percentile(taken, 99.0)),
    )


EXPERIMENT = Experiment(
    id="crowd",
    title="A unicycle through a corridor of pedestrians, as printed for DRA-MPPI",
    run=run,
    targets={
        "safe_share_12": Target(">=", 0.98),
        "time_s_12": Target("<=", 20.0),
        "decision_ms_p99": Target("<=", 20.0),
    },
    published={"safe_share_12": 0.98, "time_s_12": 19.9},
    seeds=100,
)
