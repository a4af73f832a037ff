"""The best pixel: by a particle swarm, as published, or exactly.

The swarm has the published mode, two ways to mend it, and ours. Inertia 2 as printed throws every particle
to the rim; read as "two pixels along the last direction" it is stable; constriction (Clerc and Kennedy
2002) is the usual cure. Ours adds to constriction a first generation that is spread evenly, and news that
travel from neighbour to neighbour instead of at once to all: the side of an obstacle that is found first
no longer wins because it was first.

The exact search needs no luck and less time: see `_search_kernels.sweep`.

Source: seed 000, sections 4 and 6.4; the exact search is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import ConfigError

from . import _search_kernels
from .objective import Objective

MODES = {
    "literal": (2.0, 2.0, 2.0, 0.0),  # as printed: inertia, both pulls
    "two_pixel": (2.0, 2.0, 2.0, 1.0),  # inertia as a length, px
    "constriction": (0.7298, 1.49618, 1.49618, 0.0),  # Clerc and Kennedy
    "spread": (0.7298, 1.49618, 1.49618, 0.0),  # the same, spread and told by neighbours; ours
}
"""Inertia, pull to the own best and to the others', and whether inertia is a length in pixels."""


@dataclass(frozen=True)
class SwarmConfig:
    """How the best pixel is searched."""

    mode: str = "exact"  # or one of MODES; the seed's own is "literal"
    particles: int = 50  # seed 000, section 6.4
    epochs: int = 100  # seed 000, section 6.4
    neighbours: int = 1  # ours, of mode "spread": to each side; 3 to 12 missed more often

    def __post_init__(self) -> None:
        if self.mode != "exact" and self.mode not in MODES:
            raise ConfigError(
                f"swarm: mode={self.mode!r} is unknown; choose exact, {', '.join(MODES)}"
            )
        for name in ("particles", "epochs"):
            if getattr(self, name) < 1:
                raise ConfigError(f"swarm: {name}={getattr(self, name)} must be at least 1")
        if self.neighbours < 0:
            raise ConfigError(f"swarm: neighbours={self.neighbours} must not be negative")


@dataclass(frozen=True)
class Best:
    """A pixel and its value.

    Args:
        pixel: (u, v).
        value: O, m; at least the penalty if the pixel is forbidden.
    """

    pixel: tuple[int, int]
    value: float


def find(objective: Objective, config: SwarmConfig, rng: np.random.Generator) -> Best | None:
    """The best pixel by the configured mode; None if nothing that may be walked to was found.

    With the printed penalties of 1 nothing is refused: the pixel found may lie in an obstacle.

    Args:
        objective: Of one picture.
        config: Mode and size of the swarm.
        rng: For the swarm; the exact search draws nothing.
    """
    found = exact(objective) if config.mode == "exact" else fly(objective, config, rng)
    refused = objective.config.penalty if not objective.config.literal else math.inf
    return None if found is None or found.value >= refused else found


def exact(objective: Objective) -> Best | None:
    """The pixel of least O among those without penalty; None if there are none.

    With the printed objective every pixel is looked at, and the least sum wins, penalties and all.
    """
    literal = objective.config.literal
    kernel = _search_kernels.search_all if literal else _search_kernels.search
    u, v, value = kernel(*objective.arrays)
    return None if u < 0 else Best((int(u), int(v)), float(value))


def brute_force(objective: Objective) -> Best | None:
    """The same by looking at every pixel: a hundred times slower, and too simple to be wrong."""
    u, v, value = _search_kernels.search_all(*objective.arrays)
    refused = math.inf if objective.config.literal else objective.config.penalty
    return None if u < 0 or value >= refused else Best((int(u), int(v)), float(value))


def fly(objective: Objective, config: SwarmConfig, rng: np.random.Generator) -> Best:
    """The best pixel that a swarm has met, forbidden or not.

    Args:
        objective: Of one picture.
        config: Mode (one of MODES), particles, epochs.
        rng: Source of the first generation and of every pull.
    """
    height, width = objective.blocked.shape
    low = np.array([0.0, math.ceil(objective.config.top_share * height)])
    high = np.array([width - 1.0, height - 1.0])
    spread = config.mode == "spread"
    position = (_spread if spread else _scattered)(config.particles, low, high, rng)
    own, own_value = np.empty_like(position), np.empty(config.particles)
    _search_kernels.fly(
        *objective.arrays,
        position,
        np.zeros_like(position),
        rng.random((config.epochs, config.particles, 2, 2)),
        low,
        high,
        np.array(MODES[config.mode]),
        config.neighbours if spread else 0,
        own,
        own_value,
    )
    best = int(np.argmin(own_value))
    u, v = (math.floor(float(c) + 0.5) for c in own[best])
    return Best((u, v), float(own_value[best]))


def _scattered(
    count: int, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    return np.asarray(low + (high - low) * rng.random((count, 2)))


def _spread(count: int, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A lattice of golden ratios (R2 sequence) with a random origin: even, however many there are."""
    steps = np.array([0.7548776662466927, 0.5698402909980532])  # 1/g, 1/g^2 with g^3 = g + 1
    share = (rng.random(2) + np.arange(count)[:, None] * steps) % 1.0
    return np.asarray(low + (high - low) * share)
