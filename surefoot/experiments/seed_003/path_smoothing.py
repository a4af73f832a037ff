"""Shortcuts and rounded corners of the lattice path, on the terrains of 003-E4.

Costs before and after smoothing are the same line integral of length and potential. The curve consists of straight
lines and arcs of at least the gait's turning radius; at a remaining corner the robot turns on the spot.

Source: seed 003, section 3, experiment E5.
"""

from __future__ import annotations

import math

import numpy as np

from perception.primitives.robot_model import DARWIN_OP
from planning.search.astar import find_path
from planning.search.potential import Reach, SearchConfig
from planning.search.shortcuts import total_turning

from ..support.experiment import Experiment, Outcome, Say, Target
from ..support.random_terrain import CELL_M
from .path_search import ORIGIN, prepared_terrain, terrains, violations

CHORD_M = 0.045  # chords of arcs are shorter than this, segments of a lattice path longer


def arc_radii_m(curve: np.ndarray) -> list[float]:
    """Radius of the circle through each three consecutive points on an arc, m."""
    radii = []
    for a, b, c in zip(curve[:-2], curve[1:-1], curve[2:], strict=True):
        u, v = b - a, c - b
        lengths = float(np.hypot(*u)), float(np.hypot(*v)), float(np.hypot(*(c - a)))
        area = abs(float(u[0] * v[1] - u[1] * v[0])) / 2
        if 0.0 < max(lengths[:2]) < CHORD_M and area > 1e-9:
            radii.append(math.prod(lengths) / (4 * area))
    return radii


def run(seeds: int, say: Say) -> Outcome:
    """One terrain per seed."""
    config = SearchConfig()
    turning: dict[str, float] = {"path": 0.0, "shortcut": 0.0, "curve": 0.0}
    ratios, curve_ratios, radii = [], [], []
    wrong = bends = stops = 0
    for k, grid in enumerate(terrains(seeds)):
        say(f"terrain {k + 1} of {seeds}")
        path = find_path(
            grid.probability, grid.unknown, ORIGIN, CELL_M, grid.start, grid.goal, config
        )
        if path is None or len(path.cells) < 2:
            continue
        terrain = prepared_terrain(grid, config)
        line = (path.cells[:, ::-1] + 0.5) * CELL_M
        for name, points in (("path", line), ("shortcut", path.waypoints), ("curve", path.curve)):
            turning[name] += total_turning(points)
        before = terrain.cost_m(line)
        ratios.append(terrain.cost_m(path.waypoints) / before)
        curve_ratios.append(terrain.cost_m(path.curve) / before)
        radii += arc_radii_m(path.curve)
        wrong += violations(path, grid, config)
        bends += len(path.waypoints) - 2
        stops += path.corners
    figures = {
        "turning_reduction_pct": 100 * (1 - turning["shortcut"] / turning["path"]),
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
        f"mean turning of {len(ratios)} paths: lattice {math.degrees(turning['path']) / len(ratios):.0f} deg, "
        f"shortcuts {math.degrees(turning['shortcut']) / len(ratios):.0f} deg, "
        f"curve {math.degrees(turning['curve']) / len(ratios):.0f} deg",
    ]
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="003-E5",
    title="Shortcuts halve the turning and never increase the cost",
    run=run,
    targets={
        "turning_reduction_pct": Target(">=", 50.0),
        "cost_ratio": Target("<=", 1.0),
        "violations": Target("==", 0.0),
        "curve_cost_ratio": Target("<=", 1.0),
        "least_arc_radius_m": Target(">=", Reach.of(SearchConfig(), DARWIN_OP).turn_m - 1e-9),
    },
    seeds=500,
)
