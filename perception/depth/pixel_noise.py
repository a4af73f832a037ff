"""Noise of a depth image from pixel to pixel, as the image itself shows it.

Along a row of pixels on a plane the inverse of depth is linear; what deviates from that is noise. So a camera that is
noisier than the model of its kind is noticed in each image. Pixels some columns apart are compared: a stereo camera gives
neighbours nearly the same error.

Source: ours; noise from second differences after Immerkaer 1996, with the median absolute deviation for robustness.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32

NOISIER, CHAOS = 1.25, 20.0
"""Ours: an image that shows as many times the noise of the model has that noise; others scatter to 1.1. One with more shows no
surfaces at all, and has the noise of the model."""
APART_PX, APART_SHARE = 4, 1.0 / 80.0
"""Ours: columns between the pixels compared, about the radius of the blocks that stereo cameras match, and fewer in an image
narrower than 320. Nine sets of real images show .5 to 1.4 of the noise of the model so, and 0 to 1.1 by neighbours."""
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
    """Noise in standard deviations of its model; less if it is alike in the pixels compared, 1 if too few are in a row."""
    apart = min(APART_PX, max(1, round(APART_SHARE * depth.shape[1])))
    rows = slice(None, None, max(1, len(depth) // ROWS))
    z = depth[rows]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of depth that cannot be
        inverse = 1.0 / z
        one, middle, other = (slice(k, k - 2 * apart or None) for k in (0, apart, 2 * apart))
        bend = inverse[:, other] - 2.0 * inverse[:, middle] + inverse[:, one]
        noise = np.abs(bend) * z[:, middle] ** 2 / sigma_m[rows, middle]
    noise = noise[np.isfinite(noise)]
    if noise.size < LEAST_VALUES:
        return 1.0
    return float(np.median(noise)) / (MAD_OF_GAUSSIAN * math.sqrt(6.0))  # of 1, -2, 1
