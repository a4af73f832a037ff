"""Structured light (RGB-D cameras of the Kinect kind): depth with its noise.

The pattern is triangulated, so the deviation grows with the square of depth, and so do the steps in
which depth is given; both are in the one model.

Source: Nguyen, Izadi, Lovell 2012, axial noise: 1.2 mm + 1.9 mm (z - 0.4)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth, DepthView


@dataclass(frozen=True)
class StructuredLightConfig:
    """Deviation of depth: floor + growth (z - start)^2, m."""

    floor_m: float = 0.0012  # Nguyen 2012
    growth_per_m: float = 0.0019  # Nguyen 2012
    start_m: float = 0.4  # Nguyen 2012

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
    """Depth with its deviation.

    Args:
        view: Depth along the optical axis, m; NaN, zero, negative and infinite mean none.
        config: Noise of the sensor.

    Raises:
        InputError: The image does not fit its camera.

    Source: Nguyen, Izadi, Lovell 2012.
    """
    config = config or StructuredLightConfig()
    expected = (view.camera.height, view.camera.width)
    if view.depth.shape != expected:
        raise InputError(
            f"depth image is {view.depth.shape}, its camera says {expected} (rows, columns); "
            "check the intrinsics"
        )
    with np.errstate(invalid="ignore"):
        z = np.where((view.depth > 0.0) & np.isfinite(view.depth), view.depth, np.float32(np.nan))
    beyond = z - np.float32(config.start_m)
    sigma = np.float32(config.floor_m) + np.float32(config.growth_per_m) * beyond * beyond
    return Depth(z, sigma, view.camera, view.T_body_camera)
