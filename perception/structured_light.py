"""RGB-D cameras of the Kinect kind: depth as it comes, with the deviation that is known of them.

Source: noise model sigma = 1.2 mm + 1.9 mm (z - 0.4 m)^2 (Nguyen, Izadi, Lovell 2012, axial noise).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .primitives.errors import ConfigError
from .primitives.frame import Depth, DepthView


@dataclass(frozen=True)
class StructuredLightConfig:
    """Axial noise of the camera."""

    least_m: float = 0.0012  # Nguyen 2012
    growth_per_m: float = 0.0019  # Nguyen 2012: times (z - 0.4 m)^2
    nearest_m: float = 0.4  # Nguyen 2012

    def __post_init__(self) -> None:
        if not (self.least_m > 0.0 and self.growth_per_m >= 0.0):
            raise ConfigError(
                f"structured light: least_m={self.least_m} must be positive and "
                f"growth_per_m={self.growth_per_m} not negative"
            )


def depth(view: DepthView, config: StructuredLightConfig | None = None) -> Depth:
    """The same depth with its deviation, m; NaN stays NaN."""
    config = config or StructuredLightConfig()
    z = view.depth.astype(np.float32)
    sigma = config.least_m + config.growth_per_m * (z - config.nearest_m) ** 2
    return Depth(z, sigma.astype(np.float32), view.camera, view.T_body_camera)
