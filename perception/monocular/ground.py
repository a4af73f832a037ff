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
from .back_projection import floor_points
from .colour_range import ColourRange, mark
from .components import components
from .result import Picture

_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class GroundConfig:
    """What is too small to be floor, or too small not to be."""

    least_px: int = 500  # seed 000: components that do not touch the bottom row
    core_share: float = 0.5  # ours: of an island's pixels that lie in the core of the range
    speck_m2: float = 0.0025  # ours: a hole of 5 cm squared; a robot of 7 cm hides 80 cm^2

    def __post_init__(self) -> None:
        if self.least_px < 0 or not self.speck_m2 >= 0.0:
            raise ConfigError("ground: least_px and speck_m2 must not be negative")
        if not math.isfinite(self.speck_m2):
            raise ConfigError(f"ground: speck_m2={self.speck_m2} must be finite")
        if not 0.0 <= self.core_share <= 1.0:
            raise ConfigError(f"ground: core_share={self.core_share} must lie in [0, 1]")


def horizon_rows(camera: Camera, T_world_camera: Pose3) -> tuple[float, float]:
    """Rows of the horizon at the left and right border; beyond the picture if it is not seen there.

    Pixels above (smaller v; for a camera held upside down there is no such thing) never show the floor. A camera
    that looks straight up sees none: both are infinite.
    """
    up = T_world_camera.rotation[2]  # world z in camera axes
    rows = []
    for u in (0.0, camera.width - 1.0):
        level = up[0] * (u - camera.cx) / camera.fx + up[2]
        upright = abs(up[1]) > 1e-6
        rows.append(
            camera.cy - camera.fy * level / up[1] if upright else math.copysign(math.inf, level)
        )
    return rows[0], rows[1]


def ground_image(
    picture: Picture,
    colours: ColourRange,
    config: GroundConfig,
    core: ColourRange | None = None,
) -> UInt8[np.ndarray, "h w"]:
    """I_g, 255 on the floor: in the range, below the horizon, without specks and with small holes filled.

    Args:
        picture: Whose pose tells the horizon, and how large a hole is.
        colours: The range of the floor.
        config: Sizes.
        core: The range without its margins: what does not touch the bottom row must mostly lie in it, for
            a margin is a tolerance for what is likely to be floor anyhow. None asks for no such thing.
    """
    rgb = picture.rgb
    horizon = horizon_rows(picture.camera, picture.T_world_camera)
    mask = np.zeros(rgb.shape[:2], np.uint8)
    if min(horizon) > len(rgb) - 1:
        return mask  # nothing below the horizon is in view
    top = max(math.floor(min(horizon)), 0) if min(horizon) > 0 else 0
    below = mask[top:]
    mark(rgb[top:], colours, below)
    _clear_above(mask, horizon)
    cv2.morphologyEx(below, cv2.MORPH_OPEN, _SQUARE, dst=below)
    _drop_islands(below, rgb[top:], core, config)
    _fill_specks(mask, picture, top, config.speck_m2)
    cv2.morphologyEx(below, cv2.MORPH_CLOSE, _SQUARE, dst=below)
    return mask


def _clear_above(mask: np.ndarray, horizon: tuple[float, float]) -> None:
    """Black above the slanted horizon."""
    left, right = (max(min(row, 4.0 * len(mask)), -4.0 * len(mask)) for row in horizon)
    if max(left, right) < 0:
        return
    last = mask.shape[1] - 1
    corners = np.array([[0, left], [last, right], [last, -5e3], [0, -5e3]])
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 0)


def _drop_islands(
    mask: np.ndarray, rgb: np.ndarray, core: ColourRange | None, config: GroundConfig
) -> None:
    """Of the components that do not touch the bottom row, take away the small and the not quite right ones."""
    half = _halved(mask)
    labels, boxes, _ = components(half, 8)
    floats = boxes[:, cv2.CC_STAT_TOP] + boxes[:, cv2.CC_STAT_HEIGHT] < len(half)
    floats[0] = False
    for k in np.flatnonzero(floats):
        there, area = _parts(mask, labels, boxes[k], k)
        drop = 4 * boxes[k, cv2.CC_STAT_AREA] < config.least_px
        if core is not None and not drop:
            x, y = 2 * boxes[k, 0], 2 * boxes[k, 1]
            inner = np.zeros(there.shape, np.uint8)
            mark(rgb[y : y + there.shape[0], x : x + there.shape[1]], core, inner)
            drop = cv2.mean(inner, area)[0] < 255 * config.core_share
        if drop:
            there[area > 0] = 0


def _fill_specks(mask: np.ndarray, picture: Picture, top: int, speck_m2: float) -> None:
    """Fill holes that would be smaller than a speck if they lay on the floor."""
    below = mask[top:]
    hollow = cv2.bitwise_not(_halved(below))
    labels, boxes, middles = components(hollow, 4)
    centre = 2.0 * middles + np.array([0.5, top + 0.5])
    corners = centre[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    a, b, c = np.moveaxis(
        floor_points(corners, picture.camera, picture.T_world_camera, math.inf), 1, 0
    )
    pixel_m2 = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    fill = 4 * boxes[:, cv2.CC_STAT_AREA] * pixel_m2 < speck_m2
    x, y, w, h = boxes[:, :4].T
    fill &= (x > 0) & (x + w < hollow.shape[1]) & (y + h < hollow.shape[0])  # whole ones
    fill[0] = False
    for k in np.flatnonzero(fill):
        there, area = _parts(below, labels, boxes[k], k)
        there[cv2.dilate(area, _SQUARE) > 0] = 255


def _halved(mask: np.ndarray) -> UInt8[np.ndarray, "h w"]:
    size = (max(1, mask.shape[1] // 2), max(1, mask.shape[0] // 2))
    return np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _parts(
    mask: np.ndarray, labels: np.ndarray, box: np.ndarray, label: np.integer
) -> tuple[np.ndarray, np.ndarray]:
    """The part of a mask about a component of its half, and that component at full size."""
    x, y, w, h = (int(n) for n in box[:4])
    there = mask[2 * y : 2 * (y + h), 2 * x : 2 * (x + w)]
    area = (labels[y : y + h, x : x + w] == label).astype(np.uint8)
    size = (there.shape[1], there.shape[0])
    return there, np.asarray(cv2.resize(area, size, interpolation=cv2.INTER_NEAREST))
