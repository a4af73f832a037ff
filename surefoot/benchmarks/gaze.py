"""Gaze map with the true field of view, against NumPy broadcasting over all directions and points.

61 x 31 directions, 300 points on the ground. NumPy gets the rotation of every direction precomputed and tests all
points against the four sides of the view at once; both give the same result.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from perception.primitives.pose import head_rotation
from perception.primitives.robot_model import HeadLimits
from planning.gaze.selection import GazeMapConfig, shown

from .benchmark import Benchmark, Comparison, race

PLACES = 300
EYE_M = 0.38
ROUNDS = 11


def in_numpy(
    places: np.ndarray,
    weights: np.ndarray,
    rotations: np.ndarray,
    across: float,
    down: float,
) -> np.ndarray:
    """Weight in view for every direction; rotations (p, t, 3, 3), tangents of half the field of view."""
    right, down_, forward = np.moveaxis(np.einsum("nk,ptkj->ptnj", places, rotations), -1, 0)
    inside = (np.abs(right) <= across * forward) & (np.abs(down_) <= down * forward)
    return np.asarray((inside * weights).sum(axis=-1))


def run() -> Comparison:
    """Three random sets of points; the ratio is the geometric mean."""
    config = GazeMapConfig(head=HeadLimits(60.0, (0.0, 60.0)), step_deg=2.0)
    pans, tilts = config.pans, config.tilts
    rotations = np.array([[head_rotation(float(p), float(t)) for t in tilts] for p in pans])
    across, down = (math.tan(math.radians(a) / 2) for a in (config.across_deg, config.down_deg))
    times: dict[str, list[float]] = {}
    differ = 0.0
    for seed in range(3):
        rng = np.random.default_rng([seed, 61])
        away, bearing = (
            rng.uniform(0.3, 1.3, PLACES),
            rng.uniform(-math.pi / 2, math.pi / 2, PLACES),
        )
        places = np.column_stack(
            [away * np.cos(bearing), away * np.sin(bearing), np.full(PLACES, -EYE_M)]
        )
        weights = rng.uniform(0.0, 1.0, PLACES)
        ours = partial(shown, places, weights, config)
        theirs = partial(in_numpy, places, weights, rotations, across, down)
        for name, value in race({"ours_ms": ours, "numpy_ms": theirs}, ROUNDS).items():
            times.setdefault(name, []).append(value)
        off = ~np.isclose(ours(), theirs(), atol=1e-9)
        differ = max(differ, float(off.mean()))
    ratios = np.array(times["numpy_ms"]) / np.array(times["ours_ms"])
    return Comparison(
        {name: float(np.median(values)) for name, values in times.items()},
        {"ratio_numpy": float(np.exp(np.mean(np.log(ratios))))},
        {"directions_that_differ_share": differ},
    )


BENCHMARK = Benchmark(
    "gaze",
    "Gaze map of 61 x 31 directions, true field of view, 300 points",
    run,
    {"ratio_numpy": 10.0},
)
