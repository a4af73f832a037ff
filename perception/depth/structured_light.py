"""Structured light (RGB-D cameras such as the Kinect): depth with its noise.

The camera triangulates a pattern, so both the noise and the quantisation of depth grow with its square; one
model covers the two.

Source: Nguyen, Izadi, Lovell 2012, axial noise: 1.2 mm + 1.9 mm (z - 0.4)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth, DepthView
from ..primitives.settings import setting
from . import pixel_noise
from .distortion import Bend


@dataclass(frozen=True)
class StructuredLightConfig:
    """Standard deviation of depth, floor + growth (z - start)^2, m, and the bend that is taken out of it."""

    floor_m: float = setting(0.0012, "m", "depth noise at start_m", "Nguyen 2012")
    growth_per_m: float = setting(
        0.0019, "1/m", "growth of depth noise with (z - start_m)^2", "Nguyen 2012"
    )
    start_m: float = setting(0.4, "m", "depth at which the noise is lowest", "Nguyen 2012")
    bend: Bend = field(default_factory=Bend)

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
    """Depth with its standard deviation, that of the model unless the image is clearly noisier.

    Args:
        view: Depth along the optical axis, m; NaN, zero, negative and infinite values mean no depth.
        config: Noise model, and the bend of the sensor if it was calibrated.

    Raises:
        InputError: The image does not fit its camera.

    Source: Nguyen, Izadi, Lovell 2012.
    """
    config = config or StructuredLightConfig()
    view.camera.check_image("depth", view.depth)
    with np.errstate(invalid="ignore"):
        z = np.where((view.depth > 0.0) & np.isfinite(view.depth), view.depth, np.float32(np.nan))
    z = config.bend.straightened(z, view.camera)
    beyond = z - np.float32(config.start_m)
    sigma = np.float32(config.floor_m) + np.float32(config.growth_per_m) * beyond * beyond
    return Depth(z, pixel_noise.as_shown(z, sigma), view.camera, view.T_body_camera)
