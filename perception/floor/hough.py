"""Floor candidates by the randomised Hough transform, after the flow chart of seed 003.

Random triples vote for planes in a table of (two tilts about the predicted up direction, distance) until a cell
has enough votes or the triples are used up. The means of the fullest cells are candidates, each refined by
least squares; then the points of the best one are removed and the vote repeats. The candidate with the
best floor score wins: the largest plane of a kitchen is its table.

Source: seed 003, section 3, Fig. 4; Xu and Oja 1990. Choice among the planes and triples of neighbours ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from ..primitives.settings import setting
from . import _search_kernels as kernels
from .prior import Gate
from .sample import SHARP, Sample, ScoreConfig, score

JOINTS_TILT_DEG = 25.0  # seed 003: T_min holds while the prior knows up to within this tilt
PATIENCE = 6  # ours: times K_max are drawn while no cell has T_min votes; the seed gives up at once
ROUNDS = 5  # ours: table, bed, seats, floor
CELLS = 12  # ours: candidates of a round
RUNNER_UP = 3  # ours: least votes of a candidate after the first; the score decides
SIDE_M = 0.15  # ours: least side of a triple; 5 mm of noise over it is a cell of tilt
SIDE_SIGMAS = 30.0  # ours: the same in standard deviations of depth, for noisier sensors
SIDE_SHARE = 0.7  # ours: of the spread of all points, limits both for a camera close to the floor
MOST_TRIPLES = 1_000_000  # ours: they are drawn at once


@dataclass(frozen=True)
class HoughConfig:
    """Resolution of the table and number of votes."""

    triples: int = setting(3000, "", "K_max, random triples per round", "seed 003")
    enough: int = setting(60, "", "T_v, votes of a cell that end the vote", "seed 003")
    least: int = setting(15, "", "T_min, least votes of the first plane", "seed 003")
    tilt_cell_deg: float = setting(2.0, "deg", "cell size in tilt", "seed 003")
    rho_cell_m: float = setting(0.02, "m", "cell size in distance", "seed 003")

    def __post_init__(self) -> None:
        for name in ("triples", "enough", "least"):
            if getattr(self, name) < 1:
                raise ConfigError(f"hough: {name}={getattr(self, name)} must be at least 1")
        if self.triples > MOST_TRIPLES:
            raise ConfigError(f"hough: triples={self.triples} must be at most {MOST_TRIPLES}")
        for name in ("tilt_cell_deg", "rho_cell_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"hough: {name}={value} must be positive and finite")


class HoughSpace(NamedTuple):
    """Plane parameters: tilts about two directions across the predicted up, distance from an origin."""

    first: np.ndarray
    second: np.ndarray
    origin: np.ndarray
    tilt_cell_rad: float
    rho_cell_m: float


class VoteLimits(NamedTuple):
    """When the vote ends; see `vote`."""

    triples: int
    enough: int
    least: int
    most: int


class VoteTable(NamedTuple):
    """Hash table of cells: key (m,), votes (m,), sums of the parameters (m, 3)."""

    keys: np.ndarray
    votes: np.ndarray
    sums: np.ndarray


def propose(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: HoughConfig,
    scoring: ScoreConfig,
    flank: float = 0.0,
) -> Plane | None:
    """The plane with the best floor score; None if no cell gets enough votes."""
    best, best_score = None, 0.0
    rest = sample
    for number in range(ROUNDS):
        if rest.size < 3 or best_score >= rest.size:  # the rest cannot give a better score
            break
        strict = number == 0 and gate.tilt_rad <= math.radians(JOINTS_TILT_DEG)
        least = config.least if strict else RUNNER_UP
        planes = _candidates(rest, gate, rng, config, scoring, least, flank)
        if not planes:
            break
        for plane in planes:
            value = score(sample, plane, scoring, flank=flank)
            if value > best_score:
                best, best_score = plane, value
        inliers = [score(rest, plane, scoring, penalty=0.0) for plane in planes]
        rest = rest.without(planes[int(np.argmax(inliers))], scoring)
    return best


def _candidates(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    config: HoughConfig,
    scoring: ScoreConfig,
    least: int,
    flank: float,
) -> list[Plane]:
    """Means of the fullest cells, the fullest first, refined by least squares on the sample."""
    first, second = Plane(gate.up, 0.0).tangents
    origin = np.array([sample.x.mean(), sample.y.mean(), sample.z.mean()])
    widest = SIDE_SHARE * math.sqrt(sample.x.var() + sample.y.var() + sample.z.var())
    noise = float(np.median(sample.slack * sample.z)) / scoring.sigmas
    most = PATIENCE * config.triples
    size = 1 << (2 * most - 1).bit_length()
    votes, sums = np.zeros(size, dtype=np.int64), np.zeros((size, 3))
    kernels.vote(
        sample,
        gate,
        HoughSpace(first, second, origin, math.radians(config.tilt_cell_deg), config.rho_cell_m),
        VoteLimits(config.triples, config.enough, least, most),
        min(SIDE_M, widest),
        min(SIDE_SIGMAS, widest / noise) / scoring.sigmas,
        rng.integers(0, 2**63, dtype=np.uint64),
        VoteTable(np.full(size, -1, dtype=np.int64), votes, sums),
    )
    if votes.max() < least:
        return []
    full = np.flatnonzero(votes >= min(RUNNER_UP, least))
    full = full[np.argsort(-votes[full], kind="stable")][:CELLS]
    planes = []
    for slot in full:
        one, two, distance = sums[slot] / votes[slot]
        normal = gate.up + math.tan(one) * first + math.tan(two) * second
        normal /= np.linalg.norm(normal)
        planes.append(_refined(sample, normal, distance - float(normal @ origin), scoring, flank))
    return planes


def _refined(
    sample: Sample, normal: np.ndarray, rho: float, scoring: ScoreConfig, flank: float
) -> Plane:
    """Least squares on the points within a shrinking band, kept while the score rises."""
    best = Plane(normal, float(rho))
    best_score = score(sample, best, scoring, flank=flank)
    for wide in (3.0, 1.5, 1.0, 1.0 / SHARP, 1.0 / SHARP):
        a, b, c, offset, good = kernels.fit(
            sample, best.normal, best.offset_m, wide, wide * scoring.base_m
        )
        if not good:
            continue
        plane = Plane(np.array([a, b, c]), float(offset))
        value = score(sample, plane, scoring, flank=flank)
        if value > best_score:
            best, best_score = plane, value
    return best
