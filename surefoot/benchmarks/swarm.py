"""Best pixel of a result image of 720 x 720 pixels: swarm and exact search, against pyswarms.

All minimise the same compiled objective; pyswarms evaluates it for a whole generation at once. The swarms have 50
particles and 100 epochs; the exact search is checked against brute force. The hardest peer is the swarm of pyswarms
compiled by Numba, as often as it takes until the best of these swarms is the optimum of every floor.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from perception.primitives.pose import Pose2
from planning.swarm import random_floors, search
from planning.swarm.objective import Objective, ObjectiveConfig

from .benchmark import Benchmark, Comparison, race

PICTURES = 8
ROUNDS = 7
MOST_SWARMS = 10
SWARM = search.SwarmConfig(mode="spread")


def run() -> Comparison:
    """Eight random floors; gaps are the differences from the exact optimum."""
    peer, missing = _peer()
    floors = [random_floors.make(np.random.default_rng([8, k])) for k in range(PICTURES)]
    objectives = [
        Objective.of(f.movable, f.camera, f.T_body_camera, Pose2(), f.goal, ObjectiveConfig())
        for f in floors
    ]
    rng = np.random.default_rng(0)
    best = np.array([_value(search.brute_force(o)) for o in objectives])
    again = next(
        count
        for count in range(1, MOST_SWARMS + 1)
        if count == MOST_SWARMS
        or np.allclose([_compiled(o, count) for o in objectives], best, atol=1e-9)
    )
    candidates: dict[str, Callable[[], list[float]]] = {
        "swarm_ms": lambda: [search.fly(o, SWARM, rng).value for o in objectives],
        "exact_ms": lambda: [_value(search.exact(o)) for o in objectives],
        "numba_ms": lambda: [_compiled(o, again) for o in objectives],
    }
    if peer is not None:
        candidates["pyswarms_ms"] = lambda: [_pyswarms(peer, o) for o in objectives]
    times = {name: spent / PICTURES for name, spent in race(candidates, ROUNDS).items()}
    gaps = {name: np.array(candidate()) - best for name, candidate in candidates.items()}
    accuracy = {"numba_swarms": float(again)}
    for name, gap in gaps.items():
        accuracy[name.replace("_ms", "_gap_m_median")] = float(np.median(gap))
        accuracy[name.replace("_ms", "_gap_m_max")] = float(np.max(gap))
    ratios = {"ratio_numba_exact": times["numba_ms"] / times["exact_ms"]}
    if peer is not None:
        ratios["ratio_pyswarms"] = times["pyswarms_ms"] / times["swarm_ms"]
        ratios["ratio_pyswarms_exact"] = times["pyswarms_ms"] / times["exact_ms"]
    fair = {f"best of {again} swarms under Numba": ratios["ratio_numba_exact"]}
    return Comparison(times, ratios, accuracy, fair, missing)


def _value(best: search.Best | None) -> float:
    return np.inf if best is None else best.value


def _compiled(objective: Objective, count: int) -> float:
    """The best of some global-best swarms, compiled."""
    rng = np.random.default_rng(0)
    plain = search.SwarmConfig(mode="constriction")
    return min(search.fly(objective, plain, rng).value for _ in range(count))


def _peer() -> tuple[Any, list[str]]:
    try:
        peer = importlib.import_module("pyswarms")
    except ImportError:
        return None, ["pyswarms"]
    logging.getLogger("pyswarms").setLevel(logging.ERROR)
    return peer, []


def _pyswarms(peer: Any, objective: Objective) -> float:
    """The global-best swarm of pyswarms with the same constants."""
    height, width = objective.arrays.blocked.shape
    inertia, own, others, _ = search.MODES["constriction"]
    low = np.array([0.0, objective.config.top_share * height])
    optimiser = peer.single.GlobalBestPSO(
        n_particles=SWARM.particles,
        dimensions=2,
        options={"c1": own, "c2": others, "w": inertia},
        bounds=(low, np.array([width - 1.0, height - 1.0])),
    )
    cost, _ = optimiser.optimize(objective.value, iters=SWARM.epochs, verbose=False)
    return float(cost)


BENCHMARK = Benchmark(
    "swarm",
    "best pixel of 720 x 720: swarm of 50 x 100 and exact search",
    run,
    {"ratio_pyswarms": 2.5, "ratio_pyswarms_exact": 5.0},
    {"exact_gap_m_max": 1e-9},
)
