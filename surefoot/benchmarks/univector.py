"""Univector field on a grid, against the same formulas in NumPy.

A grid of 200 x 200 points with 16 obstacles, seed 001, eq. (8) to (10): NumPy evaluates all points at once, one
obstacle after the other, with angles. The hardest peer is the same formula compiled by Numba. The field at a single
pose is timed, too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from planning.univector import fields

from ._peer_kernels import field
from .benchmark import Benchmark, Comparison, mean_ratio, race

SIDE = 200
OBSTACLES = 16
EXTENT_M = 6.0
ROUNDS = 15


def in_numpy(
    places: np.ndarray,
    goal: np.ndarray,
    goal_heading: float,
    centres: np.ndarray,
    radii: np.ndarray,
    config: fields.FieldConfig,
) -> np.ndarray:
    """u_T with angles, on whole arrays."""
    to_goal = goal - places
    rho_rg = np.hypot(to_goal[:, 0], to_goal[:, 1])
    th_rd = np.arctan2(to_goal[:, 1], to_goal[:, 0])
    phi = np.where(rho_rg > config.d_con_m, th_rd, th_rd + -1.0 * (goal_heading - th_rd))
    towards = np.column_stack([np.cos(phi), np.sin(phi)])
    total = np.zeros_like(places)
    for centre, radius in zip(centres, radii, strict=True):
        p_or, p_od = places - centre, goal - centre
        rho = np.hypot(p_or[:, 0], p_or[:, 1])
        th_or = np.arctan2(p_or[:, 1], p_or[:, 0])
        share = np.where(
            rho < radius + config.d_e_m,
            (rho - radius) / config.d_e_m,
            2.0 - (radius + config.d_e_m + fields.K_R_M) / (rho + fields.K_R_M),
        )
        sign = np.where(p_od[0] * p_or[:, 1] - p_od[1] * p_or[:, 0] < 0.0, 1.0, -1.0)
        inside = rho < radius
        angle = th_or + np.where(inside, 0.0, sign * 0.5 * np.pi * share)
        counts = (rho <= radius + config.d_e_m + config.d_b_m) & (
            inside
            | ((rho_rg + radius >= np.hypot(*p_od)) & (np.sum(-p_or * to_goal, axis=1) > 0.0))
        )
        total += np.where(counts[:, None], np.column_stack([np.cos(angle), np.sin(angle)]), 0.0)
    size = np.hypot(total[:, 0], total[:, 1])
    matters = size >= 1e-9
    unit = total / np.where(matters, size, 1.0)[:, None]
    mixed = config.w_goal * towards + config.w_avoid * unit
    return np.where(matters[:, None], mixed, towards)


def compiled(
    places: np.ndarray,
    goal: np.ndarray,
    goal_heading: float,
    centres: np.ndarray,
    radii: np.ndarray,
    config: fields.FieldConfig,
) -> np.ndarray:
    """The same in one compiled loop."""
    lengths = config.d_con_m, config.d_e_m, config.d_b_m, fields.K_R_M
    result = np.empty_like(places)
    field(
        places,
        goal,
        goal_heading,
        centres,
        radii,
        lengths,
        (config.w_goal, config.w_avoid),
        result,
    )
    return result


def run() -> Comparison:
    """Three random worlds; the ratios are geometric means."""
    config = fields.FieldConfig()
    axis = np.linspace(0.0, EXTENT_M, SIDE)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    times: dict[str, list[float]] = {}
    ratios: dict[str, list[float]] = {}
    apart = 0.0
    for seed in range(3):
        rng = np.random.default_rng([seed, 60])
        goal, heading = rng.uniform(1.0, 5.0, 2), float(rng.uniform(-np.pi, np.pi))
        centres, radii = rng.uniform(0.0, EXTENT_M, (OBSTACLES, 2)), rng.uniform(0.2, 0.35, 16)
        rest = goal, heading, centres, radii, config
        pose = places[[20_000]]
        candidates: dict[str, Callable[[], np.ndarray]] = {
            "ours_ms": partial(fields.total, places, *rest),
            "numpy_ms": partial(in_numpy, places, *rest),
            "numba_ms": partial(compiled, places, *rest),
            "ours_one_pose_ms": partial(fields.total, pose, *rest),
            "numpy_one_pose_ms": partial(in_numpy, pose, *rest),
        }
        found = race(candidates, ROUNDS)
        for name, value in found.items():
            times.setdefault(name, []).append(value)
        for name, ours in (
            ("numpy", "ours"),
            ("numba", "ours"),
            ("numpy_one_pose", "ours_one_pose"),
        ):
            ratios.setdefault(name, []).append(found[f"{name}_ms"] / found[f"{ours}_ms"])
        for name in ("numpy_ms", "numba_ms"):
            off = np.abs(candidates["ours_ms"]() - candidates[name]())
            apart = max(apart, float(np.quantile(off, 0.9999)))
    means = {name: mean_ratio(values) for name, values in ratios.items()}
    return Comparison(
        {name: float(np.median(values)) for name, values in times.items()},
        {f"ratio_{name}": value for name, value in means.items()},
        {"apart_of_unit": apart},
        {"the same formula under Numba": means["numba"]},
    )


BENCHMARK = Benchmark(
    "univector",
    "Univector field at 200 x 200 points among 16 obstacles",
    run,
    {"ratio_numpy": 15.0},
    {"apart_of_unit": 1e-9},
)
