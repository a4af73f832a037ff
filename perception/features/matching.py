"""Which feature of one image is which of another: nearest descriptor, clearly nearer than the second.

Exhaustive search by one matrix product: exact, and in 128 dimensions no slower than a k-d tree.

Source: seed 004, Table 1 as reconstructed (ratio 0.8 after Lowe 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int

from ..primitives.errors import ConfigError

SAME = 1e-5
"""Squared distance that single precision may make of none: two rivals as near are the same to everybody."""


@dataclass(frozen=True)
class MatchConfig:
    """What counts as a match."""

    ratio: float = 0.8  # Lowe 2004: nearest over second nearest
    mutual: bool = True  # ours: each must be the other's nearest
    alone: float = (
        0.5  # ours: squared distance below which the only one in question is it; chance: 1
    )

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
        first: Descriptors of length 1.
        second: Descriptors of length 1.
        config: What counts.
        allowed: Which pairs are in question at all, where it is known about where each must lie.

    Returns:
        Pairs; none where one side has less than one descriptor, or the second has no second to compare.
    """
    config = config or MatchConfig()
    if len(first) == 0 or len(second) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    likeness = first @ second.T  # squared distance is 2 - 2 likeness
    if allowed is not None:
        likeness[~allowed] = -np.inf
    rows = np.arange(len(first))
    best = np.argmax(likeness, axis=1)
    nearest = np.maximum(2.0 - 2.0 * likeness[rows, best], 0.0)
    back = np.argmax(likeness, axis=0) if config.mutual else None
    likeness[rows, best] = -np.inf
    runner_up = np.maximum(2.0 - 2.0 * likeness.max(axis=1), 0.0)
    kept = (nearest < config.ratio**2 * runner_up) & (runner_up > SAME)
    if allowed is not None:
        kept &= np.isfinite(runner_up) | (nearest < config.alone)
    if back is not None:
        kept &= back[best] == rows
    return np.column_stack([rows[kept], best[kept]]).astype(np.int64)
