"""Floor candidates by random point triples: MSAC with local optimisation.

Each triple defines a plane. Its score decreases smoothly with the distance of the points on it (MSAC), and
points below it count against it, because nothing is below a floor. Every new best plane is refined by least
squares on the points it explains (local optimisation).

Source: Torr and Zisserman 2000 (MSAC); Chum, Matas and Kittler 2003 (local optimisation); points below the plane
and triples of neighbours ours.
"""

from __future__ import annotations

import numpy as np

from ..primitives.plane import Plane
from . import _search_kernels as kernels
from .prior import Gate
from .sample import PENALTY, SHARP, Sample, ScoreConfig


def propose(
    sample: Sample,
    gate: Gate,
    rng: np.random.Generator,
    scoring: ScoreConfig,
    flank: float = 0.0,
) -> Plane | None:
    """The plane with the best floor score; None if no triple gives a plane within the gate."""
    seed = rng.integers(0, 2**63, dtype=np.uint64)
    a, b, c, rho, value = kernels.msac(sample, gate, scoring.base_m, PENALTY, flank, SHARP, seed)
    return Plane(np.array([a, b, c]), rho) if value > 0.0 else None
