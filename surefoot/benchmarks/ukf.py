"""Sigma-point filters of many obstacles, against filterpy with one filter per obstacle.

Both use the same filter: constant velocity, one prediction and one measured position per step, the same sigma
points. Ours updates all obstacles in one compiled call; filterpy runs in its fastest form, with plain differences
and means. Measurements of range and bearing are compared, too; there both average the bearing on the circle.

Positions are linear in the state, and a Kalman filter of all obstacles at once in NumPy gives the same numbers: it is
the hardest peer there. For ranges and bearings it is the same sigma-point filter of all obstacles at once in NumPy.
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


def batched_linear(start: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kalman filters of all obstacles at once; means and covariances after all steps."""
    x, P = start.copy(), np.tile(P0, (len(start), 1, 1))
    for row in measured:
        x = x @ F.T
        P = F @ P @ F.T + Q
        S = P[:, :2, :2] + R["position"]
        a, b, d = S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]
        inverse = np.stack([d, -b, -b, a], axis=-1).reshape(-1, 2, 2)
        inverse /= (a * d - b * b)[:, None, None]
        K = P[:, :, :2] @ inverse
        x = x + (K @ (row - x[:, :2])[..., None])[..., 0]
        P = P - K @ P[:, :2, :]
    return x, P


def batched_sigma_points(start: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sigma-point filters of all obstacles at once, for ranges and bearings."""
    x, P = start.copy(), np.tile(P0, (len(start), 1, 1))
    reach, of_mean, of_covariance = POINTS
    for row in measured:
        x = x @ F.T
        P = F @ P @ F.T + Q
        spread_out = reach * np.linalg.cholesky(P).transpose(0, 2, 1)
        middle = x[:, None]
        points = np.concatenate([middle, middle + spread_out, middle - spread_out], axis=1)
        offset = points[..., :2] - VIEWPOINT[:2]
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) - VIEWPOINT[2]
        far = np.hypot(offset[..., 0], offset[..., 1])
        turned = np.arctan2(np.sin(bearing) @ of_mean, np.cos(bearing) @ of_mean)
        expected = np.stack([far @ of_mean, turned], axis=-1)
        away = np.stack([far, bearing], axis=-1) - expected[:, None]
        away[..., 1] -= 2.0 * np.pi * np.round(away[..., 1] / (2.0 * np.pi))
        weighted = away * of_covariance[:, None]
        S = away.transpose(0, 2, 1) @ weighted + R["polar"]
        K = (points - middle).transpose(0, 2, 1) @ weighted @ np.linalg.inv(S)
        off = row - expected
        off[:, 1] -= 2.0 * np.pi * np.round(off[:, 1] / (2.0 * np.pi))
        x = x + (K @ off[..., None])[..., 0]
        P = P - K @ S @ K.transpose(0, 2, 1)
    return x, P


def run() -> Comparison:
    """1, 16 and 100 obstacles; times are those of one step of all obstacles."""
    rng = np.random.default_rng(0)
    times: dict[str, float] = {}
    ratios: dict[str, float] = {}
    worst = 0.0
    batched = {"position": batched_linear, "polar": batched_sigma_points}
    for kind, in_numpy in batched.items():
        for count, steps in STEPS.items():
            start, measured = scene(kind, count, rng)
            filters = peers(kind, start)
            candidates: dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]] = {
                "ours": partial(ours, kind, start, measured),
                "filterpy": partial(theirs, kind, filters, start, measured),
                "numpy": partial(in_numpy, start, measured),
            }
            mine, *others = (candidate() for candidate in candidates.values())
            for peer in others:
                off = (float(np.abs(a - b).max()) for a, b in zip(mine, peer, strict=True))
                worst = max(worst, *off)
            taken = race(candidates, rounds=9)
            name = f"{count}" if kind == "position" else f"polar_{count}"
            ratios[f"ratio_filterpy_{name}"] = taken["filterpy"] / taken["ours"]
            ratios[f"ratio_numpy_{name}"] = taken["numpy"] / taken["ours"]
            times.update({f"{who}_{name}_ms": value / steps for who, value in taken.items()})
    fair = {
        f"NumPy for {count} {kind} at once": ratios[f"ratio_numpy_{prefix}{count}"]
        for kind, prefix in (("positions", ""), ("ranges and bearings", "polar_"))
        for count in STEPS
    }
    return Comparison(times, ratios, {"largest_difference": worst}, fair)


BENCHMARK = Benchmark(
    "ukf",
    "Sigma-point filters of 1, 16 and 100 obstacles, one step",
    run,
    {"ratio_filterpy_1": 30.0, "ratio_filterpy_16": 80.0, "ratio_filterpy_100": 80.0},
    {"largest_difference": 1e-9},
)
