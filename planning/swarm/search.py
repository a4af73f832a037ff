"""The best pixel: by a particle swarm, as published, or by an exact search.

The swarm has four modes. The printed inertia of 2 drives every particle to the border. Read as "two pixels along the
last direction" it is stable. Constriction (Clerc and Kennedy 2002) is the usual remedy. Ours adds an evenly spread first
generation and attraction by neighbours instead of all particles, so that the side of an obstacle that is found first
does not win for that reason.

The exact search is deterministic and faster: see `_search_kernels.sweep`.

Source: Han 2018 (seed 000), sections 4 and 6.4; the exact search is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.settings import setting

from . import _search_kernels
from ._search_kernels import Weights
from .objective import Objective

MODES = {
    "literal": Weights(2.0, 2.0, 2.0, False),  # as printed
    "two_pixel": Weights(2.0, 2.0, 2.0, True),  # inertia as a length, px
    "constriction": Weights(0.7298, 1.49618, 1.49618, False),  # Clerc and Kennedy
    "spread": Weights(0.7298, 1.49618, 1.49618, False),  # ours: the same, with neighbours
}
NEIGHBOURS = 1  # ours, of mode "spread": to each side; 3 to 12 miss the optimum more often
MOST = 10_000  # ours: particles, and epochs


@dataclass(frozen=True)
class SwarmConfig:
    """Mode and size of the search."""

    mode: str = setting(
        "exact",
        "",
        "search of the best pixel: exact, literal, two_pixel, constriction or spread",
        "ours; seed 000: literal",
    )
    particles: int = setting(50, "", "particles of the swarm", "seed 000, section 6.4")
    epochs: int = setting(100, "", "epochs of the swarm", "seed 000, section 6.4")

    def __post_init__(self) -> None:
        if self.mode != "exact" and self.mode not in MODES:
            raise ConfigError(
                f"swarm: mode={self.mode!r} is unknown; choose exact, {', '.join(MODES)}"
            )
        for name in ("particles", "epochs"):
            if not 1 <= getattr(self, name) <= MOST:
                raise ConfigError(
                    f"swarm: {name}={getattr(self, name)} must be at least 1, at most {MOST}"
                )


@dataclass(frozen=True)
class Best:
    """The best pixel.

    Args:
        pixel: (u, v).
        value: O, m; at least the penalty for a forbidden pixel.
    """

    pixel: tuple[int, int]
    value: float


def find(objective: Objective, config: SwarmConfig, rng: np.random.Generator) -> Best | None:
    """The best pixel in the configured mode; None if every pixel is forbidden.

    With the printed penalties of 1 no pixel is refused; the result may lie inside an obstacle.

    Args:
        objective: Of one picture.
        config: Mode and size of the swarm.
        rng: Used by the swarm only.
    """
    found = exact(objective) if config.mode == "exact" else fly(objective, config, rng)
    refused = objective.config.penalty if not objective.config.literal else math.inf
    return None if found is None or found.value >= refused else found


def exact(objective: Objective) -> Best | None:
    """The pixel with the least O among those without penalty; None if there is none.

    With the printed objective it is the least O of all pixels, penalties included.
    """
    literal = objective.config.literal
    kernel = _search_kernels.search_all if literal else _search_kernels.search
    u, v, value = kernel(objective.arrays)
    return None if u < 0 else Best((int(u), int(v)), float(value))


def brute_force(objective: Objective) -> Best | None:
    """The same by evaluating every pixel, a hundred times slower; the reference for tests."""
    u, v, value = _search_kernels.search_all(objective.arrays)
    refused = math.inf if objective.config.literal else objective.config.penalty
    return None if u < 0 or value >= refused else Best((int(u), int(v)), float(value))


def fly(objective: Objective, config: SwarmConfig, rng: np.random.Generator) -> Best:
    """The best pixel that the swarm found, forbidden or not.

    Args:
        objective: Of one picture.
        config: Mode (one of MODES), particles, epochs.
        rng: Draws the first generation and every attraction.
    """
    height, width = objective.arrays.blocked.shape
    low = np.array([0.0, math.ceil(objective.config.top_share * height)])
    high = np.array([width - 1.0, height - 1.0])
    spread = config.mode == "spread"
    position = (_spread if spread else _scattered)(config.particles, low, high, rng)
    own, own_value = np.empty_like(position), np.empty(config.particles)
    _search_kernels.fly(
        objective.arrays,
        position,
        np.zeros_like(position),
        rng.random((config.epochs, config.particles, 2, 2)),
        low,
        high,
        MODES[config.mode],
        NEIGHBOURS if spread else 0,
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
    """The R2 sequence with a random origin: even for any number of points."""
    steps = np.array([0.7548776662466927, 0.5698402909980532])  # 1/g, 1/g^2 with g^3 = g + 1
    share = (rng.random(2) + np.arange(count)[:, None] * steps) % 1.0
    return np.asarray(low + (high - low) * share)
