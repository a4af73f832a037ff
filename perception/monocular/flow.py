"""Optical flow: corners tracked from the previous to the current picture, of obstacles near the floor and of the floor.

The window of a corner at the foot of a small robot shows more floor than robot. For obstacles the floor is therefore
painted in a uniform grey in both pictures, so that only the obstacle and its outline are tracked. Corners are detected
at half resolution, in a narrow band above the floor. The search of a corner begins where a point of the floor at its
pixel has moved by the camera poses: in a turn of a few degrees that is dozens of pixels away.

A corner on an outline slips along it: its covariance is that of least squares over its window, the inverse of the sum of
its squared slopes of brightness.

Source: seed 000, section 3.3 (Shi-Tomasi, pyramidal Lucas-Kanade); painting the floor and the prediction are ours;
covariance: Förstner and Gülch 1987.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from .back_projection import floor_points, project
from .result import Picture

WINDOW_PX = 21  # seed 000
LEVELS = 3  # seed 000: of the image pyramid
MAX_CORNERS = 200  # seed 000
QUALITY = 0.01  # seed 000: of a corner, relative to the best one
MIN_DISTANCE_PX = 7.0  # seed 000: between corners
MAX_RETURN_PX = 1.0  # seed 000: error after tracking forwards and backwards
BAND_PX = 12  # seed 000: rows above the floor; higher points have parallax
FLOOR_CORNERS = 150  # ours
FLOOR_DISTANCE_PX = 24.0  # ours: spreads them over the floor
CORNER_SIGMA_PX = 0.25  # ours: standard deviation of a tracked corner of the floor
# Ours: corners of 16 walks past things that stand; over the root of the summed squared slopes it is the deviation in px
BRIGHTNESS_SIGMA = 45.0  # grey levels
FLATTEST = 100.0  # grey levels^2: 4.5 px, where there is hardly any slope

Tracks = tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]
"""Pixels (u, v) in the previous and in the current picture of the corners that pass the forward-backward check."""

Window = tuple[slice, slice]
"""Rows and columns of a part of a picture."""


def track_corners(
    previous: Picture,
    current: Picture,
    ground_previous: UInt8[np.ndarray, "h w"],
    ground_current: UInt8[np.ndarray, "h w"],
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 2"]]:
    """Corners of obstacles in the band above the floor of the previous picture, tracked into the current one.

    Args:
        previous, current: The pair.
        ground_previous, ground_current: I_g of each, 255 on the floor.

    Returns:
        Their pixels (u, v) in both, and the covariance of each motion, px^2.

    Source: seed 000, section 3.3.
    """
    beside = cv2.dilate(contact_band(ground_previous), np.ones((3, 3), np.uint8))
    rows = np.flatnonzero(beside.any(axis=1))
    if not len(rows):
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2, 2))
    margin = WINDOW_PX // 4 + 1  # at half resolution: what the covariances look at
    band = slice(max(int(rows[0]) - margin, 0), int(rows[-1]) + 1 + margin)
    part = np.s_[2 * band.start : 2 * band.stop, :]
    first = _grey(previous, part)
    tone = _mean(first, ground_previous[part])
    _paint(first, ground_previous[part], tone)
    corners = _corners(_halved(first), beside[band], MAX_CORNERS, MIN_DISTANCE_PX / 2)
    above = np.array([0.0, 2.0 * band.start])

    def painted(picture: Picture, window: Window) -> UInt8[np.ndarray, "h w"]:
        grey = _grey(picture, window)
        ground = ground_previous if picture is previous else ground_current
        _paint(grey, ground[window], tone)
        return grey

    begin, end = _tracked(2.0 * corners + 0.5 + above, previous, current, painted)
    return begin, end, corner_covariances(first, begin - above)


def corner_covariances(
    grey: UInt8[np.ndarray, "h w"], corners: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance of the motion of corners (u, v) by least squares over their windows, px^2.

    Source: Förstner and Gülch 1987: sigma^2 times the inverse of the summed products of slopes.
    """
    reach = WINDOW_PX // 2 + 1
    framed = cv2.copyMakeBorder(grey, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    sums = np.empty((len(corners), 2, 2))
    for i, (u, v) in enumerate(np.rint(corners).astype(int)):
        window = framed[v : v + 2 * reach + 1, u : u + 2 * reach + 1].astype(np.float32)
        x = 0.5 * (window[1:-1, 2:] - window[1:-1, :-2])
        y = 0.5 * (window[2:, 1:-1] - window[:-2, 1:-1])
        xy = np.vdot(x, y)
        sums[i] = (np.vdot(x, x), xy), (xy, np.vdot(y, y))
    return np.asarray(BRIGHTNESS_SIGMA**2 * np.linalg.inv(sums + FLATTEST * np.eye(2)))


def _mean(grey: UInt8[np.ndarray, "h w"], mask: UInt8[np.ndarray, "h w"]) -> int:
    """Mean where the mask is 255, rounded down; 0 without such a pixel. OpenCV's masked mean takes ten times as long."""
    count = cv2.countNonZero(mask)
    return int(cv2.sumElems(cv2.bitwise_and(grey, mask))[0] * (1.0 / count)) if count else 0


def track_floor(
    previous: Picture, current: Picture, ground_previous: UInt8[np.ndarray, "h w"]
) -> Tracks:
    """Corners of the floor's texture, away from what stands on it, tracked into the current picture."""
    first = _grey(previous, np.s_[:, :])
    half = _halved(first)
    floor = cv2.resize(ground_previous, half.shape[::-1], interpolation=cv2.INTER_NEAREST)
    floor = cv2.erode(floor, np.ones((WINDOW_PX // 2, WINDOW_PX // 2), np.uint8))
    corners = _corners(half, np.asarray(floor), FLOOR_CORNERS, FLOOR_DISTANCE_PX / 2)

    def grey(picture: Picture, window: Window) -> UInt8[np.ndarray, "h w"]:
        return first[window] if picture is previous else _grey(picture, window)

    return _tracked(2.0 * corners + 0.5, previous, current, grey)


def _corners(
    grey: UInt8[np.ndarray, "h w"], mask: UInt8[np.ndarray, "h w"], most: int, distance_px: float
) -> Float[np.ndarray, "n 2"]:
    """Shi-Tomasi corners, each the strongest of those in the mask within a distance, the strongest first.

    OpenCV's own function drops a corner whose neighbour outside the mask is stronger, as at the foot of an obstacle.
    """
    strength = cv2.cornerMinEigenVal(grey, 3)
    strength[mask == 0] = 0.0
    side = 2 * math.ceil(distance_px) + 1
    peak = strength == cv2.dilate(strength, np.ones((side, side), np.uint8))
    rows, columns = np.nonzero(peak & (strength > QUALITY * float(strength.max())))
    order = np.argsort(-strength[rows, columns], kind="stable")[:most]
    return np.stack([columns[order], rows[order]], axis=1).astype(np.float64)


def _tracked(
    begin: np.ndarray,
    previous: Picture,
    current: Picture,
    grey: Callable[[Picture, Window], UInt8[np.ndarray, "h w"]],
) -> Tracks:
    """Tracks of the corners that are found again in the grey parts of both pictures."""
    if not len(begin):
        return np.zeros((0, 2)), np.zeros((0, 2))
    guess = _moved(begin, previous, current)
    window = _window_around(np.concatenate([begin, guess]), previous.rgb.shape)
    off = np.array([window[1].start, window[0].start], np.float32)
    first, second, start = grey(previous, window), grey(current, window), begin - off
    start = start.astype(np.float32)
    end, found = _lucas_kanade(first, second, start, guess - off)
    back, returned = _lucas_kanade(second, first, end, start)
    good = found & returned & (np.hypot(*(back - start).T) <= MAX_RETURN_PX)
    return begin[good], (end[good] + off).astype(np.float64)


def _window_around(pixels: np.ndarray, shape: tuple[int, ...]) -> Window:
    """Part of a picture in which corners at these pixels (u, v) are tracked as in all of it, but for those that leave it.

    It begins at a pixel of the highest level of the pyramid.
    """
    whole = 2 ** (LEVELS - 1)
    margin = WINDOW_PX * whole
    most = np.array([shape[1], shape[0]]) - 1.0
    first = np.clip(pixels.min(axis=0) - margin, 0.0, most).astype(int) // whole * whole
    last = np.clip(pixels.max(axis=0) + margin, 0.0, most).astype(int)
    return slice(first[1], last[1] + 1), slice(first[0], last[0] + 1)


def _grey(picture: Picture, window: Window) -> UInt8[np.ndarray, "h w"]:
    """Grey levels of a part of a picture."""
    return np.asarray(cv2.cvtColor(picture.rgb[window], cv2.COLOR_RGB2GRAY), np.uint8)


def _paint(grey: UInt8[np.ndarray, "h w"], mask: UInt8[np.ndarray, "h w"], tone: int) -> None:
    """Set pixels of the mask to a tone."""
    cv2.copyTo(np.full_like(grey, tone), mask, grey)


def _moved(pixels: np.ndarray, previous: Picture, current: Picture) -> np.ndarray:
    """Where floor points at these pixels are in the current picture; unmoved above the horizon."""
    places = floor_points(pixels, previous.camera, previous.T_world_camera)
    moved = project(places, current.camera, current.T_world_camera)
    known = np.isfinite(moved).all(axis=1, keepdims=True)
    return np.where(known, moved, pixels).astype(np.float32)


def _lucas_kanade(
    first: np.ndarray, second: np.ndarray, begin: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 2) of the first picture tracked into the second, and which of them were found."""
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        begin,
        guess.copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=LEVELS - 1,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(end), np.asarray(found)[:, 0] > 0


def _halved(grey: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h2 w2"]:
    size = (max(1, grey.shape[1] // 2), max(1, grey.shape[0] // 2))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def contact_band(ground: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h2 w2"]:
    """At half resolution: 255 where a pixel is not ground but one of the `BAND_PX` rows below is."""
    size = (max(1, ground.shape[1] // 2), max(1, ground.shape[0] // 2))
    half = cv2.resize(ground, size, interpolation=cv2.INTER_NEAREST)
    reach = max(1, BAND_PX // 2)
    column = np.ones((reach + 1, 1), np.uint8)
    near = cv2.dilate(half, column, anchor=(0, 0))  # of the rows below
    return np.asarray(cv2.bitwise_and(near, cv2.bitwise_not(half)), dtype=np.uint8)
