"""Floor candidates by the randomised Hough transform, as the flow chart of seed 003 has it.

Random triples vote for planes in a table of (two tilts about the predicted up, distance) until one cell has
enough votes or there are no more triples. The means of the fullest cells are candidates, each improved by
least squares; then the points of the best are taken away and the vote repeats. Of all candidates the one
that is most like a floor wins, because the largest plane of a kitchen is its table.

Source: seed 003, section 3, Fig. 4; Xu and Oja 1990. The choice among the planes, and triples of
neighbours, ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _search_kernels as kernels
from .prior import Gate
from .sample import Sample, ScoreConfig, score

SIDE_SHARE = 0.7  # of the spread of all points: sides that a camera at the ankle can still find


@dataclass(frozen=True)
class HoughConfig:
    """Grain of the table and when a cell is full."""

    triples: int = 3000  # seed 003: K_max
    patience: int = 6  # ours: times K_max while no cell has T_min; 1 gives up, as the seed does
    enough: int = 60  # seed 003: T_v
    least: int = 15  # seed 003: T_min, of the first table
    joints_tilt_deg: float = (
        25.0  # seed 003: so near is up by the joints; T_min holds no farther off
    )
    tilt_cell_deg: float = 2.0  # seed 003
    rho_cell_m: float = 0.02  # seed 003
    rounds: int = 5  # ours: table, bed, seats, floor
    cells: int = 12  # ours: candidates of a round: the fullest cell and some of those after it
    runner_up: int = 3  # ours: votes of those; the score judges them
    near_of: int = 8  # ours: three triples of four have points drawn as nearest of so many
    side_m: float = 0.15  # ours: 5 mm of noise over this length are a cell of tilt
    side_sigmas: float = 30.0  # ours: the same where depth is noisier

    def __post_init__(self) -> None:
        for name in (
            "triples",
            "patience",
            "enough",
            "least",
            "rounds",
            "cells",
            "runner_up",
            "near_of",
        ):
            if getattr(self, name) < 1:
                raise ConfigError(f"hough: {name}={getattr(self, name)} must be at least 1")
        for name in ("joints_tilt_deg", "tilt_cell_deg", "rho_cell_m", "side_m", "side_sigmas"):
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
    for number in range(config.rounds):
        if len(rest) < 3 or best_score >= len(rest):  # what is left cannot beat it
            break
        strict = number == 0 and gate.tilt_rad <= math.radians(config.joints_tilt_deg)
        least = config.least if strict else config.runner_up
        planes = _candidates(rest, gate, rng, config, scoring, least)
        if not planes:
            break
        for plane in planes:
            value = score(sample, plane, scoring)
            if value > best_score:
                best, best_score = plane, value
        on_it = [score(rest, plane, scoring, penalty=0.0) for plane in planes]
        rest = rest.without(planes[int(np.argmax(on_it))], scoring)
    return best


def _candidates(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: HoughConfig,
    scoring: ScoreConfig,
    least: int,
) -> list[Plane]:
    """Means of the fullest cells, the fullest first, improved by least squares on the sample."""
    first, second = Plane(gate.up, 0.0).tangents
    origin = np.array([sample.x.mean(), sample.y.mean(), sample.z.mean()])
    widest = SIDE_SHARE * math.sqrt(sample.x.var() + sample.y.var() + sample.z.var())
    noise = float(np.median(sample.slack * sample.z)) / scoring.sigmas
    most = config.patience * config.triples
    size = 1 << (2 * most - 1).bit_length()
    sums = np.zeros((size, 3))
    votes = np.zeros(size, dtype=np.int64)
    kernels.vote(
        sample.x,
        sample.y,
        sample.z,
        sample.slack,
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
        least,
        most,
        config.near_of,
        min(config.side_m, widest),
        min(config.side_sigmas, widest / noise) / scoring.sigmas,
        origin,
        rng.integers(0, 2**63, dtype=np.uint64),
        np.full(size, -1, dtype=np.int64),
        votes,
        sums,
    )
    if votes.max() < least:
        return []
    full = np.flatnonzero(votes >= min(config.runner_up, least))
    full = full[np.argsort(-votes[full], kind="stable")][: config.cells]
    planes = []
    for slot in full:
        one, two, at = sums[slot] / votes[slot]
        normal = gate.up + math.tan(one) * first + math.tan(two) * second
        normal /= np.linalg.norm(normal)
        planes.append(_improved(sample, normal, at - float(normal @ origin), scoring))
    return planes


def _improved(sample: Sample, normal: np.ndarray, rho: float, scoring: ScoreConfig) -> Plane:
    """Least squares on the points near a plane, then on those nearer, as long as the score rises."""
    best = Plane(normal, float(rho))
    best_score = score(sample, best, scoring)
    for wide in (3.0, 1.5, 1.0, 1.0 / scoring.sharp, 1.0 / scoring.sharp):
        a, b, c, offset, good = kernels.fit(
            sample.x,
            sample.y,
            sample.z,
            wide * sample.slack,
            best.normal,
            best.offset_m,
            wide * scoring.base_m,
        )
        if not good:
            continue
        plane = Plane(np.array([a, b, c]), float(offset))
        value = score(sample, plane, scoring)
        if value > best_score:
            best, best_score = plane, value
    return best
