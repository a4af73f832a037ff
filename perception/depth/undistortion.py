"""Depth images of distorted lenses as a camera without distortion sees them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import UInt8

from ..primitives.camera import Camera
from ..primitives.frame import Depth


def undistorted(
    depth: Depth, rgb: UInt8[np.ndarray, "h w 3"] | None = None
) -> tuple[Depth, UInt8[np.ndarray, "h w 3"] | None]:
    """A depth image and its registered picture without lens distortion; unchanged if there is none.

    Depth along the optical axis stays the same at its new pixel. Nearest pixels are taken, so that edges are not
    smeared.
    """
    camera = depth.camera
    if not camera.is_distorted:
        return depth, rgb
    size = (camera.width, camera.height)
    maps = cv2.initUndistortRectifyMap(
        camera.matrix, np.array(camera.distortion), np.eye(3), camera.matrix, size, cv2.CV_32FC1
    )

    def remapped(image: np.ndarray, outside: float) -> np.ndarray:
        border = cv2.BORDER_CONSTANT
        return np.asarray(
            cv2.remap(image, *maps, cv2.INTER_NEAREST, borderMode=border, borderValue=outside)
        )

    straight = Camera(*size, camera.fx, camera.fy, camera.cx, camera.cy)
    seen = depth.amplitude
    flat = replace(
        depth,
        z=remapped(depth.z, float("nan")),
        amplitude=None if seen is None else remapped(seen, float("nan")),
        sigma=remapped(depth.sigma, float("nan")),
        camera=straight,
    )
    return flat, None if rgb is None else remapped(rgb, 0.0)
