"""Gaze map with the true field of view, against NumPy broadcasting over all directions and points.

61 x 31 directions, 300 points on the ground. NumPy gets the rotation of every direction precomputed and tests all
points against the four sides of the view at once. The hardest peer is the same formula compiled by Numba. All give the
same result.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from perception.primitives.pose import head_rotation
from perception.primitives.robot_model import HeadLimits
from planning.gaze.selection import GazeMapConfig, shown

from ._peer_kernels import weight_in_view
from .benchmark import Benchmark, Comparison, mean_ratio, race

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


def compiled(
    places: np.ndarray,
    weights: np.ndarray,
    rotations: np.ndarray,
    across: float,
    down: float,
) -> np.ndarray:
    """The same in one compiled loop."""
    result = np.empty(rotations.shape[:2])
    weight_in_view(places, weights, rotations, across, down, result)
    return result


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
        given = places, weights, rotations, across, down
        peers = {"numpy": partial(in_numpy, *given), "numba": partial(compiled, *given)}
        for name, value in race({"ours": ours, **peers}, ROUNDS).items():
            times.setdefault(name, []).append(value)
        for theirs in peers.values():
            off = ~np.isclose(ours(), theirs(), atol=1e-9)
            differ = max(differ, float(off.mean()))
    ratios = {
        name: mean_ratio([t / o for t, o in zip(times[name], times["ours"], strict=True)])
        for name in ("numpy", "numba")
    }
    return Comparison(
        {f"{name}_ms": float(np.median(values)) for name, values in times.items()},
        {f"ratio_{name}": value for name, value in ratios.items()},
        {"directions_that_differ_share": differ},
        {"the same formula under Numba": ratios["numba"]},
    )


BENCHMARK = Benchmark(
    "gaze",
    "Gaze map of 61 x 31 directions, true field of view, 300 points",
    run,
    {"ratio_numpy": 10.0},
    {"directions_that_differ_share": 0.0},
)
