"""Depth from a stereo pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from perception.depth import stereo
from perception.depth.rectification import rectified
from perception.depth.stereo import StereoConfig
from perception.primitives.camera import Camera

from . import checks
from .checks import ArrayLike
from .views import stereo_view


class StereoDepth(NamedTuple):
    """Depth of the left image.

    Args:
        depth_m: (h, w), along the optical axis, m; NaN where matching is not reliable.
        sigma_m: (h, w), standard deviation of depth, m; NaN likewise.
        reliability: (h, w), in [0, 1].
        camera: Of these images: the given one, without distortion.
    """

    depth_m: Float32[np.ndarray, "h w"]
    sigma_m: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]
    camera: Camera


def stereo_depth(
    left: ArrayLike,
    right: ArrayLike,
    camera: Camera,
    baseline_m: float,
    *,
    least_reliability: float = 0.3,
    nearest_m: float = 0.2,
) -> StereoDepth:
    """Depth with standard deviation and reliability from a pair of images.

    Args:
        left, right: (h, w) grey or (h, w, 3) RGB, uint8, of two equal parallel cameras: without distortion a
            point is in the same row of both.
        camera: Intrinsics of either; distortion, if it has any, is removed from both images first.
        baseline_m: Distance of the right camera to the right of the left one, m.
        least_reliability: Pixels below this have no depth.
        nearest_m: Least depth to search, m; smaller takes longer.

    Returns:
        Z = f B / d with sigma_Z = Z^2 sigma_d / (f B) for every pixel of the left image.

    Raises:
        InputError: The images are not uint8 or not of the camera's size, or the baseline is not positive.

    Source: seed 003, section 3.
    """
    view = rectified(stereo_view(left, right, baseline_m, camera))
    config = StereoConfig(
        least_reliability=checks.number(least_reliability, "least_reliability"),
        nearest_m=checks.positive(nearest_m, "nearest_m"),
    )
    matched = stereo.disparity(view, config)
    depth = stereo.depth_of(view, matched, config)
    return StereoDepth(depth.z, depth.sigma, matched.reliability, view.camera)
