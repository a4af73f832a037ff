"""Timing of benchmarks: interleaved in one process, after a warm-up, median of the processor time.

Absolute times vary with the load of the machine; the ratio of two interleaved medians hardly does.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..results import registry

NAMES = (
    "stereo",
    "backproject",
    "plane",
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


@dataclass(frozen=True)
class Comparison:
    """Result of a benchmark.

    Args:
        milliseconds: Median processor time of each candidate, by name.
        ratios: Time of the peer divided by ours; above 1 ours is faster.
        accuracy: Errors of both, by name.
        missing: Peers that are not installed.
    """

    milliseconds: dict[str, float]
    ratios: dict[str, float]
    accuracy: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Benchmark:
    """Comparison of one function with its peers; `bars` are the smallest ratios allowed."""

    name: str
    title: str
    run: Callable[[], Comparison]
    bars: Mapping[str, float]


def race(candidates: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, float]:
    """Median processor time of each candidate, ms: two warm-up rounds, then all in turn in each round."""
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for number in range(rounds + 2):
        for name, run in candidates.items():
            start = time.process_time_ns()
            run()
            spent = (time.process_time_ns() - start) / 1e6
            if number >= 2:
                times[name].append(spent)
    return {name: float(np.median(spent)) for name, spent in times.items()}


def names() -> list[str]:
    """Names of all benchmarks."""
    return list(NAMES)


def load(name: str) -> Benchmark:
    """The benchmark of a name; an InputError for an unknown name suggests the nearest."""
    found: Benchmark = registry.load("benchmark", __package__, {one: one for one in NAMES}, name)
    return found


def judge(benchmark: Benchmark, measured: Comparison) -> dict[str, Any]:
    """The object that `--json` prints; a bound whose peer is not installed is left out and listed."""
    bars = {name: bar for name, bar in benchmark.bars.items() if name in measured.ratios}
    return {
        "id": benchmark.name,
        "title": benchmark.title,
        "ratios": measured.ratios,
        "figures": {**measured.milliseconds, **measured.accuracy},
        "targets": {name: [">=", bar] for name, bar in bars.items()},
        "published": {},
        "missing_peers": measured.missing,
        "passed": bool(bars) and all(measured.ratios[name] >= bar for name, bar in bars.items()),
    }


def lines(result: Mapping[str, Any]) -> list[str]:
    """The result as text."""
    shown = [f"{result['id']}  {result['title']}"]
    shown += [f"  {name:<32} {value:10.3f}" for name, value in result["figures"].items()]
    for name, ratio in result["ratios"].items():
        bar = result["targets"].get(name)
        note = "" if bar is None else f"   bound {bar[0]} {bar[1]:g}"
        shown.append(f"  {name:<32} {ratio:10.2f} x{note}")
    shown += [f"  peer not installed: {name}" for name in result["missing_peers"]]
    shown.append("passed" if result["passed"] else "NOT PASSED")
    return shown
