"""Cheapest path on the lattice, against pyastar2d and scikit-image's MCP_Geometric.

Each candidate gets its input array prepared and returns the path. MCP_Geometric solves the same problem and must
find the same cost. pyastar2d solves a simpler one: the cost of a step is that of the cell it enters, also for a
diagonal step; its path is evaluated with our cost.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from planning.search import astar
from planning.search.potential import SearchConfig

from ..experiments.seed_003 import random_terrain
from .benchmark import Benchmark, Comparison, race

SIDES = (70, 200, 500)
MAPS = 3  # of each size
ROUNDS = 9


def run() -> Comparison:
    """Three maps of each size; the ratios are geometric means over all nine maps."""
    peers, missing = _peers()
    times: dict[str, list[float]] = {}
    ratios: dict[str, list[float]] = {name: [] for name in peers}
    apart = {"mcp": 0.0, "pyastar2d": 0.0}
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
        for name, values in taken.items():
            times.setdefault(f"{name}_{side}_ms", []).extend(values)
        for name in peers:
            ratios[name] += [t / o for t, o in zip(taken[name], taken["ours"], strict=True)]
    return Comparison(
        {name: float(np.median(values)) for name, values in times.items()},
        {f"ratio_{name}": float(np.exp(np.mean(np.log(v)))) for name, v in ratios.items()},
        {f"{name}_cost_above_ours": apart[name] for name in peers},
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


BENCHMARK = Benchmark(
    "astar",
    "A* with potential on 70, 200 and 500 cells squared",
    run,
    {"ratio_pyastar2d": 1.5, "ratio_mcp": 1.5},
)
