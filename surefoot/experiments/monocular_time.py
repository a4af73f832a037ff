"""Time of every stage of the monocular cycle, footstep by footstep, as Fig. 11, and its memory.

The cycle is the whole of it: colours learnt, both ground images, edges, corners, flow, prediction, result
image. Time is that of the processor; the rendering of the pictures is the simulator's and not counted.

Source: seed 000, Fig. 11 and Table 1.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from perception.monocular import cycle as stages_of
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.result import Picture

from .experiment import Experiment, Outcome, Say, Target
from .monocular_cycle import walk

FOLDER = Path("runs/experiments/000-E5")
CYCLES = 12  # of each walk
BUDGET_MS = 35.0  # a tenth of T_DS
STAGES = {
    "ground": "ground_image",
    "edges": "find_edges",
    "flow": "follow",
    "obstacles": "seen_obstacles",
    "prediction": "predicted_image",
}
"""Names of the plot, and the functions of the cycle that they time; what is left over is "colours"."""


@contextmanager
def stopwatches(spent: dict[str, float]) -> Iterator[None]:
    """Time the stages of every cycle within, ms into `spent`, and put all back as it was."""
    saved = {name: getattr(stages_of, function) for name, function in STAGES.items()}

    def timed(name: str, function: Callable[..., object]) -> Callable[..., object]:
        def run_it(*args: object) -> object:
            start = time.process_time_ns()
            answer = function(*args)
            spent[name] += (time.process_time_ns() - start) / 1e6
            return answer

        return run_it

    try:
        for name, function in saved.items():
            setattr(stages_of, STAGES[name], timed(name, function))
        yield
    finally:
        for name, function in saved.items():
            setattr(stages_of, STAGES[name], function)


def timed_cycles(pairs: list[tuple[Picture, Picture]]) -> list[dict[str, float]]:
    """Milliseconds of each stage and of the whole of each cycle; the first one, warm-up, is done twice."""
    Monocular(MonocularConfig()).cycle(*pairs[0])
    monocular = Monocular(MonocularConfig())
    rows = []
    for before, now in pairs:
        spent = dict.fromkeys(STAGES, 0.0)
        with stopwatches(spent):
            start = time.process_time_ns()
            monocular.cycle(before, now)
            spent["total"] = (time.process_time_ns() - start) / 1e6
        spent["colours"] = spent["total"] - sum(spent[name] for name in STAGES)
        rows.append(spent)
    return rows


def peak_mb(pairs: list[tuple[Picture, Picture]]) -> float:
    """Most memory that the arrays of the cycle and its two pictures hold at once, MB."""
    tracemalloc.start()
    try:
        monocular = Monocular(MonocularConfig())
        for before, now in pairs:
            monocular.cycle(before, now)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return (peak + 2 * pairs[0][0].rgb.nbytes) / 1e6


def run(seeds: int, say: Say) -> Outcome:
    """One walk of twelve footsteps a seed, about eight seconds each."""
    rows: list[dict[str, float]] = []
    memory = 0.0
    for seed in range(seeds):
        pairs = [(step[0], step[1]) for step in walk(seed, CYCLES)]
        mine = timed_cycles(pairs)
        rows += mine
        memory = max(memory, peak_mb(pairs[:3]))
        say(f"seed {seed}: median {np.median([row['total'] for row in mine]):.1f} ms")
    _plot(rows)
    total = np.array([row["total"] for row in rows])
    table = ["stage        median ms   most ms"]
    for name in (*STAGES, "colours", "total"):
        spent = [row[name] for row in rows]
        table.append(f"{name:<11}  {np.median(spent):9.2f}  {np.max(spent):8.2f}")
    figures = {
        "cycle_ms_p50": float(np.median(total)),
        "cycle_ms_max": float(total.max()),
        "memory_mb": memory,
    }
    return Outcome(figures, table)


def _plot(rows: list[dict[str, float]]) -> None:
    """Fig. 11: time over footsteps, stage upon stage."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    FOLDER.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(figsize=(9, 4))
    names = ("colours", *STAGES)
    axes.stackplot(range(len(rows)), [[row[name] for row in rows] for name in names], labels=names)
    axes.axhline(BUDGET_MS, color="black", linestyle="--", label="a tenth of T_DS")
    axes.set_xlabel("footstep")
    axes.set_ylabel("processor time, ms")
    axes.legend(loc="upper right", ncols=4, fontsize=8)
    axes.set_ylim(0, 1.4 * BUDGET_MS)
    figure.tight_layout()
    figure.savefig(FOLDER / "time.png", dpi=120)
    plt.close(figure)


EXPERIMENT = Experiment(
    id="000-E5",
    title="Time of the monocular cycle, every stage, and its memory",
    run=run,
    targets={"cycle_ms_max": Target("<=", BUDGET_MS), "memory_mb": Target("<=", 200.0)},
    published={"cycle_ms_p50": 300.0, "cycle_ms_max": 350.0, "memory_mb": 200.0},
    seeds=5,
)
