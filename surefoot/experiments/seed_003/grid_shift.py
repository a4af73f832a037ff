"""Shifting the egocentric grid: a thousand random steps and turns, compared with one fixed array.

The robot integrates its steps as seed 003 does: M = Rot(beta) (dx, dy), then beta <- beta + dbeta; the grid receives
M only. The reference is one array over the whole area; it applies the evidence rule to whole arrays and clears cells
that leave the window. Eq. (2) as printed, which drops the old R, is measured for comparison.

Source: seed 003, eq. (1) and (2).
"""

from __future__ import annotations

import math
import time
from itertools import accumulate

import numpy as np

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.evidence import FIRST_FLOOR, FIRST_OBSTACLE

from ..support.experiment import Experiment, Outcome, Say, Target

STEPS = 1000
POINTS = 400  # observed at each step
REACH_M = 1.6
STEP_M = (-0.03, 0.08), (-0.03, 0.03)  # ahead, to the left
TURN_RAD = 0.25
SIDES = (71, 175, 351, 701)  # cells; grid sizes of the timing
TIMED = 400  # timed shifts of one cell


class FixedMap:
    """Reference map: the same evidence rule on one fixed array, without window, offset or compiled loop."""

    def __init__(self, config: GridConfig, start: np.ndarray) -> None:
        self.config = config
        self.middle = 2 + round(STEPS * 0.09 / config.cell_m)  # more than the longest possible walk
        self.anchor = start - (self.middle + 0.5) * config.cell_m
        side = 2 * self.middle + 1
        self.odds = np.full((side, side), np.inf)
        self.stamps = np.zeros((side, side))

    def window(self, position: np.ndarray) -> tuple[slice, slice]:
        """Rows and columns of the window around the cell that contains the position."""
        column, row = np.floor((position - self.anchor) / self.config.cell_m).astype(int)
        half = self.config.cells // 2
        return slice(row - half, row + half + 1), slice(column - half, column + half + 1)

    def move(self, before: np.ndarray, after: np.ndarray) -> None:
        """Clear the cells that leave the window."""
        old, new = self.window(before), self.window(after)
        kept = self.odds[new].copy(), self.stamps[new].copy()
        seen = np.zeros(self.odds.shape, np.bool_)
        seen[old] = True
        inside = seen[new]
        self.odds[old], self.stamps[old] = np.inf, 0.0
        self.odds[new] = np.where(inside, kept[0], np.inf)
        self.stamps[new] = np.where(inside, kept[1], 0.0)

    def update(
        self, points: np.ndarray, flags: np.ndarray, stamp_s: float, position: np.ndarray
    ) -> None:
        """Seed 003's rule for first and later observations of a cell."""
        cells = np.floor((points - self.anchor) / self.config.cell_m).astype(int)[:, ::-1]
        seen = np.zeros((2, *self.odds.shape), np.int32)
        np.add.at(seen, (flags.astype(int), *cells.T), 1)
        part = self.window(position)
        floor, solid = seen[0][part], seen[1][part] >= 3
        odds, rule = self.odds[part], self.config.evidence
        first = np.where(solid, FIRST_OBSTACLE, FIRST_FLOOR)
        step = np.where(solid, rule.obstacle, rule.floor)
        new = np.where(
            np.isinf(odds),
            np.log(first / (1 - first)),
            np.clip(np.where(np.isinf(odds), 0.0, odds) + step, -rule.limit, rule.limit),
        )
        touched = solid | (floor > 0)
        self.odds[part] = np.where(touched, new, odds)
        self.stamps[part] = np.where(touched, stamp_s, self.stamps[part])


def walk(seed: int) -> dict[str, float]:
    """One walk: greatest position error, cells that differ, and the error of eq. (2) as printed."""
    rng = np.random.default_rng(seed)
    steps = np.column_stack([rng.uniform(*limits, STEPS) for limits in STEP_M])
    turns = rng.uniform(-TURN_RAD, TURN_RAD, STEPS)
    headings = np.array([*accumulate(turns, initial=rng.uniform(-math.pi, math.pi))])[:-1]
    c, s = np.cos(headings), np.sin(headings)
    moves = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    start = rng.uniform(-3.0, 3.0, 2)
    grid = EgocentricGrid(GridConfig(), start)
    literal = EgocentricGrid(GridConfig(literal=True), start)
    fixed, true = FixedMap(grid.config, start), start
    error = literal_error = outside = 0.0
    wrong = 0
    for k, move in enumerate(moves):
        before = true
        true = start + [math.fsum(moves[: k + 1, axis]) for axis in range(2)]
        grid.shift(move)
        literal.shift(move)
        fixed.move(before, true)
        points = true + rng.uniform(-REACH_M, REACH_M, (POINTS, 2))
        points = (
            points[np.newaxis].repeat(3, axis=0).reshape(-1, 2)
        )  # three points make an obstacle
        flags = np.sin(4 * points[:, 0]) * np.cos(5 * points[:, 1]) > 0.4
        grid.update(points, flags, k + 1.0, true)
        fixed.update(points, flags, k + 1.0, true)
        error = max(error, float(np.abs(grid.position - true).max()))
        literal_error = max(literal_error, float(np.hypot(*(literal.position - true))))
        outside = max(outside, float(np.abs(grid.offset).max()) - grid.cell_m / 2)
        wrong += _different_cells(grid, fixed, true)
    return {
        "offset_error_m": error,
        "outside_cell_m": max(0.0, outside),
        "wrong_cells": float(wrong),
        "literal_error_m": literal_error,
    }


def _different_cells(grid: EgocentricGrid, fixed: FixedMap, position: np.ndarray) -> int:
    """Number of cells of the window whose probability (up to rounding), stamp or known flag differs."""
    part = fixed.window(position)
    known = np.isfinite(fixed.odds[part])
    probability = 1.0 / (1.0 + np.exp(-fixed.odds[part]))
    same = (grid.known == known) & (grid.updated_s == fixed.stamps[part])
    same &= np.abs(grid.probability - probability) < 1e-5  # single precision
    return int((~same).sum())


def shift_time_us(side: int) -> tuple[float, float]:
    """Median times of a shift by one cell, and of copying the same layers instead, us."""
    grid = EgocentricGrid(GridConfig(side_m=side * 0.05), np.zeros(2))
    layers = list(grid.snapshot().values())[4:]
    times_us: dict[str, list[float]] = {"shift": [], "copy": []}
    for k in range(TIMED):
        step = np.array([0.05, 0.0]) if k % 2 else np.array([0.0, -0.05])
        begin = time.perf_counter_ns()
        grid.shift(step)
        middle = time.perf_counter_ns()
        for layer in layers:
            layer[:, :-1] = layer[:, 1:].copy()
        end = time.perf_counter_ns()
        times_us["shift"].append((middle - begin) / 1e3)
        times_us["copy"].append((end - middle) / 1e3)
    return float(np.median(times_us["shift"])), float(np.median(times_us["copy"]))


def run(seeds: int, say: Say) -> Outcome:
    """One walk per seed, with the worst of each figure; then the time of a shift for each grid size."""
    walks = []
    for seed in range(seeds):
        say(f"walk {seed + 1} of {seeds}")
        walks.append(walk(seed))
    figures = {name: max(w[name] for w in walks) for name in walks[0]}
    table = ["cells   shift us   copy us"]
    for side in SIDES:
        say(f"shifts of {side} cells")
        shift, copy = shift_time_us(side)
        figures[f"shift_us_{side}"], figures[f"copy_us_{side}"] = shift, copy
        table.append(f"{side:5d} {shift:10.1f} {copy:9.1f}")
    first, last = SIDES[0], SIDES[-1]
    figures["shift_growth"] = figures[f"shift_us_{last}"] / figures[f"shift_us_{first}"]
    figures["copy_growth"] = figures[f"copy_us_{last}"] / figures[f"copy_us_{first}"]
    table.append(
        f"a side {last / first:.1f} times as long gives {(last / first) ** 2:.0f} times as many cells"
    )
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="003-E3",
    title="The egocentric grid equals a fixed map over 1000 random steps, without copying cells",
    run=run,
    targets={
        "offset_error_m": Target("<", 1e-9),
        "wrong_cells": Target("==", 0.0),
        "outside_cell_m": Target("<", 1e-9),
    },
    seeds=5,
)
