"""Lens distortion: render a wider pinhole image and resample it along the distorted rays.

Source: Brown-Conrady, as in `perception.primitives.camera`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError

WIDEST = 3.0  # ours: greatest ratio of the fields of view with and without distortion


@dataclass(frozen=True, eq=False)
class Lens:
    """Resampling of an ideal image.

    Args:
        ideal: Pinhole camera to render, with margins for every distorted ray.
        columns, rows: Position of each pixel's ray in the ideal image, px.
    """

    ideal: Camera
    columns: Float32[np.ndarray, "h w"]
    rows: Float32[np.ndarray, "h w"]

    def distorted(self, picture: UInt8[np.ndarray, "h2 w2 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """Resample an ideal image."""
        image = cv2.remap(picture, self.columns, self.rows, cv2.INTER_LINEAR)
        return np.asarray(image, dtype=np.uint8)


@cache
def lens_for(camera: Camera) -> Lens:
    """Lens of a camera with distortion, cached."""
    x = camera.rays[..., 0] * camera.fx + camera.cx  # px of the undistorted image
    y = camera.rays[..., 1] * camera.fy + camera.cy
    left, top = math.floor(x.min()) - 1, math.floor(y.min()) - 1
    width, height = math.ceil(x.max()) + 2 - left, math.ceil(y.max()) + 2 - top
    ideal = Camera(width, height, camera.fx, camera.fy, camera.cx - left, camera.cy - top)
    return Lens(ideal, (x - left).astype(np.float32), (y - top).astype(np.float32))


def check_lens(camera: Camera) -> None:
    """Refuse a distortion that folds the image or needs far too wide a field of view.

    Raises:
        ConfigError: Radii are not monotonic, or a corner looks too far outward.
    """
    w, h = camera.width - 1.0, camera.height - 1.0
    corners = np.array([[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]])
    rays = camera.back_project(corners, np.ones(4))
    with np.errstate(invalid="ignore", over="ignore"):
        outward = rays[:, None] * np.append(np.ones(2), 0.0) * np.linspace(0, 1, 41)[:, None]
        places = camera.project(outward + np.array([0.0, 0.0, 1.0]))
        away = np.linalg.norm(places - places[:, :1], axis=-1)
        kept = (np.diff(away, axis=1) > 0.0).all() and np.abs(places[:, -1] - corners).max() < 0.01
        wide = (np.ptp(rays[:, :2], axis=0) * (camera.fx, camera.fy)).max() / max(w, h)
    if not (kept and wide <= WIDEST):
        raise ConfigError(
            f"camera: lens={camera.distortion} folds the image or widens the field of view more than "
            f"{WIDEST:g} times; choose smaller coefficients (k1, k2, p1, p2, k3)"
        )
