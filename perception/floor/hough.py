"""Floor candidates by the randomised Hough transform, as the flow chart of seed 003 has it.

Random triples vote for planes in a table of (two tilts about the predicted up, rho). The cell that first
gathers enough votes, or else the fullest one, is a candidate: the mean of its votes. Further planes are
found by taking the points of a candidate away and voting again; the one that is most like a floor wins,
because the largest plane of a kitchen is its table.

Source: seed 003, section 3, Fig. 4; Xu and Oja 1990. The choice among the planes, and triples of
neighbours, ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _kernels as kernels
from .prior import Gate
from .sample import Sample, ScoreConfig, score


@dataclass(frozen=True)
class HoughConfig:
    """Grain of the table and when a cell is full."""

    triples: int = 3000  # seed 003: K_max, for each plane
    enough: int = 60  # seed 003: T_v
    least: int = 15  # seed 003: T_min
    tilt_cell_deg: float = 2.0  # seed 003
    rho_cell_m: float = 0.02  # seed 003
    planes: int = 5  # ours: table, bed, seats, shelf, floor
    near_of: int = 8  # ours: every second triple has its points drawn as nearest of so many

    def __post_init__(self) -> None:
        for name in ("triples", "enough", "least", "planes", "near_of"):
            if getattr(self, name) < 1:
                raise ConfigError(f"hough: {name}={getattr(self, name)} must be at least 1")
        for name in ("tilt_cell_deg", "rho_cell_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"hough: {name}={value} must be positive and finite")


def propose(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: HoughConfig,
    scoring: ScoreConfig,
) -> Plane | None:
    """The plane of the sample that is most like a floor; None if no cell gathers enough votes."""
    best, best_score = None, 0.0
    rest = sample
    for _ in range(config.planes):
        plane = _fullest(rest, gate, rng, config, scoring) if len(rest) >= 3 else None
        if plane is None:
            break
        value = score(sample, plane, scoring)
        if value > best_score:
            best, best_score = plane, value
        if best_score >= len(rest) - value:  # what is left cannot beat it
            break
        rest = rest.without(plane, scoring)
    return best


def _fullest(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: HoughConfig,
    scoring: ScoreConfig,
) -> Plane | None:
    """Mean of the fullest cell, improved by least squares on the sample."""
    first, second = Plane(gate.up, 0.0).tangents
    size = 1 << (2 * config.triples - 1).bit_length()
    sums = np.zeros((size, 3))
    votes = np.zeros(size, dtype=np.int64)
    slot, most, _ = kernels.vote(
        sample.x,
        sample.y,
        sample.z,
        gate.up,
        first,
        second,
        math.cos(gate.tilt_rad),
        gate.lowest_m,
        gate.highest_m,
        math.radians(config.tilt_cell_deg),
        config.rho_cell_m,
        config.triples,
        config.enough,
        config.near_of,
        rng.integers(0, 2**63, dtype=np.uint64),
        np.full(size, -1, dtype=np.int64),
        votes,
        sums,
    )
    if most < config.least:
        return None
    one, two, rho = sums[slot] / most
    normal = gate.up + math.tan(one) * first + math.tan(two) * second
    normal /= np.linalg.norm(normal)
    for wide in (3.0, 1.5, 1.0):
        *fitted, offset, good = kernels.fit(
            sample.x, sample.y, sample.z, wide * sample.slack, normal, rho, wide * scoring.base_m
        )
        if not good:
            break
        normal, rho = np.array(fitted), offset
    return Plane(normal, float(rho))
