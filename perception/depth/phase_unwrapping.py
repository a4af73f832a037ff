"""Ranges one wrap short: a continuous-wave camera says 1 m of a wall that is 6 m away.

The phase repeats every c / 2f, and nothing in one range tells how often. The light does: an answer is dim as
its thing is far, so what would have to be as dark as soot at the range told stands one wrap farther. In between
both are possible. Then its surroundings decide: a real thing hangs together with something that is surely near
(the floor it stands on, the brighter part of itself), the far wall's image begins in mid-air.

Source: ours; amplitude against range as in S. Choi et al., "Range unfolding for time-of-flight depth cameras"
(ICIP 2010).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from ..primitives.errors import ConfigError


@dataclass(frozen=True)
class WrapConfig:
    """How dark things are, cosine to the ray included, in parts of a white one seen straight on."""

    darkest: float = 0.02  # ours: nothing is darker
    doubtful: float = 0.12  # ours: a brighter one is where it seems
    brightest: float = 1.2  # ours: what would have to be brighter one wrap farther is not there
    joined_m: float = 0.15  # ours: neighbours nearer in range than this hang together

    def __post_init__(self) -> None:
        if not 0.0 <= self.darkest <= self.doubtful <= self.brightest:
            raise ConfigError(
                f"wrap: darkest={self.darkest}, doubtful={self.doubtful}, brightest={self.brightest} "
                "must not be negative and must grow"
            )
        if not self.joined_m > 0.0:
            raise ConfigError(f"wrap: joined_m={self.joined_m} must be positive")


def wrapped(
    range_m: Float32[np.ndarray, "h w"],
    amplitude: Float32[np.ndarray, "h w"],
    wrap_m: float,
    config: WrapConfig,
) -> Bool[np.ndarray, "h w"]:
    """Pixels that show something one wrap farther.

    Args:
        range_m: Along the ray, m; NaN: none.
        amplitude: Of the return; 1 for a white target 2 m straight ahead.
        wrap_m: Where ranges repeat, m.
        config: How dark things are.
    """
    valid = np.isfinite(range_m)
    r = np.where(valid, range_m, np.float32(0.0))
    near = amplitude * np.square(r / 2.0)
    far = amplitude * np.square((r + np.float32(wrap_m)) / 2.0)
    dark = valid & (near < config.darkest)
    doubtful = valid & ~dark & (near < config.doubtful) & (far <= config.brightest)
    if not doubtful.any():
        return dark
    sure = np.where(valid & ~dark & ~doubtful, r, np.float32(np.inf))
    joined = _pieces(doubtful, r, config.joined_m)
    held = np.zeros(joined.max() + 1, dtype=bool)
    held[joined[doubtful & _beside(sure, r, config.joined_m)]] = True
    held[0] = False
    return dark | (doubtful & ~held[joined])


def _pieces(
    mask: Bool[np.ndarray, "h w"], r: Float32[np.ndarray, "h w"], joined_m: float
) -> np.ndarray:
    """(h, w) labels: pieces of a mask within which range does not jump; 0 outside, and at jumps."""
    square = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(mask, r, np.float32(1e6)), square)
    farthest = cv2.dilate(np.where(mask, r, np.float32(-1e6)), square)
    smooth = mask & (farthest - nearest < 2.0 * joined_m)
    _, labels = cv2.connectedComponents(smooth.astype(np.uint8), connectivity=8)
    return np.asarray(labels)


def _beside(
    sure: Float32[np.ndarray, "h w"], r: Float32[np.ndarray, "h w"], joined_m: float
) -> Bool[np.ndarray, "h w"]:
    """Pixels with one of eight neighbours that is surely there and about as far."""
    padded = np.pad(sure, 1, constant_values=np.inf)
    height, width = r.shape
    found = np.zeros(r.shape, dtype=bool)
    for down in range(3):
        for right in range(3):
            found |= np.abs(padded[down : down + height, right : right + width] - r) < joined_m
    return found
