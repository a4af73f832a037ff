"""Prediction for the result image I_r: floor that moving obstacles sweep until the end of the next step.

The contact edge moves over the floor with the obstacle's velocity. The strip that it sweeps is predicted as
occupied, and so is the image area of the obstacle above the edge at its predicted position.

Source: seed 000, section 3.5.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from .back_projection import project
from .result import Picture, SeenObstacle

_FRACTION = 4  # bits of a pixel that OpenCV's polygons keep
_FAR_PX = 8000.0  # beyond, a vertex of a polygon overflows
_STRIDE = 4  # px between the vertices of a swept strip


def predicted_image(
    ground: UInt8[np.ndarray, "h w"], obstacles: tuple[SeenObstacle, ...], current: Picture
) -> UInt8[np.ndarray, "h w"]:
    """255 on ground that a moving obstacle sweeps or covers within the horizon."""
    swept = np.zeros_like(ground)
    for obstacle in obstacles:
        if not obstacle.moving:
            continue
        known = np.isfinite(obstacle.contact_world).all(axis=1)
        current_px = obstacle.edge[known].astype(np.float64)
        if len(current_px) < 2:
            continue
        pick = np.unique(np.append(np.arange(0, len(current_px), _STRIDE), len(current_px) - 1))
        predicted_px = project(
            obstacle.predicted_world[known], current.camera, current.T_world_camera
        )
        _sweep(
            swept, current_px[pick], predicted_px[pick], _height_px(ground, obstacle.edge[known])
        )
    cv2.bitwise_and(swept, ground, dst=swept)
    return swept


def _sweep(swept: np.ndarray, now: np.ndarray, then: np.ndarray, tall_px: float) -> None:
    """Fill the strip between the current and the predicted edge, and the body above the predicted edge."""
    quads = np.stack([now[:-1], now[1:], then[1:], then[:-1]], axis=1)
    up = np.array([0.0, tall_px])
    bodies = np.stack([then[:-1], then[1:], then[1:] - up, then[:-1] - up], axis=1)
    for polygon in np.concatenate([quads, bodies]):
        if np.isfinite(polygon).all() and np.abs(polygon).max() < _FAR_PX:
            corners = np.rint(polygon * 2**_FRACTION).astype(np.int32)
            cv2.fillConvexPoly(swept, cv2.convexHull(corners), 255, shift=_FRACTION)


def _height_px(ground: np.ndarray, edge: np.ndarray) -> float:
    """Height of the obstacle in its middle column: rows from its edge up to the next ground."""
    u, v = (int(n) for n in edge[len(edge) // 2])
    free = np.flatnonzero(ground[: v + 1, u])
    return float(v - free[-1]) if len(free) else float(v)
