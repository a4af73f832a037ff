"""Sigma-point filters of many obstacles, against filterpy with one filter per obstacle.

Both use the same filter: constant velocity, one prediction and one measured position per step, the same sigma
points. Ours updates all obstacles in one compiled call; filterpy runs in its fastest form, with plain differences
and means. Measurements of range and bearing are compared, too; there both average the bearing on the circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from perception.filtering.models import sighting_difference, sighting_mean, spread
from perception.filtering.square_root import SigmaPoints, step_movers

from .benchmark import Benchmark, Comparison, race

STEPS = {1: 400, 16: 60, 100: 15}  # steps of a run by number of obstacles, long enough to be timed
DT_S = 0.1
VIEWPOINT = np.array([-1.0, -2.0, 0.3])
POINTS = SigmaPoints.scaled(4)
F = np.eye(4) + DT_S * np.eye(4, k=2)
PUSH = np.array([[DT_S**2 / 2, 0.0], [0.0, DT_S**2 / 2], [DT_S, 0.0], [0.0, DT_S]])
Q = 0.1**2 * PUSH @ PUSH.T + 1e-9 * np.eye(4)
R = {"position": np.diag([0.05, 0.05]) ** 2, "polar": np.diag([0.05, 0.02]) ** 2}
P0 = np.diag([0.3, 0.3, 0.1, 0.1]) ** 2


def seen(kind: str, state: np.ndarray) -> np.ndarray:
    """Measurement of a state: x and y, or range and bearing from the viewpoint."""
    if kind == "position":
        return state[:2]
    x, y = state[0] - VIEWPOINT[0], state[1] - VIEWPOINT[1]
    return np.array([math.hypot(x, y), math.atan2(y, x) - VIEWPOINT[2]])


def scene(kind: str, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Initial means (count, 4) in front of the viewpoint, and measurements (steps, count, 2)."""
    true = np.column_stack([rng.uniform(1.0, 4.0, (count, 2)), rng.normal(0.0, 0.1, (count, 2))])
    start = true + rng.normal(size=true.shape) @ np.sqrt(P0)
    rows = []
    for _ in range(STEPS[count]):
        true = true @ F.T
        noise = rng.normal(size=(count, 2)) @ np.sqrt(R[kind])
        rows.append(np.array([seen(kind, state) for state in true]) + noise)
    return start, np.array(rows)


def ours(kind: str, start: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, 4) and covariances (n, 4, 4) after all steps."""
    means, roots = start, np.tile(np.linalg.cholesky(P0), (len(start), 1, 1))
    noise = np.tile(R[kind], (len(start), 1, 1))
    viewpoint = None if kind == "position" else VIEWPOINT
    for row in measured:
        means, roots, _ = step_movers(means, roots, DT_S, Q, row, noise, viewpoint, POINTS)
    return means, roots @ roots.transpose(0, 2, 1)


def peers(kind: str, start: np.ndarray) -> list[Any]:
    """One filterpy filter per obstacle."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    filters = []
    for _ in start:
        points = MerweScaledSigmaPoints(4, spread(4), 2.0, 0.0)
        circle = (
            {"z_mean_fn": sighting_mean, "residual_z": sighting_difference}
            if kind == "polar"
            else {}
        )
        filters.append(
            UnscentedKalmanFilter(
                4, 2, DT_S, partial(seen, kind), lambda state, dt: F @ state, points, **circle
            )
        )
    return filters


def theirs(
    kind: str, filters: list[Any], start: np.ndarray, measured: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Means and covariances of filterpy after all steps."""
    for one, mean in zip(filters, start, strict=True):
        one.x, one.P, one.Q, one.R = mean.copy(), P0.copy(), Q, R[kind]
    for row in measured:
        for one, z in zip(filters, row, strict=True):
            one.predict()
            one.update(z)
    return np.array([one.x for one in filters]), np.array([one.P for one in filters])


def run() -> Comparison:
    """1, 16 and 100 obstacles; times are those of one step of all obstacles."""
    rng = np.random.default_rng(0)
    times: dict[str, float] = {}
    ratios: dict[str, float] = {}
    worst = 0.0
    for kind in ("position", "polar"):
        for count, steps in STEPS.items():
            start, measured = scene(kind, count, rng)
            filters = peers(kind, start)
            candidates: dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]] = {
                "ours": partial(ours, kind, start, measured),
                "filterpy": partial(theirs, kind, filters, start, measured),
            }
            mine, peer = (candidate() for candidate in candidates.values())
            worst = max(
                worst, *(float(np.abs(a - b).max()) for a, b in zip(mine, peer, strict=True))
            )
            taken = race(candidates, rounds=9)
            name = f"{count}" if kind == "position" else f"polar_{count}"
            ratios[f"ratio_filterpy_{name}"] = taken["filterpy"] / taken["ours"]
            times.update({f"{who}_{name}_ms": value / steps for who, value in taken.items()})
    return Comparison(times, ratios, {"largest_difference": worst})


BENCHMARK = Benchmark(
    "ukf",
    "Sigma-point filters of 1, 16 and 100 obstacles, one step",
    run,
    {"ratio_filterpy_1": 30.0, "ratio_filterpy_16": 80.0, "ratio_filterpy_100": 80.0},
)
