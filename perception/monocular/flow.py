"""Corners of obstacles close above the floor, followed from the previous to the current picture.

A corner at the foot of a small robot has more floor than robot in its window, and floor stands still. So the
floor is painted over with one grey in both pictures before anything is followed: what is left to see is the
obstacle and its outline. Corners are looked for at half resolution, in a band above the floor alone.

Source: seed 000, section 3.3 (Shi-Tomasi, pyramidal Lucas-Kanade); the painted floor is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from ..primitives.errors import ConfigError


@dataclass(frozen=True)
class FlowConfig:
    """Corners and how they are followed."""

    window_px: int = 21  # seed 000
    levels: int = 3  # seed 000
    corners: int = 200  # seed 000
    quality: float = 0.01  # seed 000
    apart_px: float = 7.0  # seed 000
    agree_px: float = 1.0  # seed 000: forward and back again
    band_px: int = 12  # seed 000: higher points seem to move, by parallax

    def __post_init__(self) -> None:
        if self.window_px < 5 or self.window_px % 2 == 0:
            raise ConfigError(f"flow: window_px={self.window_px} must be odd and at least 5")
        for name in ("levels", "corners", "band_px"):
            if getattr(self, name) < 1:
                raise ConfigError(f"flow: {name}={getattr(self, name)} must be at least 1")
        if not 0.0 < self.quality <= 1.0:
            raise ConfigError(f"flow: quality={self.quality} must lie in (0, 1]")
        for name in ("apart_px", "agree_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"flow: {name}={value} must be positive and finite")


def follow(
    previous: UInt8[np.ndarray, "h w 3"],
    current: UInt8[np.ndarray, "h w 3"],
    ground_previous: UInt8[np.ndarray, "h w"],
    ground_current: UInt8[np.ndarray, "h w"],
    config: FlowConfig,
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Corners (u, v) of the previous picture within the band above its ground, and where they went.

    Args:
        previous, current: RGB.
        ground_previous, ground_current: I_g of each, 255 on the floor.
        config: Corners, windows and checks.

    Returns:
        Places in both pictures, px, of those that come back to where they began; none is (0, 2) twice.

    Source: seed 000, section 3.3.
    """
    none = np.zeros((0, 2))
    band = contact_band(ground_previous, config.band_px)
    rows = np.flatnonzero(band.any(axis=1))
    if not len(rows):
        return none, none.copy()
    margin = config.window_px * 2 ** (config.levels - 1)
    top = max(int(rows[0]) * 2 - margin, 0) // 2 * 2
    bottom = min(int(rows[-1]) * 2 + 2 + margin, len(previous))
    grey = []
    tone: int | None = None
    for rgb, ground in ((previous, ground_previous), (current, ground_current)):
        image = cv2.cvtColor(rgb[top:bottom], cv2.COLOR_RGB2GRAY)
        floor = ground[top:bottom]
        if tone is None:
            tone = int(cv2.mean(image, floor)[0])
        image[floor > 0] = tone
        grey.append(image)
    half = cv2.resize(
        grey[0][: len(grey[0]) // 2 * 2], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA
    )
    corners = cv2.goodFeaturesToTrack(
        half,
        config.corners,
        config.quality,
        config.apart_px / 2,
        mask=band[top // 2 : top // 2 + len(half), : half.shape[1]],
    )
    if corners is None:
        return none, none.copy()
    begin = corners * 2.0 + 0.5  # centre of a half pixel
    begin = begin.astype(np.float32)
    end, found = _lucas_kanade(grey[0], grey[1], begin, config)
    back, returned = _lucas_kanade(grey[1], grey[0], end, config)
    off = np.linalg.norm((back - begin)[:, 0], axis=1)
    good = found & returned & (off <= config.agree_px)
    shift = np.array([0.0, top])
    return begin[good, 0].astype(np.float64) + shift, end[good, 0].astype(np.float64) + shift


def _lucas_kanade(
    first: np.ndarray, second: np.ndarray, begin: np.ndarray, config: FlowConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Where corners (n, 1, 2) of the first picture are in the second, and which were found."""
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        begin,
        begin.copy(),
        winSize=(config.window_px, config.window_px),
        maxLevel=config.levels - 1,
    )
    return np.asarray(end), np.asarray(found)[:, 0] > 0


def contact_band(ground: UInt8[np.ndarray, "h w"], band_px: int) -> UInt8[np.ndarray, "h2 w2"]:
    """At half resolution: 255 where there is no ground, but some within so many rows below."""
    size = (max(1, ground.shape[1] // 2), max(1, ground.shape[0] // 2))
    half = cv2.resize(ground, size, interpolation=cv2.INTER_NEAREST)
    reach = max(1, band_px // 2)
    column = np.ones((reach + 1, 1), np.uint8)
    near = cv2.dilate(half, column, anchor=(0, 0))  # looks at the rows below
    return np.asarray(cv2.bitwise_and(near, cv2.bitwise_not(half)), dtype=np.uint8)
