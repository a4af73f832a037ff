"""The fuzzy selection of a motion for 10,000 inputs, against scikit-fuzzy's control system on arrays.

Both have the same sets and the same 25 rules. The consequents in scikit-fuzzy are one narrow triangle per motion, and
its mean of maxima gives the strongest. The share of inputs with different results is reported.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from perception.primitives.robot_model import DARWIN_OP
from planning.avoidance.fams import MOTIONS, SETS, TABLE, FamsConfig, select

from .benchmark import Benchmark, Comparison, race

INPUTS = 10_000
ROUNDS = 3  # scikit-fuzzy takes seconds


def peer(config: FamsConfig) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The same selection, built with scikit-fuzzy."""
    skfuzzy: Any = importlib.import_module("skfuzzy")
    control: Any = importlib.import_module("skfuzzy.control")

    def antecedent(name: str, centres: tuple[float, ...]) -> Any:
        universe = np.linspace(-1.0, 2.0, 301)
        made = control.Antecedent(universe, name)
        ends = (-1.0, *centres, 2.0)
        for k, label in enumerate(SETS):
            if k == 0:
                corners = [-1.0, -1.0, centres[0], centres[1]]
            elif k == len(SETS) - 1:
                corners = [centres[-2], centres[-1], 2.0, 2.0]
            else:
                corners = [ends[k], ends[k + 1], ends[k + 1], ends[k + 2]]
            made[label] = skfuzzy.trapmf(universe, corners)
        return made

    wide, free = antecedent("w", config.obstacle_centres_m), antecedent("s", config.gap_centres_m)
    motion = control.Consequent(np.linspace(-0.5, 6.5, 71), "motion", defuzzify_method="mom")
    for k, name in enumerate(MOTIONS):
        motion[name] = skfuzzy.trimf(motion.universe, [k - 0.4, k, k + 0.4])
    rules = [
        control.Rule(wide[SETS[i]] & free[SETS[j]], motion[MOTIONS[TABLE[i, j]]])
        for i in range(5)
        for j in range(5)
    ]
    system = control.ControlSystem(rules)

    def run(width_m: np.ndarray, gap_m: np.ndarray) -> np.ndarray:
        simulation = control.ControlSystemSimulation(system)
        simulation.input["w"] = width_m - DARWIN_OP.passage_width_m
        simulation.input["s"] = gap_m - DARWIN_OP.passage_width_m
        simulation.compute()
        return np.asarray(np.round(simulation.output["motion"]), dtype=np.int64)

    return run


def run() -> Comparison:
    """10,000 random inputs."""
    config = FamsConfig()
    rng = np.random.default_rng(15)
    width, gap = rng.uniform(0.0, 1.6, INPUTS), rng.uniform(0.0, 1.2, INPUTS)
    candidates: dict[str, Callable[[], object]] = {"ours_ms": partial(select, width, gap, config)}
    try:
        theirs = peer(config)
    except ImportError:
        return Comparison(race(candidates, ROUNDS), {}, {}, ["scikit-fuzzy"])
    candidates["skfuzzy_ms"] = partial(theirs, width, gap)
    times = race(candidates, ROUNDS)
    differ = float(np.mean(select(width, gap, config) != theirs(width, gap)))
    return Comparison(
        times,
        {"ratio_skfuzzy": times["skfuzzy_ms"] / times["ours_ms"]},
        {"choices_that_differ_share": differ},
    )


BENCHMARK = Benchmark(
    "fams",
    "Fuzzy selection of 10,000 motions",
    run,
    {"ratio_skfuzzy": 200.0},
)
