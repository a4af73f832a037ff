"""Timing of benchmarks: candidates in turn in one process, after a warm-up, median of the processor time.

Absolute times vary with the load of the machine; the ratio of two interleaved medians hardly does. Beside a library
that people use for the task, every benchmark has the hardest fair peer: the same result from the same input, in the
fastest form that we know (batched NumPy, compiled code, a warm start, the same window, the same points).
"""

from __future__ import annotations

import math
import multiprocessing
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from ..results import registry

NAMES = (
    "stereo",
    "backproject",
    "plane",
    "regions",
    "grid",
    "ukf",
    "astar",
    "mdghm",
    "monocular",
    "panorama",
    "smoother",
    "process",
    "gaze",
    "univector",
    "swarm",
    "fams",
)
"""Each is a module of this package with a `BENCHMARK`."""

HARDEST = 1.2
"""Smallest ratio against the hardest fair peer of a benchmark."""

LEAST_MS = 1.0
"""A candidate is repeated within a round until about this time has passed."""


@dataclass(frozen=True)
class Comparison:
    """Result of a benchmark.

    Args:
        milliseconds: Median processor time of each candidate, by name.
        ratios: Time of the peer divided by ours; above 1 ours is faster.
        accuracy: Errors of both, by name.
        fair: Ratio of each peer that may be the hardest fair one, by its description.
        missing: Peers that are not installed.
    """

    milliseconds: dict[str, float]
    ratios: dict[str, float]
    accuracy: dict[str, float] = field(default_factory=dict)
    fair: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Benchmark:
    """Comparison of one function with its peers.

    Args:
        name, title: Of the benchmark.
        run: Measures.
        bars: Smallest ratios allowed.
        limits: Largest errors allowed, by the names of `Comparison.accuracy`.
    """

    name: str
    title: str
    run: Callable[[], Comparison]
    bars: Mapping[str, float]
    limits: Mapping[str, float]


def race(candidates: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, float]:
    """Median processor time of one call of each candidate, ms.

    Two warm-up rounds, then all in turn in each round. The second one decides how often a short candidate is repeated.
    OpenCV runs in one thread, as ours: of two threads the processor time counts the waiting for each other, too.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return _race(candidates, rounds)
    finally:
        cv2.setNumThreads(threads)


def _race(candidates: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    times: dict[str, list[float]] = {name: [] for name in candidates}
    repeats = dict.fromkeys(candidates, 1)
    for number in range(rounds + 2):
        for name, run in candidates.items():
            start = time.process_time_ns()
            for _ in range(repeats[name]):
                run()
            spent = (time.process_time_ns() - start) / 1e6 / repeats[name]
            if number >= 2:
                times[name].append(spent)
            elif number == 1:
                repeats[name] = math.ceil(LEAST_MS / max(spent, 1e-3))
    return {name: float(np.median(spent)) for name, spent in times.items()}


def mean_ratio(ratios: Sequence[float]) -> float:
    """Geometric mean."""
    return math.exp(sum(map(math.log, ratios)) / len(ratios))


def names() -> list[str]:
    """Names of all benchmarks."""
    return list(NAMES)


def load(name: str) -> Benchmark:
    """The benchmark of a name; an InputError for an unknown name suggests the nearest."""
    found: Benchmark = registry.load("benchmark", __package__, {one: one for one in NAMES}, name)
    return found


def measured(name: str) -> dict[str, Any]:
    """Run a benchmark in a process of its own, as others leave memory behind that slows it, and judge it.

    Raises:
        InputError: The name is unknown.
    """
    load(name)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
        return alone.submit(_measured, name).result()


def _measured(name: str) -> dict[str, Any]:
    chosen = load(name)
    return judge(chosen, chosen.run())


def judge(benchmark: Benchmark, measured: Comparison) -> dict[str, Any]:
    """The object that `--json` prints; a bound whose peer is not installed is left out and listed."""
    ratios, bars = dict(measured.ratios), dict(benchmark.bars)
    if measured.fair:
        ratios["hardest_ratio"], bars["hardest_ratio"] = min(measured.fair.values()), HARDEST
    figures = {**measured.milliseconds, **measured.accuracy}
    targets = {name: [">=", bar] for name, bar in bars.items() if name in ratios}
    limits = {name: ["<=", most] for name, most in benchmark.limits.items() if name in figures}
    return {
        "id": benchmark.name,
        "title": benchmark.title,
        "ratios": ratios,
        "figures": figures,
        "fair_peers": measured.fair,
        "hardest_peer": min(measured.fair, key=measured.fair.__getitem__, default=None),
        "targets": targets | limits,
        "published": {},
        "missing_peers": measured.missing,
        "passed": bool(targets)
        and all(ratios[name] >= bars[name] for name in targets)
        and all(figures[name] <= benchmark.limits[name] for name in limits),
    }


def lines(result: Mapping[str, Any]) -> list[str]:
    """The result as text."""

    def bound(name: str) -> str:
        said = result["targets"].get(name)
        return "" if said is None else f"   bound {said[0]} {said[1]:g}"

    shown = [f"{result['id']}  {result['title']}"]
    shown += [
        f"  {name:<32} {value:10.3f}{bound(name)}" for name, value in result["figures"].items()
    ]
    shown += [f"  against {name}: {ratio:.2f} x" for name, ratio in result["fair_peers"].items()]
    shown += [
        f"  {name:<32} {ratio:10.2f} x{bound(name)}" for name, ratio in result["ratios"].items()
    ]
    if result["hardest_peer"]:
        shown.append(f"  the hardest peer is {result['hardest_peer']}")
    shown += [f"  peer not installed: {name}" for name in result["missing_peers"]]
    shown.append("passed" if result["passed"] else "NOT PASSED")
    return shown
