"""How two things are timed fairly: interleaved in one process, warm, by processor time, median.

Absolute times drift with the machine; the ratio of two medians taken in turn does not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..results import registry

FILES = {
    "stereo": "stereo",
    "backproject": "backproject",
    "plane": "plane",
    "grid": "grid",
    "ukf": "ukf",
    "astar": "astar",
    "mdghm": "mdghm",
    "monocular": "monocular",
    "panorama": "panorama",
    "smoother": "smoother",
    "process": "process",
    "gaze": "gaze",
    "univector": "univector",
    "swarm": "swarm",
    "fams": "fams",
}
"""Where each benchmark lives: name to file of this folder."""


@dataclass(frozen=True)
class Comparison:
    """What a benchmark measured.

    Args:
        milliseconds: Median processor time of each contestant, by name.
        ratios: Peer over ours; above 1 we are faster.
        accuracy: Errors of both, by name, so that speed is not bought.
        missing: Peers that are not installed here.
    """

    milliseconds: dict[str, float]
    ratios: dict[str, float]
    accuracy: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Benchmark:
    """One hot path against its peers; `bars` are the least ratios."""

    name: str
    title: str
    run: Callable[[], Comparison]
    bars: Mapping[str, float]


def race(contestants: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, float]:
    """Median processor time of each, ms: two warm-up rounds, then all in turn, round by round."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for number in range(rounds + 2):
        for name, run in contestants.items():
            start = time.process_time_ns()
            run()
            spent = (time.process_time_ns() - start) / 1e6
            if number >= 2:
                times[name].append(spent)
    return {name: float(np.median(spent)) for name, spent in times.items()}


def names() -> list[str]:
    """All benchmarks."""
    return list(FILES)


def load(name: str) -> Benchmark:
    """The benchmark of that name; an unknown one is an InputError with the nearest."""
    found: Benchmark = registry.load("benchmark", __package__, FILES, name)
    return found


def judge(benchmark: Benchmark, measured: Comparison) -> dict[str, Any]:
    """The one object that `--json` prints; a bar whose peer is absent is left out and said."""
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
    """The same for people."""
    shown = [f"{result['id']}  {result['title']}"]
    shown += [f"  {name:<32} {value:10.3f}" for name, value in result["figures"].items()]
    for name, ratio in result["ratios"].items():
        bar = result["targets"].get(name)
        note = "" if bar is None else f"   bar {bar[0]} {bar[1]:g}"
        shown.append(f"  {name:<32} {ratio:10.2f} x{note}")
    shown += [f"  peer not installed here: {name}" for name in result["missing_peers"]]
    shown.append("passed" if result["passed"] else "NOT PASSED")
    return shown
