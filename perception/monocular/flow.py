"""Optical flow: corners of obstacles close to the floor, tracked from the previous to the current picture.

The window of a corner at the foot of a small robot shows more floor than robot. The floor is therefore painted in a
uniform grey in both pictures, so that only the obstacle and its outline are tracked. Corners are detected at half
resolution, in a narrow band above the floor.

Source: seed 000, section 3.3 (Shi-Tomasi, pyramidal Lucas-Kanade); painting the floor is ours.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

WINDOW_PX = 21  # seed 000
LEVELS = 3  # seed 000: of the image pyramid
MAX_CORNERS = 200  # seed 000
QUALITY = 0.01  # seed 000: of a corner, relative to the best one
MIN_DISTANCE_PX = 7.0  # seed 000: between corners
MAX_RETURN_PX = 1.0  # seed 000: error after tracking forwards and backwards
BAND_PX = 12  # seed 000: rows above the floor; higher points have parallax
CORNER_SIGMA_PX = 0.25  # ours: standard deviation of a tracked corner


def track_corners(
    previous: UInt8[np.ndarray, "h w 3"],
    current: UInt8[np.ndarray, "h w 3"],
    ground_previous: UInt8[np.ndarray, "h w"],
    ground_current: UInt8[np.ndarray, "h w"],
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Corners of the previous picture in the band above its floor, tracked into the current one.

    Args:
        previous, current: RGB.
        ground_previous, ground_current: I_g of each, 255 on the floor.

    Returns:
        Pixels (u, v) in both pictures, of the corners that pass the forward-backward check.

    Source: seed 000, section 3.3.
    """
    none = np.zeros((0, 2))
    band = contact_band(ground_previous)
    rows = np.flatnonzero(band.any(axis=1))
    if not len(rows):
        return none, none.copy()
    margin = WINDOW_PX * 2 ** (LEVELS - 1)
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
        MAX_CORNERS,
        QUALITY,
        MIN_DISTANCE_PX / 2,
        mask=band[top // 2 : top // 2 + len(half), : half.shape[1]],
    )
    if corners is None:
        return none, none.copy()
    begin = corners * 2.0 + 0.5  # centre of a half pixel
    begin = begin.astype(np.float32)
    end, found = _lucas_kanade(grey[0], grey[1], begin)
    back, returned = _lucas_kanade(grey[1], grey[0], end)
    off = np.linalg.norm((back - begin)[:, 0], axis=1)
    good = found & returned & (off <= MAX_RETURN_PX)
    shift = np.array([0.0, top])
    return begin[good, 0].astype(np.float64) + shift, end[good, 0].astype(np.float64) + shift


def _lucas_kanade(
    first: np.ndarray, second: np.ndarray, begin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 1, 2) of the first picture tracked into the second, and which of them were found."""
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        begin,
        begin.copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=LEVELS - 1,
    )
    return np.asarray(end), np.asarray(found)[:, 0] > 0


def contact_band(ground: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h2 w2"]:
    """At half resolution: 255 where a pixel is not ground but one of the `BAND_PX` rows below is."""
    size = (max(1, ground.shape[1] // 2), max(1, ground.shape[0] // 2))
    half = cv2.resize(ground, size, interpolation=cv2.INTER_NEAREST)
    reach = max(1, BAND_PX // 2)
    column = np.ones((reach + 1, 1), np.uint8)
    near = cv2.dilate(half, column, anchor=(0, 0))  # of the rows below
    return np.asarray(cv2.bitwise_and(near, cv2.bitwise_not(half)), dtype=np.uint8)
