"""The outline of one thing in a panorama: how far away its front is in every column.

A thing that stands on the floor is as far away at its foot as at its front's top, so a column of pixels
has one forward distance, and all columns together are its outline on the floor plan.

Source: seed 004, section 2.3, eq. (15) `d = z cos(phi) cos(theta)`; one distance a column is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from perception.primitives.errors import ConfigError


@dataclass(frozen=True)
class ContourConfig:
    """How outlines are drawn from pixels."""

    near_share: float = (
        0.15  # ours: the front is looked for from this share of the nearest pixels on
    )
    window_m: float = 0.025  # ours: pixels so far off a front are not its own; five deviations
    least_rows: int = 3  # ours: pixels of a column that make a front

    def __post_init__(self) -> None:
        if not 0.0 < self.near_share < 1.0:
            raise ConfigError(f"contour: near_share={self.near_share} must lie in (0, 1)")
        if not self.window_m > 0.0 or self.least_rows < 1:
            raise ConfigError(
                f"contour: window_m={self.window_m} must be positive and "
                f"least_rows={self.least_rows} at least 1"
            )


def fronts(
    forward_m: Float32[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], config: ContourConfig
) -> tuple[Float[np.ndarray, "w"], Float[np.ndarray, "w"]]:
    """Forward distance of the nearest face in every column, and its deviation, m; NaN where none is.

    From the nearest pixels on, the mean of those within a window is taken until it rests: noise pulls a
    minimum forwards, and the top of a thing, which goes on behind its front, would pull a mean back.
    """
    held = np.where(mask, forward_m, np.nan).astype(np.float64)
    count = mask.sum(axis=0)
    known = count >= config.least_rows
    found = np.full(mask.shape[1], np.nan)
    sigma = np.full(mask.shape[1], np.nan)
    if not known.any():
        return found, sigma
    ordered = np.sort(held[:, known], axis=0)  # NaN last
    pick = np.floor(config.near_share * (count[known] - 1)).astype(int)
    middle = ordered[pick, np.arange(pick.size)]
    for _ in range(6):
        close = np.abs(ordered - middle) <= config.window_m
        middle = np.sum(ordered, axis=0, where=close) / close.sum(axis=0)
    close = np.abs(ordered - middle) <= config.window_m
    number = close.sum(axis=0)
    spread = np.sqrt(np.sum((ordered - middle) ** 2, axis=0, where=close) / number)
    found[known], sigma[known] = middle, spread / np.sqrt(number)
    return found, sigma
