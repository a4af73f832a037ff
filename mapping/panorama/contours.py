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
    forward_m: Float32[np.ndarray, "h w"],
    sigma_m: Float32[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    config: ContourConfig,
) -> tuple[Float[np.ndarray, "w"], Float[np.ndarray, "w"]]:
    """Forward distance of the nearest face in every column, and its deviation, m; NaN where none is.

    From the nearest pixels on, the mean of those within a window, weighted by their variance, is taken
    until it rests: noise pulls a minimum forwards, and the top of a thing, which goes on behind its front,
    would pull a mean back. Dark spots, whose range is poor, hardly count.

    Args:
        forward_m: Forward distance of each pixel.
        sigma_m: Deviation of its range.
        mask: Pixels of the thing.
        config: What belongs to a front.
    """
    found, sigma = np.full((2, mask.shape[1]), np.nan)
    count = mask.sum(axis=0)
    known = count >= config.least_rows
    if not known.any():
        return found, sigma
    held = np.where(mask, forward_m, np.float32(np.nan))[:, known].astype(np.float64)
    order = np.argsort(held, axis=0)  # NaN last
    held = np.take_along_axis(held, order, axis=0)
    variance = np.take_along_axis(sigma_m[:, known].astype(np.float64), order, axis=0) ** 2
    weight = np.where(np.isfinite(held) & (variance > 0.0), 1.0 / np.maximum(variance, 1e-12), 0.0)
    held = np.nan_to_num(held, nan=1e9)
    total = np.cumsum(weight, axis=0)
    pick = np.argmax(total >= config.near_share * total[-1], axis=0)
    middle = held[pick, np.arange(pick.size)]
    close = np.zeros_like(weight)
    for _ in range(6):
        close = np.where(np.abs(held - middle) <= config.window_m, weight, 0.0)
        middle = (close * held).sum(axis=0) / close.sum(axis=0)
    found[known], sigma[known] = middle, 1.0 / np.sqrt(close.sum(axis=0))
    return found, sigma
