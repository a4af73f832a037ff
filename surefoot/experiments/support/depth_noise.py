"""Noise of simulated structured-light depth, by the sensor model of the product."""

from __future__ import annotations

import numpy as np

from perception.depth.structured_light import StructuredLightConfig


def structured_light_sigma(z: np.ndarray) -> np.ndarray:
    """Standard deviation of depth, m, in the precision of `z`.

    Args:
        z: True depth along the optical axis, m.

    Source: Nguyen, Izadi, Lovell 2012, axial noise.
    """
    noise = StructuredLightConfig()
    return np.asarray(noise.floor_m + noise.growth_per_m * (z - noise.start_m) ** 2)
