"""Time of every stage of a footstep's thinking, footstep by footstep, as Fig. 11, and its memory.

It is the whole of steps 2 to 9: colours learnt, both ground images, edges, corners, flow, prediction, result
image; the counters of both corners, the objective, the search, the command. The search is made both ways, by the
exact one that walks and by the seed's swarm of 50 particles and 100 epochs; each has its own total. Time is that of
the clock on the wall, as the step has to wait for it; beside it that of the processor, which a busy machine does
not stretch. The rendering of the pictures is the simulator's and not counted.

Source: seed 000, section 5 (step 10), Fig. 11 and Table 1.
"""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from perception.monocular import contact_detections
from perception.monocular import cycle as stages_of
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.result import MonocularResult, Picture
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits
from perception.primitives.stopwatch import Stopwatch
from planning.swarm import command, search
from planning.swarm.corners import Corners
from planning.swarm.objective import Objective, ObjectiveConfig
from planning.swarm.search import SwarmConfig

from ..support.experiment import Experiment, Outcome, Say, Target
from .monocular_cycle import walk

FOLDER = Path("runs/experiments/000-E5")
CYCLES = 12  # of each walk
BUDGET_MS = 35.0  # a tenth of T_DS
STAGES = {
    "ground": "ground_image",
    "edges": "find_edges",
    "flow": "track_corners",
    "obstacles": "find_obstacles",
    "prediction": "predicted_image",
}
"""Names of the plot, and the functions of the cycle that they time; what is left over is "colours"."""

SWARM = SwarmConfig("constriction", 50, 100)  # seed 000, section 6.4
DECIDING = ("counters", "specks", "objective", "search", "command")
GOAL_M = 3.0  # ours: ahead of where the walk begins


@contextmanager
def stopwatches(spent: dict[str, float]) -> Iterator[None]:
    """Time the stages of every cycle within, ms into `spent`, and put all back as it was."""
    saved = {name: getattr(stages_of, function) for name, function in STAGES.items()}

    def timed(name: str, function: Callable[..., object]) -> Callable[..., object]:
        def run_it(*args: object) -> object:
            start = time.perf_counter_ns()
            answer = function(*args)
            spent[name] += (time.perf_counter_ns() - start) / 1e6
            return answer

        return run_it

    try:
        for name, function in saved.items():
            setattr(stages_of, STAGES[name], timed(name, function))
        yield
    finally:
        for name, function in saved.items():
            setattr(stages_of, STAGES[name], function)


class Thinking:
    """Steps 2 to 9 of one walker: the cycle, then counters, objective, search and command."""

    def __init__(self, first: Picture) -> None:
        self._monocular = Monocular(MonocularConfig())
        self._corners = Corners()
        self._gait = GaitLimits()
        self._rng = np.random.default_rng(5)
        self._goal = _body(first).apply(np.array([GOAL_M, 0.0]))

    def step(self, before: Picture, now: Picture) -> dict[str, float]:
        """Milliseconds of each stage, and of the whole by either search; of the exact one's also the processor's."""
        spent = dict.fromkeys(STAGES, 0.0)
        begin = time.process_time_ns()
        with stopwatches(spent):
            start = time.perf_counter_ns()
            result = self._monocular.cycle(before, now)
            cycle_ms = (time.perf_counter_ns() - start) / 1e6
        spent["colours"] = cycle_ms - sum(spent[name] for name in STAGES)
        watch = Stopwatch()
        objective = self._decide(result, watch)
        spent["processor"] = (time.process_time_ns() - begin) / 1e6
        with watch.stage("swarm"):
            search.find(objective, SWARM, self._rng)
        spent |= watch.milliseconds
        common = cycle_ms + sum(spent[name] for name in DECIDING if name != "search")
        spent["total"] = common + spent["search"]
        spent["total_swarm"] = common + spent["swarm"]
        return spent

    def _decide(self, result: MonocularResult, watch: Stopwatch) -> Objective:
        """From the result image to the command, timed; the objective on the way."""
        gait = self._gait
        robot = _body(result.current)
        with watch.stage("counters"):
            step_m = gait.cruise_mps * gait.step_s
            self._corners.update(result.corners_blocked, result.nearest_m, step_m)
        with watch.stage("specks"):  # as our walker fills them
            ground = contact_detections.find_contact_edges(result).ground
            movable = np.where(result.predicted > 0, np.uint8(0), ground)
        with watch.stage("objective"):
            objective = Objective.of(
                movable,
                result.current.camera,
                robot.inverse().lifted() @ result.current.T_world_camera,
                robot,
                self._goal,
                ObjectiveConfig(),
                self._corners.blocked,
            )
        with watch.stage("search"):
            best = search.find(objective, SwarmConfig("exact"), self._rng)
        with watch.stage("command"):
            if best is None:
                command.turning(self._goal, robot, gait)
            else:
                command.towards(objective.place(best.pixel), robot, gait)
        return objective


def _body(picture: Picture) -> Pose2:
    """The body, as if it stood below its camera and faced where that looks."""
    x, y, _ = picture.T_world_camera.translation
    axis = picture.T_world_camera.rotation[:, 2]
    return Pose2(x, y, math.atan2(axis[1], axis[0]))


def timed_cycles(pairs: list[tuple[Picture, Picture]]) -> list[dict[str, float]]:
    """Milliseconds of each stage and of the whole of each cycle; the first one, warm-up, is done twice."""
    Thinking(pairs[0][1]).step(*pairs[0])
    walker = Thinking(pairs[0][1])
    return [walker.step(before, now) for before, now in pairs]


def peak_mb(pairs: list[tuple[Picture, Picture]]) -> float:
    """Most memory that the arrays of the cycle, the search and its two pictures hold at once, MB."""
    tracemalloc.start()
    try:
        walker = Thinking(pairs[0][1])
        for before, now in pairs:
            walker.step(before, now)
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
    total, by_swarm = (np.array([row[name] for row in rows]) for name in ("total", "total_swarm"))
    table = ["stage        median ms   most ms"]
    for name in (*STAGES, "colours", *DECIDING, "swarm", "total", "total_swarm", "processor"):
        spent = [row[name] for row in rows]
        table.append(f"{name:<11}  {np.median(spent):9.2f}  {np.max(spent):8.2f}")
    figures = {
        "cycle_ms_p50": float(np.median(total)),
        "cycle_ms_mean": float(total.mean()),
        "cycle_ms_max": float(total.max()),
        "processor_ms_max": max(row["processor"] for row in rows),
        "swarm_cycle_ms_p50": float(np.median(by_swarm)),
        "swarm_cycle_ms_max": float(by_swarm.max()),
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
    names = ("colours", *STAGES, *DECIDING)
    axes.stackplot(range(len(rows)), [[row[name] for row in rows] for name in names], labels=names)
    axes.axhline(BUDGET_MS, color="black", linestyle="--", label="a tenth of T_DS")
    axes.set_xlabel("footstep")
    axes.set_ylabel("time, ms")
    axes.legend(loc="upper right", ncols=4, fontsize=8)
    axes.set_ylim(0, 1.4 * BUDGET_MS)
    figure.tight_layout()
    figure.savefig(FOLDER / "time.png", dpi=120)
    plt.close(figure)


EXPERIMENT = Experiment(
    id="000-E5",
    title="Time of a footstep's seeing and deciding, every stage, and its memory",
    run=run,
    targets={"cycle_ms_max": Target("<=", BUDGET_MS), "memory_mb": Target("<=", 200.0)},
    published={"cycle_ms_p50": 300.0, "cycle_ms_max": 350.0, "memory_mb": 200.0},
    seeds=5,
)
