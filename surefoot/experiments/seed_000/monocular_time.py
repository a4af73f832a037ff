"""Computing time of every stage per footstep, as in Fig. 11, and memory.

Timed are steps 2 to 9: colour model, both ground images, edges, corners, flow, prediction and result image; corner
counters, objective, search and command. The search runs twice, by the product's exact search and by the paper's swarm
of 50 particles and 100 epochs, each with its own total. Times are wall-clock times, since the step waits for them;
processor time, which other load does not affect, is given beside them. Rendering is not counted.

Source: Han 2018 (seed 000), section 5 (step 10), Fig. 11 and Table 1.
"""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

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

from ...report.plots import style
from ..support.columns import Row
from ..support.experiment import Experiment, Outcome, Say, Target
from .image_pairs import image_pairs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CYCLES = 12  # per walk
BUDGET_MS = 35.0  # a tenth of T_DS
STAGES = {
    "ground": "ground_image",
    "edges": "find_edges",
    "floor flow": "track_floor",
    "flow": "track_corners",
    "obstacles": "find_obstacles",
    "prediction": "predicted_image",
}
"""Stage to the function of the cycle that is timed; the remaining time is the stage "colours"."""

SWARM = SwarmConfig("constriction", 50, 100)  # seed 000, section 6.4
DECIDING = ("counters", "specks", "objective", "search", "command")
GOAL_M = 3.0  # ours: ahead of the start


@contextmanager
def timed_stages(spent: dict[str, float]) -> Iterator[None]:
    """Add the time of each stage of the cycle to `spent`, ms, within this context."""
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


class DecisionTimer:
    """Steps 2 to 9: the monocular cycle, then counters, objective, search and command."""

    def __init__(self, first: Picture) -> None:
        self._monocular = Monocular(MonocularConfig())
        self._corners = Corners()
        self._gait = GaitLimits()
        self._rng = np.random.default_rng(5)
        self._goal = _body(first).apply(np.array([GOAL_M, 0.0]))

    def step(self, before: Picture, now: Picture) -> dict[str, float]:
        """Time of each stage and of the whole by either search, ms; processor time with the exact search."""
        spent = dict.fromkeys(STAGES, 0.0)
        begin = time.process_time_ns()
        with timed_stages(spent):
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
        """Time the stages from the result image to the command; returns the objective."""
        gait = self._gait
        robot = _body(result.current)
        with watch.stage("counters"):
            step_m = gait.cruise_mps * gait.step_s
            self._corners.update(result.corners_blocked, result.nearest_m, step_m)
        with watch.stage("specks"):  # as our planner fills them
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
    """Body pose below the camera, with the heading of its optical axis."""
    x, y, _ = picture.T_world_camera.translation
    axis = picture.T_world_camera.rotation[:, 2]
    return Pose2(x, y, math.atan2(axis[1], axis[0]))


def timed_cycles(pairs: list[tuple[Picture, Picture]]) -> list[dict[str, float]]:
    """Time of each stage and of the whole of each cycle, ms, after one warm-up cycle."""
    DecisionTimer(pairs[0][1]).step(*pairs[0])
    timer = DecisionTimer(pairs[0][1])
    return [timer.step(before, now) for before, now in pairs]


def peak_mb(pairs: list[tuple[Picture, Picture]]) -> float:
    """Peak memory of the cycle, the search and its two images, MB."""
    tracemalloc.start()
    try:
        timer = DecisionTimer(pairs[0][1])
        for before, now in pairs:
            timer.step(before, now)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return (peak + 2 * pairs[0][0].rgb.nbytes) / 1e6


def run(seeds: int, say: Say) -> Outcome:
    """One walk of twelve footsteps per seed, about eight seconds each."""
    rows: list[dict[str, float]] = []
    memory = 0.0
    for seed in range(seeds):
        pairs = [pair.joints for pair in image_pairs(seed, CYCLES)]
        times = timed_cycles(pairs)
        rows += times
        memory = max(memory, peak_mb(pairs[:3]))
        say(f"seed {seed}: median {np.median([row['total'] for row in times]):.1f} ms")
    total, by_swarm = (np.array([row[name] for row in rows]) for name in ("total", "total_swarm"))
    table = ["stage        median ms    max ms"]
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
    drawing = style.Drawing(
        "time", "Stacked times of the stages of every footstep.", partial(_plot, rows)
    )
    return Outcome(figures, table, COLUMNS, [drawing])


def _plot(rows: list[dict[str, float]]) -> Figure:
    """Fig. 11: stacked times of the stages over footsteps."""
    names = ("colours", *STAGES, *DECIDING)
    times = [[row[name] for row in rows] for name in names]
    figure, axes = style.sheet(height_in=4.0)
    axes.stackplot(range(len(rows)), times, labels=names)
    axes.axhline(BUDGET_MS, color=style.INK, linestyle="--", label="a tenth of T_DS")
    axes.set(xlabel="footstep", ylabel="time, ms", ylim=(0, 1.4 * BUDGET_MS))
    style.legend(axes)
    return figure


COLUMNS: tuple[Row, ...] = (
    ("time of a cycle, median, ms", 300.0, "swarm_cycle_ms_p50", "cycle_ms_p50"),
    ("time of a cycle, largest, ms", 350.0, "swarm_cycle_ms_max", "cycle_ms_max"),
    ("memory, MB", 200.0, "", "memory_mb"),
)

EXPERIMENT = Experiment(
    id="000-E5",
    title="Computing time per footstep by stage, and memory (Han 2018, Fig. 11)",
    run=run,
    targets={"cycle_ms_max": Target("<=", BUDGET_MS), "memory_mb": Target("<=", 200.0)},
    published={"cycle_ms_p50": 300.0, "cycle_ms_max": 350.0, "memory_mb": 200.0},
    seeds=5,
)
