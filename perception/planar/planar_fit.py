"""Parameters of planar localisation by maximum likelihood, without ground truth.

The innovations of the filter give the likelihood of a recording under given parameters. Compass search
maximises it, one parameter at a time, with steps that grow after a success and shrink after a failure. The
gate makes the likelihood discontinuous, which such a search tolerates and a gradient does not.

Source: Schweppe, "Evaluation of likelihood functions for Gaussian signals" (1965); compass search: Kolda,
Lewis, Torczon, "Optimization by direct search" (SIAM Review 45, 2003).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from .config import PlanarConfig
from .planar import Journey, PlanarPrior, filter_journey

FITTED = {
    "along": 0.4,
    "across": 0.4,
    "turn_per_path": 0.4,
    "turn_per_turn": 0.4,
    "turn_per_time": 0.4,
    "turn_scale_walk": 0.8,
    "drift_walk": 0.8,
    "offset": 0.2,
    "scale": 0.005,
    "depth_near": 0.4,
    "depth_far": 0.3,
    "bearing_sigma": 0.3,
    "bearing_turning": 0.6,
    "depth_shared": 0.4,
    "depth_memory": 0.6,
    "bearing_shared": 0.4,
    "bearing_memory": 0.6,
    "place": 0.4,
    "place_memory": 0.6,
}
"""The fitted fields of a `PlanarConfig`, with the initial step of each, in the logarithm."""


def compass_search(
    cost: Callable[[Float[np.ndarray, "n"]], float],
    start: Float[np.ndarray, "n"],
    steps: Sequence[float],
    sweeps: int,
) -> Float[np.ndarray, "n"]:
    """Minimise a cost by compass search.

    Args:
        cost: Infinite or NaN values are never accepted.
        start: Initial point.
        steps: Initial step of each coordinate, not zero.
        sweeps: Number of times that each coordinate is tried.

    Returns:
        The best point; never worse than the start.
    """
    if len(steps) != len(start) or not all(steps):
        raise ConfigError(f"search: {len(start)} coordinates need as many steps, none of them zero")
    best, least = np.array(start, float), cost(start)
    step, smallest = np.array(steps, float), 0.02 * np.abs(steps)
    for _ in range(sweeps):
        for i in range(len(best)):
            for sign in (1.0, -1.0):
                tried = best.copy()
                tried[i] += sign * step[i]
                found = cost(tried)
                if found < least - 1e-3:  # log likelihood; a smaller gain is noise
                    best, least = tried, found
                    step[i] *= 1.5 * sign
                    break
            else:
                step[i] = math.copysign(max(abs(step[i]) * 0.5, smallest[i]), step[i])
    return best


def fit(
    journey_at: Callable[[float], Journey],
    guess: PlanarConfig | None = None,
    delay_s: float = 0.1,
    sweeps: int = 6,
) -> tuple[PlanarConfig, float]:
    """The parameters with the highest likelihood, and the delay of the odometry.

    Args:
        journey_at: The run if the body moves this many seconds after its odometry.
        guess: Initial parameters; a factor of e^3 counts as one standard deviation.
        delay_s: Initial delay, s.
        sweeps: Number of times that each parameter is tried.

    Returns:
        Parameters and delay, s.
    """
    guess = guess or PlanarConfig()
    base = {name: getattr(guess, name) for name in FITTED}

    def config(point: np.ndarray) -> PlanarConfig:
        factors = np.exp(point[:-1]).tolist()
        return dataclasses.replace(
            guess, **{n: base[n] * factor for n, factor in zip(FITTED, factors, strict=True)}
        )

    def cost(point: np.ndarray) -> float:
        likelihood = filter_journey(journey_at(float(point[-1])), config(point)).log_likelihood
        return -likelihood + float(point[:-1] @ point[:-1]) / (2.0 * 3.0**2)

    start = np.append(np.zeros(len(FITTED)), delay_s)
    best = compass_search(cost, start, [*FITTED.values(), 0.03], sweeps)
    return config(best), float(best[-1])


SIZES = (
    ("along", "across"),
    ("turn_per_path",),
    ("turn_per_turn",),
    ("turn_per_time",),
    ("depth_near",),
    ("depth_far",),
    ("depth_shared",),
    ("bearing_sigma",),
    ("bearing_turning",),
    ("bearing_shared",),
    ("place",),
    ("depth_memory", "bearing_memory", "place_memory"),
)
"""Fields with one common factor each. Whatever the guess, the log tells the correlation times too."""

FLOOR = PlanarConfig()
"""A path is never trusted more than this: wheels slip for a while, and a good first part promises nothing."""

BLOCK = 20  # ours: sightings of one block
TRIMMED = 0.1  # ours: share of the blocks that may hold an event: a slip, a push, a failure


def fit_sizes(
    journey_at: Callable[[float], Journey],
    guess: PlanarConfig,
    delay_s: float,
    prior: PlanarPrior,
) -> tuple[PlanarConfig, float]:
    """As `fit`, for a short log that may hold an event: one factor for each group of `SIZES`, and the delay."""

    def config(point: np.ndarray) -> PlanarConfig:
        factors = np.exp(np.clip(point[:-1], -9.0, 9.0)).tolist()
        pairs = zip(SIZES, factors, strict=True)
        sizes = {name: getattr(guess, name) * factor for names, factor in pairs for name in names}
        wide = {name: max(sizes[name], getattr(FLOOR, name)) for name in SIZES[0]}
        return dataclasses.replace(guess, **sizes | wide)

    def cost(point: np.ndarray) -> float:
        journey = journey_at(float(point[-1]))
        found = filter_journey(journey, config(point), prior)
        return -_without_events(found.log_densities) + float(point[:-1] @ point[:-1]) / (
            2.0 * 3.0**2
        )

    steps = [0.7] * len(SIZES) + [0.1]
    best = compass_search(cost, np.append(np.zeros(len(SIZES)), delay_s), steps, 5)
    return config(best), float(best[-1])


def _without_events(log_densities: Float[np.ndarray, "r"]) -> float:
    """Log likelihood of all but the worst blocks of sightings: an event tells nothing about the noise.

    Source: trimmed likelihood, Hadi and Luceno (Computational Statistics & Data Analysis 25, 1997).
    """
    blocks = np.add.reduceat(log_densities, np.arange(0, len(log_densities), BLOCK))
    return float(np.sum(np.sort(blocks)[int(TRIMMED * len(blocks)) :]))
