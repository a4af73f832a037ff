"""Shortcuts and round corners: the lattice path straightened, on the terrains of 003-E4.

Costs before and after are the same line integral of length and potential, of the lattice path and of what
became of it. The curve is what the gait can walk: arcs of at least its radius; a corner that it still has
is one to turn at on the spot.
"""

from __future__ import annotations

import math

import numpy as np

from planning.search.astar import find_path
from planning.search.potential import TURN_M, SearchConfig
from planning.search.shortcuts import total_turning

from ..support.experiment import Experiment, Outcome, Say, Target
from .path_search import ORIGIN, ground_of, terrains, violations
from .random_terrain import CELL_M

CHORD_M = 0.045  # chords of arcs are shorter, pieces of a lattice path are not


def arc_radii_m(curve: np.ndarray) -> list[float]:
    """Radius of the circle through each three points in a row that lie on an arc, m."""
    radii = []
    for a, b, c in zip(curve[:-2], curve[1:-1], curve[2:], strict=True):
        u, v = b - a, c - b
        lengths = float(np.hypot(*u)), float(np.hypot(*v)), float(np.hypot(*(c - a)))
        area = abs(float(u[0] * v[1] - u[1] * v[0])) / 2
        if 0.0 < max(lengths[:2]) < CHORD_M and area > 1e-9:
            radii.append(math.prod(lengths) / (4 * area))
    return radii


def run(seeds: int, say: Say) -> Outcome:
    """As many terrains as seeds."""
    config = SearchConfig()
    turning: dict[str, float] = {"path": 0.0, "way": 0.0, "curve": 0.0}
    ratios, curve_ratios, radii = [], [], []
    wrong = bends = stops = 0
    for k, grid in enumerate(terrains(seeds)):
        say(f"terrain {k + 1} of {seeds}")
        path = find_path(
            grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, grid.goal, config
        )
        if path is None or len(path.cells) < 2:
            continue
        ground = ground_of(grid, config)
        line = (path.cells[:, ::-1] + 0.5) * CELL_M
        for name, points in (("path", line), ("way", path.waypoints), ("curve", path.curve)):
            turning[name] += total_turning(points)
        before = ground.cost_m(line)
        ratios.append(ground.cost_m(path.waypoints) / before)
        curve_ratios.append(ground.cost_m(path.curve) / before)
        radii += arc_radii_m(path.curve)
        wrong += violations(path, grid, config)
        bends += len(path.waypoints) - 2
        stops += path.corners
    figures = {
        "turning_reduction_pct": 100 * (1 - turning["way"] / turning["path"]),
        "cost_ratio": max(ratios),
        "cost_ratio_mean": float(np.mean(ratios)),
        "violations": float(wrong),
        "curve_turning_reduction_pct": 100 * (1 - turning["curve"] / turning["path"]),
        "curve_cost_ratio": max(curve_ratios),
        "least_arc_radius_m": min(radii, default=math.inf),
        "corners_left_pct": 100 * stops / max(1, bends),
        "paths": float(len(ratios)),
    }
    table = [
        f"turning of {len(ratios)} paths: lattice {math.degrees(turning['path']) / len(ratios):.0f} deg, "
        f"way points {math.degrees(turning['way']) / len(ratios):.0f} deg, "
        f"curve {math.degrees(turning['curve']) / len(ratios):.0f} deg each",
    ]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="003-E5",
    title="Shortcuts take the turning away and never cost more",
    run=run,
    targets={
        "turning_reduction_pct": Target(">=", 50.0),
        "cost_ratio": Target("<=", 1.0),
        "violations": Target("==", 0.0),
        "curve_cost_ratio": Target("<=", 1.0),
        "least_arc_radius_m": Target(">=", TURN_M - 1e-9),
    },
    seeds=500,
)
