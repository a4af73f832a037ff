"""Time of flight: range along the ray to depth, with the sensor's known faults undone and its noise known.

A phase camera of the SR-4000 kind. Its range wiggles with the phase by a few millimetres, a fixed curve that
calibration finds and that is subtracted here. Its noise grows as the amplitude falls. A pixel on an edge
sees two surfaces and reports a place between them ("flying"); such pixels are left out.

Source: seed 004, sections 2.3 and 7 (30 MHz, 5 m, 4 mm at 1.3 m); phasor noise figures from the
simulation study; edge rejection is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from .primitives.errors import ConfigError
from .primitives.frame import Depth, RangeView

SPEED_OF_LIGHT_MPS = 299_792_458.0


@dataclass(frozen=True)
class TofConfig:
    """Calibration and noise of the camera."""

    modulation_hz: float = 30e6  # seed 004: 30 MHz, unambiguous to 4.997 m
    noise_m: float = 0.004  # seed 004: at amplitude 1 (white wall at 2 m) or at 1.3 m without amplitude
    noise_range_m: float = 1.3  # seed 004
    ambient: float = 0.1  # noise study: share of the shot noise that is there without a return
    floor_noise_m: float = 0.0025  # noise study: what remains at high amplitude
    fixed_pattern_m: float = 0.003  # noise study: per pixel, the same in every frame
    wiggle_m: float = 0.004  # noise study: amplitude of the phase error; 0 leaves it in
    least_amplitude: float = 0.05  # ours: below, the range is hardly more than noise
    edge_m: float = 0.05  # ours: a pixel between two jumps of this size flies

    def __post_init__(self) -> None:
        for name in ("modulation_hz", "noise_m", "noise_range_m", "edge_m"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"tof: {name}={getattr(self, name)} must be positive")


def depth(view: RangeView, config: TofConfig | None = None) -> Depth:
    """Depth along the optical axis with its deviation.

    Args:
        view: Range along the ray, m, and amplitude.
        config: Calibration and noise.

    Returns:
        NaN where there is no range, the amplitude is too low, or the pixel flies.

    Source: seed 004, Table 3; wiggling and noise after the simulation study.
    """
    config = config or TofConfig()
    measured = view.range_m.astype(np.float64)
    phase = 4.0 * np.pi * config.modulation_hz / SPEED_OF_LIGHT_MPS * measured
    corrected = measured - config.wiggle_m * np.sin(4.0 * phase)
    if view.amplitude is None:
        shot = config.noise_m * (measured / config.noise_range_m) ** 2
    else:
        amplitude = np.maximum(view.amplitude.astype(np.float64), 1e-6)
        shot = config.noise_m * np.sqrt((amplitude + config.ambient) / (1 + config.ambient))
        shot = shot / amplitude
        corrected[amplitude < config.least_amplitude] = np.nan
    corrected[_flying(measured, config.edge_m)] = np.nan
    sigma = np.sqrt(shot**2 + config.floor_noise_m**2 + config.fixed_pattern_m**2)
    along = 1.0 / np.linalg.norm(view.camera.rays, axis=-1)  # from along the ray to along the axis
    z = (corrected * along).astype(np.float32)
    spread = np.where(np.isfinite(z), sigma * along, np.nan).astype(np.float32)
    return Depth(z, spread, view.camera, view.T_body_camera)


def _flying(range_m: np.ndarray, edge_m: float) -> Bool[np.ndarray, "h w"]:
    """Pixels halfway up a jump: steeply rising on one side and going on rising on the other.

    Down the image a floor rises steadily too; there the two rises must also be unequal.
    """
    flying = np.zeros(range_m.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        across = np.diff(range_m, axis=1)
        before, after = across[:, :-1], across[:, 1:]
        flying[:, 1:-1] |= (before * after > 0) & (
            np.minimum(np.abs(before), np.abs(after)) > edge_m
        )
        down = np.diff(range_m, axis=0)
        before, after = down[:-1], down[1:]
        steep = np.minimum(np.abs(before), np.abs(after)) > edge_m
        uneven = np.abs(before - after) > np.maximum(edge_m, 0.5 * np.abs(before + after) / 2)
        flying[1:-1] |= (before * after > 0) & steep & uneven
    return flying


