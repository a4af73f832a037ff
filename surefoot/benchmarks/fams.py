"""The fuzzy selection of a motion for 10,000 inputs, against scikit-fuzzy's control system and NumPy's interpolation.

Both have the same sets and the same 25 rules. The consequents in scikit-fuzzy are one narrow triangle per motion, and
its mean of maxima gives the strongest. The hardest peer interpolates the memberships by `np.interp` and takes the
strongest of the seven motions. The share of inputs with different results is reported.
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
ROUNDS = 5  # scikit-fuzzy takes seconds


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


def by_interpolation(width_m: np.ndarray, gap_m: np.ndarray, config: FamsConfig) -> np.ndarray:
    """The same selection by `np.interp`, minimum and maximum."""
    body, corners = DARWIN_OP.passage_width_m, np.eye(len(SETS))
    wide = [np.interp(width_m - body, config.obstacle_centres_m, corner) for corner in corners]
    free = [np.interp(gap_m - body, config.gap_centres_m, corner) for corner in corners]
    strength = np.zeros((len(MOTIONS), len(width_m)))
    for motion in range(len(MOTIONS)):
        rows, columns = (np.unique(used) for used in np.nonzero(np.equal(TABLE, motion)))
        either = (
            np.max([wide[k] for k in rows], axis=0),
            np.max([free[k] for k in columns], axis=0),
        )
        np.minimum(*either, out=strength[motion])
    return np.asarray(strength.argmax(axis=0))


def run() -> Comparison:
    """10,000 random inputs."""
    config = FamsConfig()
    rng = np.random.default_rng(15)
    width, gap = rng.uniform(0.0, 1.6, INPUTS), rng.uniform(0.0, 1.2, INPUTS)
    candidates: dict[str, Callable[[], np.ndarray]] = {
        "ours_ms": partial(select, width, gap, config),
        "interp_ms": partial(by_interpolation, width, gap, config),
    }
    missing = []
    try:
        candidates["skfuzzy_ms"] = partial(peer(config), width, gap)
    except ImportError:
        missing.append("scikit-fuzzy")
    times = race(candidates, ROUNDS)
    found = {name: candidate() for name, candidate in candidates.items()}
    ratios = {
        name.replace("_ms", ""): value / times["ours_ms"]
        for name, value in times.items()
        if name != "ours_ms"
    }
    differ = {
        f"{name}_choices_differ_share": float(np.mean(found["ours_ms"] != found[f"{name}_ms"]))
        for name in ratios
    }
    fair = {"np.interp, minimum and maximum": ratios["interp"]}
    return Comparison(
        times, {f"ratio_{name}": value for name, value in ratios.items()}, differ, fair, missing
    )


BENCHMARK = Benchmark(
    "fams",
    "Fuzzy selection of 10,000 motions",
    run,
    {"ratio_skfuzzy": 200.0},
    {"interp_choices_differ_share": 0.0, "skfuzzy_choices_differ_share": 0.01},
)
