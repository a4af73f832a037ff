"""Floor candidates by random triples: MSAC with local optimisation.

Each triple is a plane; its score falls smoothly with the distance of the points on it (MSAC), and points
below it speak against it, because under a floor there is nothing. Every new best is improved by least
squares on the points it explains (local optimisation).

Source: Torr and Zisserman 2000 (MSAC); Chum, Matas and Kittler 2003 (local optimisation); points below, and
triples of neighbours, ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _search_kernels as kernels
from .prior import Gate
from .sample import Sample, ScoreConfig


@dataclass(frozen=True)
class RansacConfig:
    """How long to look."""

    tries: int = 1500  # ours: finds a floor of 6 % of the points among tables, 20 of 20 seeds
    miss: float = 1e-4  # ours: probability that a better plane is overlooked, after which it stops
    near_of: int = 8  # ours: three triples of four have their points drawn as nearest of so many

    def __post_init__(self) -> None:
        if self.tries < 1 or self.near_of < 1:
            raise ConfigError(
                f"ransac: tries={self.tries} and near_of={self.near_of} must be at least 1"
            )
        if not 0.0 < self.miss < 1.0:
            raise ConfigError(f"ransac: miss={self.miss} must lie between 0 and 1")


def propose(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: RansacConfig,
    scoring: ScoreConfig,
) -> Plane | None:
    """The plane of the sample that is most like a floor; None if no triple lies within the gate."""
    seed = rng.integers(0, 2**63, dtype=np.uint64)
    a, b, c, rho, value, _ = kernels.msac(
        sample.x,
        sample.y,
        sample.z,
        sample.slack,
        gate.up,
        math.cos(gate.tilt_rad),
        gate.lowest_m,
        gate.highest_m,
        scoring.base_m,
        scoring.penalty,
        scoring.sharp,
        config.tries,
        config.miss,
        config.near_of,
        seed,
    )
    return Plane(np.array([a, b, c]), rho) if value > 0.0 else None
