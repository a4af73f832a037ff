"""Time of flight: range along the ray to depth, with a noise model and rejection of false pixels.

Source: Kang et al. 2013 (seed 004), section 4 (SR-4000: 4 mm at 1.3 m); amplitude law ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from ..primitives.errors import ConfigError
from ..primitives.frame import Depth, RangeView
from ..primitives.settings import setting
from . import pixel_noise
from .flying import flying
from .phase_unwrapping import wrapped

SIGMA_AT_M = 1.3  # range at which `sigma_m` holds: the published SR-4000 test
LEAST_AMPLITUDE = 0.03  # ours: a weaker return has no range; share of white_amplitude
BRIGHTEST = 10.0  # ours: reflectance that half of an image does not have, white being 1; raw units give hundreds


@dataclass(frozen=True)
class TofConfig:
    """Noise and calibration of the sensor."""

    sigma_m: float = setting(
        0.004, "m", "range noise of a white target at 1.3 m", "published SR-4000 test"
    )
    fixed_m: float = 0.005  # SR-4000: pattern 3 mm, timing 2.5 mm, residual harmonics; range error that does not depend on range
    white_amplitude: float = 1.0  # ours: normalised; amplitude of a white target 2 m straight ahead
    wiggle_m: float = setting(
        0.0, "m", "calibrated amplitude of the fourth harmonic, removed from range", "calibration"
    )
    stray_share: float = setting(
        0.0, "", "calibrated share of light scattered in the lens, removed", "calibration"
    )
    stray_px: float = 25.0  # calibration; calibrated width of the scattering
    wrap_m: float = setting(4.997, "m", "ambiguity interval of range", "c / 2f at 30 MHz")

    def __post_init__(self) -> None:
        for name in ("sigma_m", "white_amplitude", "wrap_m", "stray_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tof: {name}={value} must be positive and finite")
        for name in ("fixed_m", "wiggle_m", "stray_share"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"tof: {name}={value} must not be negative, and finite")


def depth(view: RangeView, config: TofConfig | None = None) -> Depth:
    """Depth along the optical axis with its standard deviation.

    Args:
        view: Range along the ray, m (NaN or not positive: none), and the amplitude of the return.
        config: Noise and calibration of the sensor.

    Returns:
        Depth; NaN where there is no range, the return is too weak, the range is wrapped, or the pixel is a
        flying pixel.

    Raises:
        InputError: An image does not fit its camera.
    """
    config = config or TofConfig()
    view.camera.check_image("range", view.range_m)
    if view.amplitude is not None:
        view.camera.check_image("amplitude", view.amplitude)
    with np.errstate(invalid="ignore"):
        lit = valid = (view.range_m > 0.0) & np.isfinite(view.range_m)
        if view.amplitude is not None:
            valid = lit & (view.amplitude >= LEAST_AMPLITUDE * config.white_amplitude)
    measured = np.where(valid, view.range_m, np.float32(np.nan))
    if view.amplitude is not None:
        relative = view.amplitude / np.float32(config.white_amplitude)
        far = wrapped(measured, relative, config.wrap_m)
        measured = np.where(far, np.float32(np.nan), measured)
    sigma = pixel_noise.as_shown(measured, range_sigma(measured, view.amplitude, config))
    trusted = np.isfinite(measured) & ~flying(measured, sigma, view.camera)
    straight = np.where(lit, view.range_m, np.float32(np.nan))
    if config.wiggle_m > 0.0:
        phase = np.float32(2.0 * math.pi / config.wrap_m) * straight
        straight = straight - np.float32(config.wiggle_m) * np.sin(4.0 * phase)
    if config.stray_share > 0.0 and view.amplitude is not None:
        straight = without_stray_light(straight, view.amplitude, config)
    measured = np.where(trusted, straight, np.float32(np.nan))
    x, y = view.camera.slopes
    along = (1.0 / np.sqrt(1.0 + x * x + y * y)).astype(np.float32)  # z of a ray of length 1
    z = measured * along
    sigma_z = np.where(np.isfinite(z), sigma * along, z)
    return Depth(z, sigma_z, view.camera, view.T_body_camera, amplitude=view.amplitude)


def raw_amplitude(view: RangeView | None) -> str:
    """What is wrong with amplitudes in the units of a sensor; empty for those of `depth`.

    The return of a target falls with the square of its range, so amplitude times (range / 2 m)^2 is its reflectance
    where a white target 2 m straight ahead has amplitude 1. In raw units the noise would seem hundreds of times too
    small, and no return too weak.
    """
    if view is None or view.amplitude is None:
        return ""
    with np.errstate(invalid="ignore", over="ignore"):
        reflectance = view.amplitude * np.square(view.range_m / np.float32(2.0))
        seen = reflectance[np.isfinite(reflectance) & (view.range_m > 0.0)]
    typical = float(np.median(seen)) if seen.size else 0.0
    if typical <= BRIGHTEST:
        return ""
    return (
        f"tof: half of the amplitudes are more than {typical:.3g} times those of a white target; divide them by the "
        "amplitude of a sheet of white paper 2 m straight ahead, or give none"
    )


def without_stray_light(
    range_m: Float32[np.ndarray, "h w"],
    amplitude: Float32[np.ndarray, "h w"],
    config: TofConfig,
) -> Float32[np.ndarray, "h w"]:
    """Range corrected for light that the lens scatters from elsewhere in the image.

    The return of a pixel is a phasor A exp(j phi). The lens adds a wide blur of all phasors, which biases dark
    and far pixels towards bright and near ones. The measured image is already blurred, so the correction is
    of second order in the share: to first order, a floor beside an object that fills half of the view would
    be up to 3 mm too low.

    Args:
        range_m: Of every pixel with a return, reliable or not; NaN elsewhere.
        amplitude: Of the return.
        config: Share and width of the scattering.

    Source: scattering compensation after Mure-Dubois and Huegli 2007.
    """
    per_m = 2.0 * math.pi / config.wrap_m
    known = np.isfinite(range_m)
    phase = np.where(known, range_m, 0.0) * per_m
    strength = np.where(known, amplitude, 0.0)
    real, imaginary = strength * np.cos(phase), strength * np.sin(phase)
    clean_real, clean_imaginary = (part - _scattered(part, config) for part in (real, imaginary))
    turn = np.arctan2(
        clean_imaginary * real - clean_real * imaginary,
        clean_real * real + clean_imaginary * imaginary,
    )
    return (range_m + turn / per_m).astype(np.float32)


def _scattered(image: np.ndarray, config: TofConfig) -> np.ndarray:
    """Scattered light in one component of the phasor; the wide blur is computed at a quarter of the resolution."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    width, border = config.stray_px / 4.0, cv2.BORDER_REFLECT
    once = config.stray_share * cv2.GaussianBlur(small, (0, 0), width, borderType=border)
    twice = config.stray_share * cv2.GaussianBlur(once, (0, 0), width, borderType=border)
    return cv2.resize(once - twice, image.shape[::-1], interpolation=cv2.INTER_LINEAR)


def range_sigma(
    range_m: Float32[np.ndarray, "h w"],
    amplitude: Float32[np.ndarray, "h w"] | None,
    config: TofConfig,
) -> Float32[np.ndarray, "h w"]:
    """Standard deviation of range, m.

    Without amplitude it grows with the square of range, as for a white target. With amplitude A (1 for a white
    target at 2 m) it is shot and background noise, `sigma_2 sqrt((A + 0.1) / 1.1) / A`, which has the
    published value for a white target at 1.3 m.
    """
    if amplitude is None:
        temporal = config.sigma_m * (range_m / SIGMA_AT_M) ** 2
    else:
        white = (2.0 / SIGMA_AT_M) ** 2
        scale = config.sigma_m * white / math.sqrt(white + 0.1)
        A = np.maximum(amplitude / np.float32(config.white_amplitude), np.float32(1e-3))
        temporal = scale * np.sqrt(A + np.float32(0.1)) / A
    return np.sqrt(temporal**2 + config.fixed_m**2).astype(np.float32)
