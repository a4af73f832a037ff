"""Phase wrapping of continuous-wave cameras: find ranges that are one ambiguity interval too short.

The phase repeats every c / 2f, so a wall at 6 m is measured at 1 m. A range alone does not show the wrap, but the
amplitude does: it falls with the square of range, so a pixel whose reflectance would have to be that of soot at
the measured range lies one interval farther. For intermediate amplitudes the neighbourhood decides: a real
surface is connected to pixels that are certainly near (the floor, a brighter part of the same object); a
wrapped one begins in mid-air.

Source: ours; amplitude against range as in S. Choi et al., "Range unfolding for time-of-flight depth cameras"
(ICIP 2010).
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32

# Reflectance times the cosine of incidence; 1 is a white target seen head-on.
DARKEST = 0.02  # ours: no surface is darker; such a pixel is wrapped
DOUBTFUL = 0.12  # ours: a brighter pixel is at its measured range
BRIGHTEST = 1.2  # ours: no surface is brighter; such a pixel cannot be one interval farther
JOINED_M = 0.15  # ours: neighbours closer in range than this are connected


def wrapped(
    range_m: Float32[np.ndarray, "h w"], amplitude: Float32[np.ndarray, "h w"], wrap_m: float
) -> Bool[np.ndarray, "h w"]:
    """Pixels whose true range is one ambiguity interval longer.

    Args:
        range_m: Along the ray, m; NaN where there is none.
        amplitude: Of the return; 1 for a white target 2 m straight ahead.
        wrap_m: Ambiguity interval, m.
    """
    valid = np.isfinite(range_m)
    r = np.where(valid, range_m, np.float32(0.0))
    near = amplitude * np.square(r / 2.0)
    far = amplitude * np.square((r + np.float32(wrap_m)) / 2.0)
    dark = valid & (near < DARKEST)
    doubtful = valid & ~dark & (near < DOUBTFUL) & (far <= BRIGHTEST)
    if not doubtful.any():
        return dark
    certain = np.where(valid & ~dark & ~doubtful, r, np.float32(np.inf))
    labels = _smooth_regions(doubtful, r)
    near_regions = np.zeros(labels.max() + 1, dtype=bool)
    near_regions[labels[doubtful & _touches(certain, r)]] = True
    near_regions[0] = False
    return dark | (doubtful & ~near_regions[labels])


def _smooth_regions(mask: Bool[np.ndarray, "h w"], r: Float32[np.ndarray, "h w"]) -> np.ndarray:
    """(h, w) labels of the connected parts of a mask without range jumps; 0 outside and at jumps."""
    square = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(np.where(mask, r, np.float32(1e6)), square)
    farthest = cv2.dilate(np.where(mask, r, np.float32(-1e6)), square)
    smooth = mask & (farthest - nearest < 2.0 * JOINED_M)
    _, labels = cv2.connectedComponents(smooth.astype(np.uint8), connectivity=8)
    return np.asarray(labels)


def _touches(
    certain: Float32[np.ndarray, "h w"], r: Float32[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels with one of eight neighbours at a certain range within `JOINED_M` of their own."""
    padded = np.pad(certain, 1, constant_values=np.inf)
    height, width = r.shape
    found = np.zeros(r.shape, dtype=bool)
    for down in range(3):
        for right in range(3):
            found |= np.abs(padded[down : down + height, right : right + width] - r) < JOINED_M
    return found
