"""The ground image I_g: what has the floor's colours, looks at the floor, and is no speck.

Source: seed 000, section 3.1 (opening, components); working at half resolution and filled specks are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError
from ..primitives.pose import Pose3
from .colour_range import ColourRange, mark

_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class GroundConfig:
    """What is too small to be floor, or too small not to be."""

    least_px: int = 500  # seed 000: components that do not touch the bottom row
    speck_px: int = (
        60  # ours: no obstacle is smaller where it matters; joints and knots of boards are
    )

    def __post_init__(self) -> None:
        if self.least_px < 0 or self.speck_px < 0:
            raise ConfigError("ground: least_px and speck_px must not be negative")


def horizon_rows(camera: Camera, T_world_camera: Pose3) -> tuple[float, float]:
    """Rows of the horizon at the left and right border; beyond the picture if it is not seen there.

    Pixels above (smaller v; for a camera held upside down there is no such thing) never show the floor.
    """
    up = T_world_camera.rotation[2]  # world z in camera axes
    rows = []
    for u in (0.0, camera.width - 1.0):
        level = up[0] * (u - camera.cx) / camera.fx + up[2]
        rows.append(camera.cy - camera.fy * level / up[1] if abs(up[1]) > 1e-6 else -math.inf)
    return rows[0], rows[1]


def ground_image(
    rgb: UInt8[np.ndarray, "h w 3"],
    colours: ColourRange,
    config: GroundConfig,
    horizon: tuple[float, float] = (-math.inf, -math.inf),
) -> UInt8[np.ndarray, "h w"]:
    """I_g, 255 on the floor.

    Args:
        rgb: Picture.
        colours: Range of the floor.
        config: Sizes, in pixels of the picture.
        horizon: Rows at the left and right border above which nothing is floor (`horizon_rows`).
    """
    mask = np.zeros(rgb.shape[:2], np.uint8)
    top = min(max(math.floor(min(horizon)), 0), rgb.shape[0]) if min(horizon) > 0 else 0
    below = mask[top:]
    mark(rgb[top:], colours, below)
    _clear_above(mask, horizon)
    cv2.morphologyEx(below, cv2.MORPH_OPEN, _SQUARE, dst=below)
    _sift(below, config)
    return mask


def _clear_above(mask: np.ndarray, horizon: tuple[float, float]) -> None:
    """Black above the slanted horizon."""
    left, right = (max(min(row, 4.0 * len(mask)), -4.0 * len(mask)) for row in horizon)
    if max(left, right) < 0:
        return
    last = mask.shape[1] - 1
    corners = np.array([[0, left], [last, right], [last, -5e3], [0, -5e3]])
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 0)


def _sift(mask: np.ndarray, config: GroundConfig) -> None:
    """Drop small components and fill small holes, both found at half resolution."""
    height, width = mask.shape
    size = (max(1, width // 2), max(1, height // 2))
    half = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(half, connectivity=8, ltype=cv2.CV_16U)
    touches = stats[:, cv2.CC_STAT_TOP] + stats[:, cv2.CC_STAT_HEIGHT] >= size[1] - 1
    drop = ~touches & (4 * stats[:, cv2.CC_STAT_AREA] < config.least_px)
    drop[0] = False
    hollow = cv2.bitwise_not(half)
    _, holes, sizes, _ = cv2.connectedComponentsWithStats(hollow, connectivity=4, ltype=cv2.CV_16U)
    fill = 4 * sizes[:, cv2.CC_STAT_AREA] < config.speck_px
    fill[0] = False
    for boxes, table, chosen, paint in ((stats, labels, drop, 0), (sizes, holes, fill, 255)):
        for k in np.flatnonzero(chosen):
            x, y, w, h = (int(n) for n in boxes[k, :4])
            area = (table[y : y + h, x : x + w] == k).astype(np.uint8)
            there = mask[2 * y : 2 * (y + h), 2 * x : 2 * (x + w)]
            large = cv2.resize(
                area, (there.shape[1], there.shape[0]), interpolation=cv2.INTER_NEAREST
            )
            if paint == 0:
                there[large > 0] = 0
            else:
                there[cv2.dilate(large, _SQUARE) > 0] = 255
