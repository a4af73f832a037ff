"""Cheapest path on the lattice, against pyastar2d, scikit-image's MCP_Geometric, dijkstra3d and SciPy.

Each candidate gets its input array prepared and returns the path. MCP_Geometric and SciPy's Dijkstra, whose graph is
built beforehand, solve the same problem and must find the same cost. pyastar2d and dijkstra3d solve a simpler one: the
cost of a step is that of the cell it enters, also for a diagonal step; their paths are evaluated with our cost.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from planning.search import astar
from planning.search.potential import SearchConfig

from ..experiments.support import random_terrain
from .benchmark import Benchmark, Comparison, mean_ratio, race

SIDES = (70, 200, 500)
MAPS = 3  # of each size
ROUNDS = 9
TITLES = {
    "pyastar2d": "pyastar2d (simpler cost)",
    "mcp": "MCP_Geometric",
    "dijkstra3d": "dijkstra3d (simpler cost)",
    "scipy": "SciPy's Dijkstra on a prepared graph",
}


def run() -> Comparison:
    """Three maps of each size; the ratios are geometric means over all nine maps."""
    peers, missing = _peers()
    times: dict[str, list[float]] = {}
    ratios: dict[str, list[float]] = {name: [] for name in peers}
    apart = dict.fromkeys(peers, 0.0)
    below = 0.0
    for side in SIDES:
        taken: dict[str, list[float]] = {}
        for number in range(MAPS):
            ground, start, goal = problem(side, np.random.default_rng([side, number]))
            ours = partial(astar.cheapest, ground.price, ground.blocked, start, goal)
            candidates: dict[str, Callable[[], Any]] = {"ours": ours}
            candidates |= {name: make(ground, start, goal) for name, make in peers.items()}
            for name, value in race(candidates, ROUNDS).items():
                taken.setdefault(name, []).append(value)
            cost = astar.lattice_cost(_found(ours()), ground.price)
            for name in peers:
                theirs = astar.lattice_cost(_found(candidates[name]()), ground.price)
                apart[name] = max(apart[name], theirs / cost - 1.0, key=abs)
                below = max(below, 1.0 - theirs / cost)
        for name, values in taken.items():
            times.setdefault(f"{name}_{side}_ms", []).extend(values)
        for name in peers:
            ratios[name] += [t / o for t, o in zip(taken[name], taken["ours"], strict=True)]
    means = {name: mean_ratio(values) for name, values in ratios.items()}
    return Comparison(
        {name: float(np.median(values)) for name, values in times.items()},
        {f"ratio_{name}": value for name, value in means.items()},
        {f"{name}_cost_above_ours": apart[name] for name in peers} | {"any_cost_below_ours": below},
        {TITLES[name]: value for name, value in means.items()},
        missing,
    )


def problem(
    side: int, rng: np.random.Generator
) -> tuple[astar.Terrain, tuple[int, int], tuple[int, int]]:
    """Traversable terrain with start and goal nodes [row, column]."""
    while True:
        grid = random_terrain.make(side, rng)
        ground = astar.prepare(
            grid.probability,
            grid.unknown,
            np.zeros(2),
            random_terrain.CELL_M,
            grid.start,
            SearchConfig(),
        )
        (x0, y0), (x1, y1) = (
            np.rint(ground.to_cells(p)).astype(int) for p in (grid.start, grid.goal)
        )
        start, goal = (int(y0), int(x0)), (int(y1), int(x1))
        if astar.cheapest(ground.price, ground.blocked, start, goal) is not None:
            return ground, start, goal


def _found(cells: np.ndarray | None) -> np.ndarray:
    assert cells is not None, "the terrain has a path"
    return cells


def _peers() -> tuple[dict[str, Callable[..., Callable[[], Any]]], list[str]]:
    """Functions that prepare each installed peer, and the packages that are not installed."""
    found: dict[str, Callable[..., Callable[[], Any]]] = {}
    missing = []
    for name, package, module, make in (
        ("pyastar2d", "pyastar2d", "pyastar2d", _pyastar2d),
        ("mcp", "scikit-image", "skimage.graph", _mcp),
        ("dijkstra3d", "dijkstra3d", "dijkstra3d", _dijkstra3d),
        ("scipy", "scipy", "scipy.sparse.csgraph", _scipy),
    ):
        try:
            found[name] = partial(make, importlib.import_module(module))
        except ImportError:
            missing.append(package)
    return found, missing


def _pyastar2d(peer: Any, ground: astar.Terrain, start: Any, goal: Any) -> Callable[[], Any]:
    weights = np.where(ground.blocked, np.inf, ground.price).astype(np.float32)
    return partial(peer.astar_path, weights, start, goal, allow_diagonal=True)


def _mcp(peer: Any, ground: astar.Terrain, start: Any, goal: Any) -> Callable[[], Any]:
    costs = np.where(ground.blocked, -1.0, ground.price)

    def path() -> np.ndarray:
        search = peer.MCP_Geometric(costs, fully_connected=True)
        search.find_costs([start], [goal])
        return np.array(search.traceback(goal))

    return path


def _dijkstra3d(peer: Any, ground: astar.Terrain, start: Any, goal: Any) -> Callable[[], Any]:
    weights = np.where(ground.blocked, np.inf, ground.price).astype(np.float32)
    return lambda: peer.dijkstra(weights, start, goal, connectivity=8).astype(np.int64)


def _scipy(peer: Any, ground: astar.Terrain, start: Any, goal: Any) -> Callable[[], Any]:
    from scipy.sparse import coo_array

    shape = ground.price.shape
    number = np.arange(ground.price.size).reshape(shape)
    edges = []
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = np.s_[: shape[0] - down, max(0, -across) : shape[1] - max(0, across)]
        there = np.s_[down:, max(0, across) : shape[1] + min(0, across)]
        cost = np.hypot(down, across) * (ground.price[here] + ground.price[there]) / 2
        both = ~ground.blocked[here] & ~ground.blocked[there]
        edges.append(np.stack([number[here][both], number[there][both], cost[both]]))
    i, j, cost = np.concatenate(edges, axis=1)
    graph = coo_array(
        (cost, (i.astype(np.int32), j.astype(np.int32))), (number.size, number.size)
    ).tocsr()
    first, last = int(number[start]), int(number[goal])

    def path() -> np.ndarray:
        before = peer.dijkstra(graph, directed=False, indices=first, return_predecessors=True)[1]
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        return np.stack(np.unravel_index(nodes[::-1], shape), axis=1)

    return path


BENCHMARK = Benchmark(
    "astar",
    "A* with potential on 70, 200 and 500 cells squared",
    run,
    {"ratio_pyastar2d": 1.5, "ratio_mcp": 1.5},
    {"any_cost_below_ours": 1e-5},
)
