"""The search against Dijkstra's algorithm, on random terrain of the seed's size.

The oracle is scipy's Dijkstra over the whole 8-neighbour graph, with the edges weighed anew; clearance is
judged by scipy's distance transform. Each terrain is asked twice: for a goal on the map, and for one beyond
it, where the border cell of least F on the sides that face the goal is due, or else on any side.
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

from ..support.experiment import Experiment, Outcome, Say, Target
from . import random_terrain
from .random_terrain import CELL_M, Grid

SIDE = 71  # cells: the seed's 3.5 m at 5 cm
ORIGIN = np.zeros(2)
BEYOND_M = 2.0  # how far off the map the second goal lies, at least


class Answer(NamedTuple):
    """A path, what it should have cost, in m, and the processor time it took, ms."""

    path: Path | None
    cost_m: float
    least_m: float
    taken_ms: float


def terrains(count: int) -> list[Grid]:
    """The terrains of this experiment and the next."""
    return [random_terrain.make(SIDE, np.random.default_rng([71, k])) for k in range(count)]


def ground_of(grid: Grid, config: SearchConfig) -> Terrain:
    """The grid made ready for the search."""
    return prepare(grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, config)


def costs_m(ground: Terrain, start: tuple[int, int]) -> np.ndarray:
    """Least cost from the start to every node, m, by Dijkstra's algorithm; infinite where none leads."""
    rows, columns = ground.price.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    ends, weights = [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: rows - down, max(0, -right) : columns - max(0, right)]
        b = np.s_[down:, max(0, right) : columns + min(0, right)]
        free = ~(ground.blocked[a] | ground.blocked[b])
        price = (ground.price[a] + ground.price[b]) / 2
        ends.append(np.stack([index[a][free], index[b][free]]))
        weights.append(price[free] * math.hypot(down, right) * CELL_M)
    graph = coo_array(
        (np.concatenate(weights), tuple(np.concatenate(ends, axis=1))), shape=(rows * columns,) * 2
    )
    return dijkstra(graph.tocsr(), directed=False, indices=index[start]).reshape(rows, columns)


def ask(grid: Grid, goal: np.ndarray, config: SearchConfig) -> Answer:
    """The way to a goal; cost and least cost are F where the goal lies beyond the map."""
    begin = time.process_time()
    path = find_path(grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, goal, config)
    taken = 1e3 * (time.process_time() - begin)
    ground = ground_of(grid, config)
    start = _cell(grid.start)
    if ground.blocked[start]:  # the nearest free node is a matter of taste: take the path's own
        start = _cell(grid.start) if path is None else tuple(path.cells[0].tolist())
    reached = costs_m(ground, start)
    reached[ground.blocked] = np.inf
    end = _cell(goal)
    if min(end) >= 0 and max(end) < SIDE:
        least = (
            reached[end] if path is None or not ground.blocked[end] else reached[*path.cells[-1]]
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
            cost = lattice_cost(path.cells, ground.price) * CELL_M + float(rest[*path.cells[-1]])
    return Answer(path, cost, float(least), taken)


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
    """Nodes of the path, and points every half cell of the way, in cells within r_b of a solid one.

    A point on the border of two cells is in both, and counts only if both are too near.
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
    """From every cell's middle to the nearest solid one's, m."""
    solid = ~grid.unknown & (grid.probability >= config.p_solid)
    if not solid.any():
        return np.full(solid.shape, np.inf)
    return np.asarray(distance_transform_edt(~solid)) * CELL_M


def beyond(grid: Grid) -> np.ndarray:
    """A goal off the map, straight on from the start over the first goal."""
    way = grid.goal - grid.start
    return grid.goal + way / float(np.hypot(*way)) * (BEYOND_M + SIDE * CELL_M / 8)


def run(seeds: int, say: Say) -> Outcome:
    """As many terrains as seeds."""
    config, literal = SearchConfig(), SearchConfig(literal=True)
    grids = terrains(seeds)
    ask(grids[0], grids[0].goal, config)  # nobody waits for the compiler
    ratios, literal_ratios, taken, clearances = [], [], [], []
    wrong = lost = found = 0
    for k, grid in enumerate(grids):
        say(f"terrain {k + 1} of {seeds}")
        for goal in (grid.goal, beyond(grid)):
            answer = ask(grid, goal, config)
            taken.append(answer.taken_ms)
            lost += (answer.path is None) != math.isinf(answer.least_m)
            if answer.path is None:
                continue
            found += 1
            ratios.append(answer.cost_m / answer.least_m)
            wrong += violations(answer.path, grid, config)
            clearances.append(answer.path.clearance_m)
            if goal is grid.goal:
                literal_ratios.append(ask(grid, goal, literal).cost_m / answer.least_m)
    figures = {
        "cost_ratio_to_dijkstra": max(ratios),
        "cost_ratio_least": min(ratios),
        "violations": float(wrong),
        "missed_or_invented_paths": float(lost),
        "slowest_ms": max(taken),
        "median_ms": float(np.median(taken)),
        "paths": float(found),
        "least_clearance_m": min(clearances),
        "literal_cost_ratio_mean": float(np.mean(literal_ratios)),
        "literal_cost_ratio_worst": max(literal_ratios),
    }
    table = [
        f"{found} paths over {seeds} terrains of {SIDE}x{SIDE} cells, goal on the map and beyond"
    ]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="003-E4",
    title="The path costs what Dijkstra's does, and stays clear",
    run=run,
    targets={
        "cost_ratio_to_dijkstra": Target("<=", 1.0 + 1e-6),
        "violations": Target("==", 0.0),
        "missed_or_invented_paths": Target("==", 0.0),
        "slowest_ms": Target("<=", 100.0),
    },
    seeds=500,
)
