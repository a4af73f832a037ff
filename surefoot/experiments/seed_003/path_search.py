"""The path search against Dijkstra's algorithm, on random terrain of seed 003's size.

The reference is scipy's Dijkstra over the whole 8-neighbour graph with independently computed edge costs; clearance
is checked by scipy's distance transform. Each terrain has two goals: one on the map, and one beyond it, for which
the correct end is the border cell of least F on the sides that face the goal, or else on any side.

Source: seed 003, section 3, experiment E4.
"""

from __future__ import annotations

import itertools
import math
import time
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from planning.search.astar import Path, Terrain, find_path, lattice_cost, prepare
from planning.search.potential import BODY_M, SearchConfig

from ..support import random_terrain
from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.random_terrain import CELL_M, Grid

SIDE = 71  # cells: seed 003's 3.5 m at 5 cm
ORIGIN = np.zeros(2)
BEYOND_M = 2.0  # least distance of the second goal from the map


class Solution(NamedTuple):
    """A path, its cost and the least cost, m, and the processor time of the search, ms."""

    path: Path | None
    cost_m: float
    least_m: float
    time_ms: float


def terrains(count: int) -> list[Grid]:
    """The terrains of this experiment and the next."""
    return [random_terrain.make(SIDE, np.random.default_rng([71, k])) for k in range(count)]


def prepared_terrain(grid: Grid, config: SearchConfig) -> Terrain:
    """The grid preprocessed for the search."""
    return prepare(grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, config)


def costs_m(terrain: Terrain, start: tuple[int, int]) -> np.ndarray:
    """Least cost from the start to every node by Dijkstra's algorithm, m; infinite if unreachable."""
    rows, columns = terrain.price.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    ends, weights = [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: rows - down, max(0, -right) : columns - max(0, right)]
        b = np.s_[down:, max(0, right) : columns + min(0, right)]
        free = ~(terrain.blocked[a] | terrain.blocked[b])
        price = (terrain.price[a] + terrain.price[b]) / 2
        ends.append(np.stack([index[a][free], index[b][free]]))
        weights.append(price[free] * math.hypot(down, right) * CELL_M)
    graph = coo_array(
        (np.concatenate(weights), tuple(np.concatenate(ends, axis=1))), shape=(rows * columns,) * 2
    )
    return dijkstra(graph.tocsr(), directed=False, indices=index[start]).reshape(rows, columns)


def solve(grid: Grid, goal: np.ndarray, config: SearchConfig) -> Solution:
    """Search a path and compute the least cost; both costs are F if the goal lies beyond the map."""
    begin = time.process_time()
    path = find_path(grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, goal, config)
    times_ms = 1e3 * (time.process_time() - begin)
    terrain = prepared_terrain(grid, config)
    start = _cell(grid.start)
    if terrain.blocked[start]:  # several free nodes may be nearest: take the path's own
        start = _cell(grid.start) if path is None else tuple(path.cells[0].tolist())
    reached = costs_m(terrain, start)
    reached[terrain.blocked] = np.inf
    end = _cell(goal)
    if min(end) >= 0 and max(end) < SIDE:
        least = (
            reached[end] if path is None or not terrain.blocked[end] else reached[*path.cells[-1]]
        )
        cost = math.inf if path is None else path.cost_m
    else:
        rows, columns = np.indices(reached.shape)
        rest = np.hypot((columns + 0.5) * CELL_M - goal[0], (rows + 0.5) * CELL_M - goal[1])
        total = np.where(_facing(goal), reached + rest, np.inf)
        if math.isinf(total.min()):
            total = np.where(_facing(None), reached + rest, np.inf)
        least = float(total.min())
        cost = math.inf
        if path is not None:
            cost = lattice_cost(path.cells, terrain.price) * CELL_M + float(rest[*path.cells[-1]])
    return Solution(path, cost, float(least), times_ms)


def _cell(xy: np.ndarray) -> tuple[int, int]:
    column, row = np.floor(xy / CELL_M).astype(int)
    return int(row), int(column)


def _facing(goal: np.ndarray | None) -> np.ndarray:
    """Border cells on the sides that the goal lies beyond; the whole border for None."""
    exits = np.zeros((SIDE, SIDE), np.bool_)
    side = SIDE * CELL_M
    exits[0] |= goal is None or goal[1] < 0
    exits[-1] |= goal is None or goal[1] >= side
    exits[:, 0] |= goal is None or goal[0] < 0
    exits[:, -1] |= goal is None or goal[0] >= side
    return exits


def violations(path: Path, grid: Grid, config: SearchConfig) -> int:
    """Number of path nodes, and of points every half cell along it, in cells within r_b of a solid cell.

    A point on the border of two cells lies in both, and counts only if both are too near.
    """
    near = clearance_m(grid, config) <= BODY_M
    count = int(near[*path.cells.T].sum())
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * 1e-6 * CELL_M
    for line in (path.waypoints, path.curve):
        for begin, end in itertools.pairwise(line):
            pieces = max(1, math.ceil(float(np.hypot(*(end - begin))) / (CELL_M / 2) - 1e-9))
            for point in begin + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (end - begin):
                count += all(near[_cell(point + corner)] for corner in corners)
    return count


def clearance_m(grid: Grid, config: SearchConfig) -> np.ndarray:
    """Distance from every cell's centre to that of the nearest solid cell, m."""
    solid = ~grid.unknown & (grid.probability >= config.p_solid)
    if not solid.any():
        return np.full(solid.shape, np.inf)
    return np.asarray(distance_transform_edt(~solid)) * CELL_M


def goal_beyond(grid: Grid) -> np.ndarray:
    """A goal beyond the map, on the line from the start through the first goal."""
    line = grid.goal - grid.start
    return grid.goal + line / float(np.hypot(*line)) * (BEYOND_M + SIDE * CELL_M / 8)


def run(seeds: int, say: Say) -> Outcome:
    """One terrain per seed."""
    config, literal = SearchConfig(), SearchConfig(literal=True)
    grids = terrains(seeds)
    solve(grids[0], grids[0].goal, config)  # compile before timing
    ratios, literal_ratios, times_ms, clearances = [], [], [], []
    wrong = lost = found = 0
    for k, grid in enumerate(grids):
        say(f"terrain {k + 1} of {seeds}")
        for goal in (grid.goal, goal_beyond(grid)):
            answer = solve(grid, goal, config)
            times_ms.append(answer.time_ms)
            lost += (answer.path is None) != math.isinf(answer.least_m)
            if answer.path is None:
                continue
            found += 1
            ratios.append(answer.cost_m / answer.least_m)
            wrong += violations(answer.path, grid, config)
            clearances.append(answer.path.clearance_m)
            if goal is grid.goal:
                literal_ratios.append(solve(grid, goal, literal).cost_m / answer.least_m)
    figures = {
        "cost_ratio_to_dijkstra": max(ratios),
        "cost_ratio_least": min(ratios),
        "violations": float(wrong),
        "missed_or_invented_paths": float(lost),
        "slowest_ms": max(times_ms),
        "median_ms": float(np.median(times_ms)),
        "paths": float(found),
        "least_clearance_m": min(clearances),
        "literal_cost_ratio_mean": float(np.mean(literal_ratios)),
        "literal_cost_ratio_worst": max(literal_ratios),
    }
    table = [
        f"{found} paths over {seeds} terrains of {SIDE}x{SIDE} cells, goal on the map and beyond it"
    ]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="003-E4",
    title="Paths cost as much as Dijkstra's, and keep their clearance",
    run=run,
    targets={
        "cost_ratio_to_dijkstra": Target("<=", 1.0 + 1e-6),
        "violations": Target("==", 0.0),
        "missed_or_invented_paths": Target("==", 0.0),
        "slowest_ms": Target("<=", 100.0),
    },
    seeds=500,
)
