"""Structured light (RGB-D cameras such as the Kinect): depth with its noise.

The camera triangulates a pattern, so both the noise and the quantisation of depth grow with its square; one
model covers the two. An image of a noisier camera shows it: along a row of pixels on a plane the inverse of depth is linear,
and what deviates from that is noise.

Source: Nguyen, Izadi, Lovell 2012, axial noise: 1.2 mm + 1.9 mm (z - 0.4)^2; noise from second differences after Immerkaer 1996,
with the median absolute deviation for robustness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth, DepthView
from ..primitives.settings import setting

NOISIER, CHAOS = 1.25, 20.0
"""Ours: an image that shows as many times the noise of the model has that noise; others scatter to 1.1. One with more shows no
surfaces at all, and has the noise of the model."""
ROWS = 60  # ours: rows of an image that show its noise to a few percent
LEAST_VALUES = 200  # ours: with fewer, the noise is that of the model
MAD_OF_GAUSSIAN = 0.6745  # median of the absolute value of a standard Gaussian


@dataclass(frozen=True)
class StructuredLightConfig:
    """Standard deviation of depth: floor + growth (z - start)^2, m."""

    floor_m: float = setting(0.0012, "m", "depth noise at start_m", "Nguyen 2012")
    growth_per_m: float = setting(
        0.0019, "1/m", "growth of depth noise with (z - start_m)^2", "Nguyen 2012"
    )
    start_m: float = setting(0.4, "m", "depth at which the noise is lowest", "Nguyen 2012")

    def __post_init__(self) -> None:
        if not (math.isfinite(self.floor_m) and self.floor_m > 0.0):
            raise ConfigError(
                f"structured_light: floor_m={self.floor_m} must be positive and finite"
            )
        for name in ("growth_per_m", "start_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(
                    f"structured_light: {name}={value} must not be negative, and finite"
                )


def depth(view: DepthView, config: StructuredLightConfig | None = None) -> Depth:
    """Depth with its standard deviation: that of the model, times a factor if the image is clearly noisier.

    Args:
        view: Depth along the optical axis, m; NaN, zero, negative and infinite values mean no depth.
        config: Noise model.

    Raises:
        InputError: The image does not fit its camera.

    Source: Nguyen, Izadi, Lovell 2012.
    """
    config = config or StructuredLightConfig()
    view.camera.check_image("depth", view.depth)
    with np.errstate(invalid="ignore"):
        z = np.where((view.depth > 0.0) & np.isfinite(view.depth), view.depth, np.float32(np.nan))
    beyond = z - np.float32(config.start_m)
    sigma = np.float32(config.floor_m) + np.float32(config.growth_per_m) * beyond * beyond
    times = noise_times(z, sigma)
    if NOISIER < times < CHAOS:
        sigma *= np.float32(times)
    return Depth(z, sigma, view.camera, view.T_body_camera)


def noise_times(z: Float32[np.ndarray, "h w"], sigma: Float32[np.ndarray, "h w"]) -> float:
    """Noise of an image from pixel to pixel, in standard deviations of its model; less if neighbours have the same noise.

    1 with too few pixels in a row that have depth.
    """
    rows = slice(None, None, max(1, len(z) // ROWS))
    depth = z[rows]
    inverse = 1.0 / depth
    bend = inverse[:, 2:] - 2.0 * inverse[:, 1:-1] + inverse[:, :-2]
    middle = depth[:, 1:-1]
    noise = np.abs(bend) * middle * middle / sigma[rows, 1:-1]
    noise = noise[np.isfinite(noise)]
    if noise.size < LEAST_VALUES:
        return 1.0
    return float(np.median(noise)) / (MAD_OF_GAUSSIAN * math.sqrt(6.0))  # of 1, -2, 1
