"""Feature matching: mutual nearest descriptors that pass the ratio test.

Exhaustive search by one matrix product: exact, and in 128 dimensions as fast as a k-d tree.

Source: Kang et al. 2013 (seed 004), Table 1 as reconstructed (ratio 0.8 after Lowe 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int

from ..primitives.errors import ConfigError

SAME = 1e-5
"""Squared distance by rounding in single precision: two descriptors this close are indistinguishable."""


ALONE = 0.5  # ours: largest squared distance of a match without a second candidate; chance gives 1


@dataclass(frozen=True)
class MatchConfig:
    """Criterion of a match."""

    ratio: float = 0.8  # Lowe 2004; largest ratio of the nearest to the second nearest descriptor

    def __post_init__(self) -> None:
        if not 0.0 < self.ratio <= 1.0:
            raise ConfigError(f"match: ratio={self.ratio} must lie in (0, 1]; usual is 0.8")


def match(
    first: Float32[np.ndarray, "n d"],
    second: Float32[np.ndarray, "m d"],
    config: MatchConfig | None = None,
    allowed: Bool[np.ndarray, "n m"] | None = None,
) -> Int[np.ndarray, "k 2"]:
    """Pairs (index into first, index into second), in the order of the first.

    Args:
        first: Descriptors of unit length.
        second: Descriptors of unit length.
        config: Criterion; the default if None.
        allowed: Candidate pairs, where positions restrict them.

    Returns:
        Pairs; none with fewer than one descriptor in the first or two in the second.
    """
    config = config or MatchConfig()
    if len(first) == 0 or len(second) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    similarity = first @ second.T  # squared distance is 2 - 2 similarity
    if allowed is not None:
        similarity[~allowed] = -np.inf
    rows = np.arange(len(first))
    best = np.argmax(similarity, axis=1)
    nearest = np.maximum(2.0 - 2.0 * similarity[rows, best], 0.0)
    mutual = np.argmax(similarity, axis=0)[best] == rows
    similarity[rows, best] = -np.inf
    runner_up = np.maximum(2.0 - 2.0 * similarity.max(axis=1), 0.0)
    kept = (nearest < config.ratio**2 * runner_up) & (runner_up > SAME)
    if allowed is not None:
        kept &= np.isfinite(runner_up) | (nearest < ALONE)
    kept &= mutual
    return np.column_stack([rows[kept], best[kept]]).astype(np.int64)
