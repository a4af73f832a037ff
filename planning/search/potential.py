"""The repulsive potential: how unpleasant it is to be in a cell, and where the body cannot be at all.

Source: seed 003, section 3 ("U(k,k')", equation lost; the smooth form on [0, 1]).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from perception.primitives.errors import ConfigError, InputError

from . import _kernels


@dataclass(frozen=True)
class SearchConfig:
    """Margins of the potential and weights of the search."""

    margin_m: float = 0.30  # E0, own (specification)
    body_radius_m: float = 0.16  # r_b, own (specification)
    alpha: float = 5.0  # own (specification): weight of the potential, per m of way
    p_unknown: float = 0.5  # own (specification): for cells never seen
    p_solid: float = 0.5  # own (specification): from here on a known cell is a hard obstacle
    start_radius_m: float = 0.35  # own (specification): unseen cells this near the start are free
    literal: bool = False  # rank nodes by their own potential only; not optimal, for comparison

    def __post_init__(self) -> None:
        for name in ("margin_m", "body_radius_m", "start_radius_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"search: {name}={value} must be a positive length in m")
        if not (math.isfinite(self.alpha) and self.alpha >= 0.0):
            raise ConfigError(f"search: alpha={self.alpha} must be finite and not negative")
        for name in ("p_unknown", "p_solid"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"search: {name}={value} must be a probability in [0, 1]")


def potential(
    probability: Float[np.ndarray, "rows columns"], cell_m: float, config: SearchConfig
) -> Float[np.ndarray, "rows columns"]:
    """U(k) = max over k' of p(k') (1 - E(k, k') / E0)^2 where E < E0, else 0; in [0, 1].

    Args:
        probability: p, that an obstacle covers the cell; cells outside the grid count as free.
        cell_m: Side of a cell.
        config: E0.

    Source: seed 003, section 3.
    """
    nothing = np.zeros(probability.shape, np.bool_)
    return _spread(probability, nothing, cell_m, config)[0]


def blocked_cells(
    solid: Bool[np.ndarray, "rows columns"], cell_m: float, config: SearchConfig
) -> Bool[np.ndarray, "rows columns"]:
    """Cells that the body's middle must not enter: a solid cell's centre is within r_b of theirs.

    Source: seed 003, section 3 ("does not step on or hit").
    """
    return _spread(np.zeros(solid.shape), solid, cell_m, config)[1]


def terrain(
    probability: Float[np.ndarray, "rows columns"],
    unknown: Bool[np.ndarray, "rows columns"],
    cell_m: float,
    config: SearchConfig,
) -> tuple[Float[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Potential and blocked cells of a map with unseen cells.

    Unseen cells count as p_unknown in the potential and never as solid.

    Raises:
        InputError: The two maps differ in shape, the cell has no size, or a probability is not in [0, 1].

    Source: seed 003, section 3 (unknown cells) and ambiguity 1.
    """
    if probability.shape != unknown.shape or min(probability.shape) < 2:
        raise InputError(
            f"search: maps of {probability.shape} and {unknown.shape} cells; expected two of one shape, "
            "2x2 at least"
        )
    if not (math.isfinite(cell_m) and cell_m > 0.0):
        raise InputError(f"search: cell_m={cell_m} must be a positive length in m")
    known = probability[~unknown]
    if known.size and not (known.min() >= 0.0 and known.max() <= 1.0):
        raise InputError(
            f"search: probabilities from {known.min()} to {known.max()}, expected [0, 1] without NaN"
        )
    filled = np.where(unknown, config.p_unknown, probability)
    return _spread(filled, ~unknown & (filled >= config.p_solid), cell_m, config)


def _spread(
    probability: np.ndarray, solid: np.ndarray, cell_m: float, config: SearchConfig
) -> tuple[np.ndarray, np.ndarray]:
    return _kernels.spread(
        np.ascontiguousarray(probability, np.float64),
        np.ascontiguousarray(solid),
        config.margin_m / cell_m,
        config.body_radius_m
        / cell_m
        * (1.0 + 1e-9),  # centres exactly at r_b count, whatever rounding
    )
