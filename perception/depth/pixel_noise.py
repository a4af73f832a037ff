"""Noise of a depth image from pixel to pixel, as the image itself shows it.

Along a row of pixels on a plane the inverse of depth is linear; what deviates from that is noise. So a camera that is
noisier than the model of its kind is noticed in each image.

Source: ours; noise from second differences after Immerkaer 1996, with the median absolute deviation for robustness.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32

NOISIER, CHAOS = 1.25, 20.0
"""Ours: an image that shows as many times the noise of the model has that noise; others scatter to 1.1. One with more shows no
surfaces at all, and has the noise of the model."""
ROWS = 60  # ours: rows of an image that show its noise to a few percent
LEAST_VALUES = 200  # ours: with fewer, the noise is that of the model
MAD_OF_GAUSSIAN = 0.6745  # median of the absolute value of a standard Gaussian


def as_shown(
    depth: Float32[np.ndarray, "h w"], sigma_m: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """The standard deviation of each pixel, times a factor if the image is clearly noisier.

    Args:
        depth: Depth or range, m; NaN without.
        sigma_m: Its standard deviation by the model.
    """
    times = _times(depth, sigma_m)
    return sigma_m * np.float32(times) if NOISIER < times < CHAOS else sigma_m


def _times(depth: Float32[np.ndarray, "h w"], sigma_m: Float32[np.ndarray, "h w"]) -> float:
    """Noise in standard deviations of its model; less if neighbours have the same noise, 1 with too few pixels in a row."""
    rows = slice(None, None, max(1, len(depth) // ROWS))
    z = depth[rows]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of depth that cannot be
        inverse = 1.0 / z
        bend = inverse[:, 2:] - 2.0 * inverse[:, 1:-1] + inverse[:, :-2]
        middle = z[:, 1:-1]
        noise = np.abs(bend) * middle * middle / sigma_m[rows, 1:-1]
    noise = noise[np.isfinite(noise)]
    if noise.size < LEAST_VALUES:
        return 1.0
    return float(np.median(noise)) / (MAD_OF_GAUSSIAN * math.sqrt(6.0))  # of 1, -2, 1
