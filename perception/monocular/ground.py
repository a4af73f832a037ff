"""The ground image I_g: pixels of the floor's colours below the horizon, without small regions and holes.

Source: seed 000, section 3.1 (opening, components); half resolution and the filling of holes are ours.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.camera import Camera
from ..primitives.pose import Pose3
from .back_projection import floor_points
from .colour_range import ColourRange, mark
from .components import components
from .result import Picture

CORE_SHARE = 0.5  # ours: of a separate region's pixels that must lie in the core of the range
SPECK_M2 = 0.0025  # ours: a hole of 5 cm squared; a robot of 7 cm hides 80 cm^2
_SQUARE = np.ones((3, 3), np.uint8)


def horizon_rows(camera: Camera, T_world_camera: Pose3) -> tuple[float, float]:
    """Rows of the horizon at the left and right border; they may lie outside the picture.

    Pixels above (smaller v) never show the floor. Valid for a camera that is not held upside down. Both rows are
    infinite if the camera looks straight up, minus infinite if straight down.
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
    least_px: int,
    core: ColourRange | None = None,
) -> UInt8[np.ndarray, "h w"]:
    """I_g, 255 on the floor.

    Args:
        picture: Its pose gives the horizon and the size of holes on the floor.
        colours: Colour range of the floor.
        least_px: Regions smaller than this that do not touch the bottom row are removed.
        core: Narrow range in which half the pixels of such a region must lie; None for no such test.
    """
    rgb = picture.rgb
    horizon = horizon_rows(picture.camera, picture.T_world_camera)
    mask = np.zeros(rgb.shape[:2], np.uint8)
    if min(horizon) > len(rgb) - 1:
        return mask  # the horizon lies below the picture
    top = max(math.floor(min(horizon)), 0) if min(horizon) > 0 else 0
    below = mask[top:]
    mark(rgb[top:], colours, below)
    _clear_above(mask, horizon)
    cv2.morphologyEx(below, cv2.MORPH_OPEN, _SQUARE, dst=below)
    _drop_regions(below, rgb[top:], core, least_px)
    _fill_holes(mask, picture, top)
    cv2.morphologyEx(below, cv2.MORPH_CLOSE, _SQUARE, dst=below)
    return mask


def _clear_above(mask: np.ndarray, horizon: tuple[float, float]) -> None:
    """Set the mask to 0 above the horizon."""
    left, right = (max(min(row, 4.0 * len(mask)), -4.0 * len(mask)) for row in horizon)
    if max(left, right) < 0:
        return
    last = mask.shape[1] - 1
    corners = np.array([[0, left], [last, right], [last, -5e3], [0, -5e3]])
    cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 0)


def _drop_regions(
    mask: np.ndarray, rgb: np.ndarray, core: ColourRange | None, least_px: int
) -> None:
    """Remove regions that do not touch the bottom row and are small or mostly outside the core range."""
    half = _halved(mask)
    labels, boxes, _ = components(half, 8)
    separate = boxes[:, cv2.CC_STAT_TOP] + boxes[:, cv2.CC_STAT_HEIGHT] < len(half)
    separate[0] = False
    for k in np.flatnonzero(separate):
        part, area = _parts(mask, labels, boxes[k], k)
        drop = 4 * boxes[k, cv2.CC_STAT_AREA] < least_px
        if core is not None and not drop:
            x, y = 2 * boxes[k, 0], 2 * boxes[k, 1]
            inner = np.zeros(part.shape, np.uint8)
            mark(rgb[y : y + part.shape[0], x : x + part.shape[1]], core, inner)
            drop = cv2.mean(inner, area)[0] < 255 * CORE_SHARE
        if drop:
            part[area > 0] = 0


def _fill_holes(mask: np.ndarray, picture: Picture, top: int) -> None:
    """Fill holes whose area, projected onto the floor, is less than `SPECK_M2`."""
    below = mask[top:]
    hollow = cv2.bitwise_not(_halved(below))
    labels, boxes, centroids = components(hollow, 4)
    x, y, w, h = boxes[:, :4].T
    whole = (x > 0) & (x + w < hollow.shape[1]) & (y + h < hollow.shape[0])  # not cut by the border
    whole[0] = False
    holes = np.flatnonzero(whole)
    centre = 2.0 * centroids[holes] + np.array([0.5, top + 0.5])
    corners = centre[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    a, b, c = np.moveaxis(
        floor_points(corners, picture.camera, picture.T_world_camera, math.inf), 1, 0
    )
    pixel_m2 = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    fill = 4 * boxes[holes, cv2.CC_STAT_AREA] * pixel_m2 < SPECK_M2
    for k in holes[fill]:
        part, area = _parts(below, labels, boxes[k], k)
        part[cv2.dilate(area, _SQUARE) > 0] = 255


def _halved(mask: np.ndarray) -> UInt8[np.ndarray, "h w"]:
    size = (max(1, mask.shape[1] // 2), max(1, mask.shape[0] // 2))
    return np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def _parts(
    mask: np.ndarray, labels: np.ndarray, box: np.ndarray, label: np.integer
) -> tuple[np.ndarray, np.ndarray]:
    """Part of a mask that contains a component of its halved version, and that component at full size."""
    x, y, w, h = (int(n) for n in box[:4])
    part = mask[2 * y : 2 * (y + h), 2 * x : 2 * (x + w)]
    area = (labels[y : y + h, x : x + w] == label).astype(np.uint8)
    size = (part.shape[1], part.shape[0])
    return part, np.asarray(cv2.resize(area, size, interpolation=cv2.INTER_NEAREST))
