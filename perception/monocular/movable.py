"""The result image I_r: the ground, less what moving obstacles will have taken at the end of the next step.

The contact edge moves over the floor by its velocity; the strip that it sweeps between now and then is
painted black, and so is, at its new place, what the obstacle covers of the floor behind its edge.

Source: seed 000, section 3.5.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from .back_projection import project
from .result import Picture, SeenObstacle

_FRACTION = 4  # bits of a pixel that OpenCV's polygons keep
_FAR_PX = 8000.0  # beyond, a corner of a polygon overflows
_STRIDE = 4  # px between the corners of a swept strip


def predicted_image(
    ground: UInt8[np.ndarray, "h w"], obstacles: tuple[SeenObstacle, ...], current: Picture
) -> UInt8[np.ndarray, "h w"]:
    """255 on ground that a moving obstacle sweeps or stands on within the horizon."""
    swept = np.zeros_like(ground)
    for obstacle in obstacles:
        if not obstacle.moving:
            continue
        known = np.isfinite(obstacle.contact_world).all(axis=1)
        now = obstacle.edge[known].astype(np.float64)
        if len(now) < 2:
            continue
        pick = np.unique(np.append(np.arange(0, len(now), _STRIDE), len(now) - 1))
        then = project(obstacle.predicted_world[known], current.camera, current.T_world_camera)
        _sweep(swept, now[pick], then[pick], _height_px(ground, obstacle.edge[known]))
    cv2.bitwise_and(swept, ground, dst=swept)
    return swept


def _sweep(swept: np.ndarray, now: np.ndarray, then: np.ndarray, tall_px: float) -> None:
    """Fill the quads between neighbours of the edge now and then, and the body above the edge then."""
    quads = np.stack([now[:-1], now[1:], then[1:], then[:-1]], axis=1)
    up = np.array([0.0, tall_px])
    bodies = np.stack([then[:-1], then[1:], then[1:] - up, then[:-1] - up], axis=1)
    for polygon in np.concatenate([quads, bodies]):
        if np.isfinite(polygon).all() and np.abs(polygon).max() < _FAR_PX:
            corners = np.rint(polygon * 2**_FRACTION).astype(np.int32)
            cv2.fillConvexPoly(swept, cv2.convexHull(corners), 255, shift=_FRACTION)


def _height_px(ground: np.ndarray, edge: np.ndarray) -> float:
    """Rows that the obstacle hides above its edge, up to the next ground, in the middle column."""
    u, v = (int(n) for n in edge[len(edge) // 2])
    free = np.flatnonzero(ground[: v + 1, u])
    return float(v - free[-1]) if len(free) else float(v)
