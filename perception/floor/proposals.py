"""Two ways to propose a plane from a sample of points: RANSAC and the randomised Hough transform.

Both draw triples of points, half of them anywhere and half close together in the image, where three points
are more likely to lie on one surface; both answer with one rough plane, which `refine` makes good.

Source: seed 003, Fig. 4 (randomised Hough); MSAC cost after Torr and Zisserman 2000.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..primitives.errors import ConfigError
from ..primitives.plane import Plane
from . import _kernels


@dataclass(frozen=True)
class ProposalConfig:
    """How many triples, and the grain of the Hough table."""

    ransac_triples: int = 400  # ours: a floor of 25 % is hit by 6 global triples and many near ones
    hough_triples: int = 3000  # seed 003: K_max
    hough_enough: int = 60  # seed 003: T_v
    hough_least: int = 8  # ours: seed 003 has T_min = 15 for 20,000 points; the sample is a tenth
    hough_tilt_deg: float = 2.0  # seed 003
    hough_offset_m: float = 0.02  # seed 003
    near_share: float = 0.5  # ours: triples drawn close together
    near_rank: int = 160  # ours: in a sample in row order of 2048, four rows up or down

    def __post_init__(self) -> None:
        for name in ("ransac_triples", "hough_triples", "hough_enough", "hough_least", "near_rank"):
            if getattr(self, name) < 1:
                raise ConfigError(f"floor: {name}={getattr(self, name)} must be at least 1")


@dataclass(frozen=True)
class Gate:
    """Which planes are considered at all.

    Args:
        up: Expected normal, camera frame.
        cosine: Of the largest angle to it.
        lowest_m, highest_m: Bounds of the offset, the camera's height.
    """

    up: Float[np.ndarray, "3"]
    cosine: float
    lowest_m: float
    highest_m: float


def draw_triples(
    count: int, size: int, config: ProposalConfig, rng: np.random.Generator
) -> Int[np.ndarray, "k 3"]:
    """Indices of triples from a sample in row order: first those near each other, then those anywhere."""
    near = int(count * config.near_share)
    first = rng.integers(0, size, (count, 1))
    others = rng.integers(0, size, (count, 2))
    steps = rng.integers(-config.near_rank, config.near_rank + 1, (near, 2))
    others[:near] = np.clip(first[:near] + steps, 0, size - 1)
    return np.hstack([first, others])


def ransac(
    sample: Float[np.ndarray, "m 3"],
    tau: Float[np.ndarray, "m"],
    gate: Gate,
    config: ProposalConfig,
    rng: np.random.Generator,
) -> Plane | None:
    """The plane through a random triple that has the least MSAC cost over the sample.

    Args:
        sample: Points in row order, camera frame, m.
        tau: Inlier bound of each point, m.
        gate: Planes that are considered.
        config: How many triples.
        rng: Draws them.
    """
    triples = draw_triples(config.ransac_triples, len(sample), config, rng)
    nx, ny, nz, rho, cost = _kernels.msac(
        sample, tau, triples, gate.up, gate.cosine, gate.lowest_m, gate.highest_m
    )
    return None if cost >= len(sample) else Plane(np.array([nx, ny, nz]), float(rho))


def hough(
    sample: Float[np.ndarray, "m 3"],
    tau: Float[np.ndarray, "m"],
    gate: Gate,
    config: ProposalConfig,
    rng: np.random.Generator,
) -> Plane | None:
    """The mean of the fullest cell of a randomised Hough table; arguments as for `ransac`.

    Source: seed 003, Fig. 4, steps 2 to 4.
    """
    triples = draw_triples(config.hough_triples, len(sample), config, rng)
    nx, ny, nz, rho, votes = _kernels.hough(
        sample,
        rng.permutation(triples),
        gate.up,
        Plane(gate.up, 0.0).tangents,
        gate.cosine,
        gate.lowest_m,
        gate.highest_m,
        np.radians(config.hough_tilt_deg),
        config.hough_offset_m,
        config.hough_enough,
    )
    if votes < config.hough_least:
        return None
    normal = np.array([nx, ny, nz])
    return Plane(normal / np.linalg.norm(normal), float(rho))
