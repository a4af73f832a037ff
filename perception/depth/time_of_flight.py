"""Time of flight: range along the ray to depth, with a noise model, without flying pixels and false near things.

A pixel at the rim of a thing receives light from before and behind it and reports a range in between,
where there is nothing. Such a pixel lies between two opposite neighbours that are far apart, and off both.
A surface seen at a grazing angle looks alike, so the jump must be steeper than any floor that matters.

Source: seed 004, section 4 (SR-4000: 4 mm at 1.3 m); the amplitude law and the rejection are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth, RangeView
from .phase_unwrapping import WrapConfig, wrapped


@dataclass(frozen=True)
class TofConfig:
    """Noise of the sensor, and what is thrown away."""

    sigma_at_m: float = 1.3  # published SR-4000 test: 4 mm at 1.3 m, growing with range squared
    sigma_m: float = 0.004  # published SR-4000 test
    fixed_m: float = (
        0.005  # fixed pattern 3 mm, timing 2.5 mm, rest of the wiggling: independent of range
    )
    white_amplitude: float = (
        1.0  # amplitude of a white target 2 m straight ahead; unit of the camera
    )
    least_amplitude: float = 0.03  # ours: below it a range is noise; in parts of white_amplitude
    wiggle_m: float = 0.0  # calibrated amplitude of the fourth harmonic, e.g. 0.004; 0 leaves it in
    stray_share: float = (
        0.0  # calibrated share of all light that is scattered in the lens, e.g. 0.02
    )
    stray_px: float = 25.0  # calibrated width of the scattering
    wrap_m: float = 4.997  # c / 2f at 30 MHz: ranges repeat
    wrap: WrapConfig = field(default_factory=WrapConfig)
    graze_deg: float = 3.0  # ours: a 0.4 m high camera sees the floor at 3 m under 7.6 deg
    off_sigmas: float = 3.0  # ours: a flying pixel is this far off both of its neighbours

    def __post_init__(self) -> None:
        for name in (
            "sigma_at_m",
            "sigma_m",
            "white_amplitude",
            "wrap_m",
            "off_sigmas",
            "stray_px",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tof: {name}={value} must be positive and finite")
        for name in ("fixed_m", "least_amplitude", "wiggle_m", "stray_share"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"tof: {name}={value} must not be negative, and finite")
        if not 0.0 < self.graze_deg < 45.0:
            raise ConfigError(f"tof: graze_deg={self.graze_deg} must lie between 0 and 45")


def depth(view: RangeView, config: TofConfig | None = None) -> Depth:
    """Depth along the optical axis with its deviation.

    Args:
        view: Range along the ray, m (NaN, not positive: none), and the amplitude of the return.
        config: Noise of the sensor.

    Returns:
        Depth; NaN where there is no range, the return is too weak, the range is one wrap short, or the pixel
        is a flying one.

    Raises:
        InputError: An image does not fit its camera.
    """
    config = config or TofConfig()
    expected = (view.camera.height, view.camera.width)
    for name, image in (("range", view.range_m), ("amplitude", view.amplitude)):
        if image is not None and image.shape != expected:
            raise InputError(
                f"time of flight: {name} image is {image.shape}, its camera says {expected} "
                "(rows, columns); check the intrinsics"
            )
    with np.errstate(invalid="ignore"):
        lit = valid = (view.range_m > 0.0) & np.isfinite(view.range_m)
        if view.amplitude is not None:
            valid = lit & (view.amplitude >= config.least_amplitude * config.white_amplitude)
    measured = np.where(valid, view.range_m, np.float32(np.nan))
    if view.amplitude is not None:
        relative = view.amplitude / np.float32(config.white_amplitude)
        far = wrapped(measured, relative, config.wrap_m, config.wrap)
        measured = np.where(far, np.float32(np.nan), measured)
    sigma = deviation(measured, view.amplitude, config)
    trusted = np.isfinite(measured) & ~flying(measured, sigma, view.camera, config)
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
    return Depth(z, np.where(np.isfinite(z), sigma * along, z), view.camera, view.T_body_camera)


def without_stray_light(
    range_m: Float32[np.ndarray, "h w"],
    amplitude: Float32[np.ndarray, "h w"],
    config: TofConfig,
) -> Float32[np.ndarray, "h w"]:
    """Range with the light taken off that the lens scattered here from everything else in view.

    Each pixel's return is a phasor A exp(j phi); the lens adds a wide blur of all of them, which pulls
    dark and far pixels towards what is bright and near. The blur of what was measured, less the share of its own
    blur, is the blur that was added, to second order in the share: to first order a floor beside something that
    fills half of the view would lie up to 3 mm too low.

    Args:
        range_m: Of every pixel that light came from, trusted or not; NaN of others.
        amplitude: Of the return.

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
    """What the lens added to one part of the phasor; its blur is so wide that a quarter of the resolution loses nothing."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    width, border = config.stray_px / 4.0, cv2.BORDER_REFLECT
    once = config.stray_share * cv2.GaussianBlur(small, (0, 0), width, borderType=border)
    twice = config.stray_share * cv2.GaussianBlur(once, (0, 0), width, borderType=border)
    return cv2.resize(once - twice, image.shape[::-1], interpolation=cv2.INTER_LINEAR)


def deviation(
    range_m: Float32[np.ndarray, "h w"],
    amplitude: Float32[np.ndarray, "h w"] | None,
    config: TofConfig,
) -> Float32[np.ndarray, "h w"]:
    """Deviation of range, m.

    Without amplitude it grows with the square of range, as the light of a white target falls off. With
    amplitude A (1 for a white target at 2 m) it is the shot and background noise
    `sigma_2 sqrt((A + 0.1) / 1.1) / A`, which has the published value for a white target at 1.3 m.
    """
    if amplitude is None:
        temporal = config.sigma_m * (range_m / config.sigma_at_m) ** 2
    else:
        white = (2.0 / config.sigma_at_m) ** 2
        scale = config.sigma_m * white / math.sqrt(white + 0.1)
        A = np.maximum(amplitude / np.float32(config.white_amplitude), np.float32(1e-3))
        temporal = scale * np.sqrt(A + np.float32(0.1)) / A
    return np.sqrt(temporal**2 + config.fixed_m**2).astype(np.float32)


def flying(
    range_m: Float32[np.ndarray, "h w"],
    sigma_m: Float32[np.ndarray, "h w"],
    camera: Camera,
    config: TofConfig,
) -> Bool[np.ndarray, "h w"]:
    """Pixels that lie between two opposite neighbours far apart, and off both."""
    found = np.zeros(range_m.shape, dtype=bool)
    middle = range_m[1:-1, 1:-1]
    off = config.off_sigmas * sigma_m[1:-1, 1:-1]
    steep = 2.0 / math.tan(math.radians(config.graze_deg))
    pitches = (1.0 / camera.fx, 1.0 / camera.fy, math.hypot(1.0 / camera.fx, 1.0 / camera.fy))
    pairs = (
        (range_m[1:-1, :-2], range_m[1:-1, 2:], pitches[0]),
        (range_m[:-2, 1:-1], range_m[2:, 1:-1], pitches[1]),
        (range_m[:-2, :-2], range_m[2:, 2:], pitches[2]),
        (range_m[:-2, 2:], range_m[2:, :-2], pitches[2]),
    )
    with np.errstate(invalid="ignore"):
        for one, other, pitch in pairs:
            near, far = np.minimum(one, other), np.maximum(one, other)
            jump = far - near > np.float32(steep * pitch) * near
            found[1:-1, 1:-1] |= jump & (middle > near + off) & (middle < far - off)
    return found
