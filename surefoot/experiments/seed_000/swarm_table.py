"""Particle swarm search with 20, 30 and 50 particles and 50, 100 and 150 epochs, compared with the exact optimum.

Each cycle is another random room with cylinders. The gap is how much farther from the goal the swarm's pixel is than
the optimum, m; a forbidden pixel, or none, counts as 1000 m. The exact search is compared with an evaluation of every
pixel. The printed penalties of 1 are also measured: how often their optimum is a forbidden pixel.

Source: Han 2018 (seed 000), section 6.4 and eq. (9).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from perception.primitives.pose import Pose2
from planning.swarm import random_floors, search
from planning.swarm.objective import PRINTED, Objective, ObjectiveConfig

from ..support.columns import Row
from ..support.experiment import Experiment, Outcome, Say, Target

PARTICLES, EPOCHS = (20, 30, 50), (50, 100, 150)  # seed 000, section 6.4
CHOSEN = (50, 100)  # seed 000
MISSED_M = 0.05  # specification
DEFAULT = "spread"  # the most accurate mode
COLUMNS: tuple[Row, ...] = (
    ("optimum missed by more than 5 cm, share", None, "missed_share_literal", f"missed_share_{DEFAULT}"),
    ("time of a search, ms; ours is exact", None, "ms_literal", "exact_ms"),
)  # fmt: skip
PRINTED_CYCLES = 20  # cycles of the printed objective; each takes a second


def run(seeds: int, say: Say) -> Outcome:
    """Cycles 0 to n - 1."""
    floors = [random_floors.make(np.random.default_rng([2, k])) for k in range(seeds)]
    objectives = [_objective(f, ObjectiveConfig()) for f in floors]
    search.exact(objectives[0])  # compile before timing
    began = time.process_time()
    best = [search.exact(o) for o in objectives]
    exact_ms = 1e3 * (time.process_time() - began) / seeds
    optimum = np.array([np.inf if b is None else b.value for b in best])
    say("exact search done; evaluating every pixel")
    every = [search.brute_force(o) for o in objectives]
    least = np.array([np.inf if b is None else b.value for b in every])
    exact_gaps = _gaps(optimum, least)
    figures = {"gap_m_max": float(np.max(exact_gaps)), "exact_ms": exact_ms}
    table = [
        "mode          particles  epochs   gap m p50    p85    p95      max  missed > 5 cm     ms"
    ]
    for mode in search.MODES:
        for particles in PARTICLES:
            for epochs in EPOCHS:
                config = search.SwarmConfig(mode, particles, epochs)
                gaps, spent_ms = _swarm_gaps(objectives, least, config)
                table.append(
                    f"{mode:<14}{particles:9d}{epochs:8d}{_measured_columns(gaps, spent_ms)}"
                )
                if (particles, epochs) == CHOSEN:
                    missed = float(np.mean(gaps > MISSED_M))
                    figures |= {f"missed_share_{mode}": missed, f"ms_{mode}": spent_ms}
                    if mode == DEFAULT:
                        p85, p95 = np.percentile(gaps, [85, 95])
                        figures |= {"gap_m_p85": float(p85), "gap_m_p95": float(p95)}
        say(f"{mode}: done")
    table.append(f"{'exact':<31}{_measured_columns(exact_gaps, exact_ms)}")
    figures["printed_forbidden_share"] = _forbidden_share(floors[:PRINTED_CYCLES], objectives)
    return Outcome(figures, table, COLUMNS)


def _measured_columns(gaps: np.ndarray, spent_ms: float) -> str:
    """The measured columns of a table row."""
    p50, p85, p95 = np.percentile(gaps, [50, 85, 95])
    missed = 100 * np.mean(gaps > MISSED_M)
    return f"{p50:12.3f}{p85:7.3f}{p95:7.3f}{np.max(gaps):9.3f}{missed:13.1f} %{spent_ms:8.2f}"


def _objective(floor: random_floors.RandomFloor, config: ObjectiveConfig) -> Objective:
    return Objective.of(
        floor.movable, floor.camera, floor.T_body_camera, Pose2(), floor.goal, config
    )


def _swarm_gaps(
    objectives: list[Objective], optimum: np.ndarray, config: search.SwarmConfig
) -> tuple[np.ndarray, float]:
    """Gap of each cycle, m, and mean processor time of a cycle, ms."""
    began = time.process_time()
    found = [
        search.fly(objective, config, np.random.default_rng([2, 1, k])).value
        for k, objective in enumerate(objectives)
    ]
    spent_ms = 1e3 * (time.process_time() - began) / len(objectives)
    return _gaps(np.array(found), optimum), spent_ms


def _gaps(found: np.ndarray, optimum: np.ndarray) -> np.ndarray:
    """Gaps to the optimum, m; 0 where neither search nor optimum has an allowed pixel."""
    found = np.where(found >= ObjectiveConfig().penalty, np.inf, found)
    both = np.isinf(found) & np.isinf(optimum)
    with np.errstate(invalid="ignore"):
        return np.where(both, 0.0, np.minimum(np.abs(found - optimum), 1e3))


def printed(floor: random_floors.RandomFloor) -> Objective:
    """Eq. (9) as printed in one room; it measures angles from the y axis, so the robot faces along y."""
    robot = Pose2(yaw=math.pi / 2)
    config = replace(PRINTED, margin_m=ObjectiveConfig().margin_m)
    goal = robot.apply(floor.goal)
    return Objective.of(floor.movable, floor.camera, floor.T_body_camera, robot, goal, config)


def _forbidden_share(floors: list[random_floors.RandomFloor], objectives: list[Objective]) -> float:
    """Share of rooms in which the optimum of eq. (9) as printed is a forbidden pixel."""
    forbidden = []
    for floor, objective in zip(floors, objectives[: len(floors)], strict=True):
        best = search.exact(printed(floor))
        assert best is not None, "without forbidden pixels there is always an optimum"
        value = float(objective.value(np.array([best.pixel], float))[0])
        forbidden.append(value >= objective.config.penalty)
    return float(np.mean(forbidden))


EXPERIMENT = Experiment(
    id="000-E2",
    title="Particles, epochs and modes of the swarm against the exact search (Han 2018)",
    run=run,
    targets={
        "gap_m_p85": Target("<=", 0.05),
        "gap_m_p95": Target("<=", 0.10),
        "gap_m_max": Target("==", 0.0),
    },
    seeds=200,
)
