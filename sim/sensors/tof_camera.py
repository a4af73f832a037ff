"""Time-of-flight camera: range from the phase of modulated light.

Every pixel has several rays whose returns add up as phasors A exp(j 4 pi f d / c). A pixel on an edge therefore
measures an intermediate range (flying pixel), and a range beyond c / 2f = 5 m wraps around. Further effects are stray
light in the lens, wiggling by harmonics of the modulation, fixed-pattern noise, noise that falls with the amplitude,
and quantisation to 14 bits. Four images, a quarter period apart, give one phase; with an integration time each is
taken from the camera's pose at its own time, which causes motion artefacts at edges.

Source: seed 004, Table 3 (SR-4000); noise: published SR-4000 tests (4 mm at 1.3 m); stray light and wiggling are
plausible, not calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting

from ..ranges import MOST_PX, check_ranges
from ..rendering.motion import exposure_times
from ..rendering.surfaces import RangeSource

LIGHT_MPS = 299_792_458.0
PHASES = 4  # SR-4000: images per measurement
REFERENCE_M = 2.0  # ours: range at which the amplitude equals the albedo
AMBIENT = 0.1  # ours: shot noise of ambient light, relative to amplitude 1
STRAY_PX = 25.0  # plausible: standard deviation of stray light
FULL_SCALE_M = 5.0  # seed 004: range of the largest digital value


@dataclass(frozen=True)
class TofConfig:
    """Model of an SR-4000; amplitude 1 is a white surface facing the camera at 2 m.

    Args:
        floor_noise_m: Noise that remains at any amplitude.
        stray_share: Share of light scattered in the lens.
        wiggling_m: Amplitude of the wiggling error, four periods per wrap.
        pattern_m: Standard deviation of the fixed-pattern noise.
        dark: Amplitude below which there is no range.
        integration_s: Time of all four images; 0 is instantaneous.
    """

    width: int = 176  # seed 004
    height: int = 144  # seed 004
    across_deg: float = 44.0  # seed 004; the pixels are not square
    down_deg: float = 35.0  # seed 004
    modulation_hz: float = 30e6  # seed 004: c / 2f = 4.997 m
    sub_rays: int = 2  # ours, per axis
    noise_m: float = setting(
        0.004, "m", "standard deviation of the range at amplitude 1", "SR-4000: 4 mm at 1.3 m"
    )
    floor_noise_m: float = 0.0025  # ours
    stray_share: float = 0.02  # plausible
    wiggling_m: float = 0.004  # plausible
    pattern_m: float = 0.003  # plausible
    dark: float = 0.03  # ours
    bits: int = 14  # SR-4000
    integration_s: float = setting(
        0.0,
        "s",
        "integration time, which causes motion artefacts",
        "ours: instantaneous; SR-4000 0.01 to 0.05",
    )

    def __post_init__(self) -> None:
        for name in ("across_deg", "down_deg"):
            if not 0.0 < getattr(self, name) < 170.0:
                raise ConfigError(f"tof: {name}={getattr(self, name)} must lie in (0, 170)")
        if not (math.isfinite(self.modulation_hz) and self.modulation_hz > 0.0):
            raise ConfigError(
                f"tof: modulation_hz={self.modulation_hz} must be positive and finite"
            )
        check_ranges(
            "tof",
            self,
            width=(4.0, MOST_PX),  # stray light is blurred at a quarter of the size
            height=(4.0, MOST_PX),
            sub_rays=(1.0, 16.0),
            noise_m=(0.0, math.inf),
            floor_noise_m=(0.0, math.inf),
            stray_share=(0.0, 1.0),
            wiggling_m=(-1.0, 1.0),
            pattern_m=(0.0, math.inf),
            dark=(0.0, math.inf),
            bits=(1.0, 32.0),
            integration_s=(0.0, 1.0),
        )

    @property
    def camera(self) -> Camera:
        """Intrinsics: f_x 217.8, f_y 228.4 px."""
        return Camera.from_view(
            self.width, self.height, math.radians(self.across_deg), math.radians(self.down_deg)
        )

    @property
    def wrap_m(self) -> float:
        """Unambiguous range."""
        return LIGHT_MPS / (2.0 * self.modulation_hz)


class TofCamera:
    """A camera with its own fixed pattern and noise."""

    def __init__(self, config: TofConfig, rng: np.random.Generator) -> None:
        self.config = config
        self.camera = config.camera
        self._rng = rng
        shape = (config.height, config.width)
        self._pattern = config.pattern_m * rng.standard_normal(shape)
        self._fine = finer(self.camera, config.sub_rays)

    def measure(
        self, source: RangeSource, T_world_camera: Pose3
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """One measurement from a pose.

        Returns:
            Range along each pixel's ray, m, NaN where too little light returns, and the amplitude (1: a white surface
            facing the camera at 2 m; not bounded above).
        """
        phasor, _ = self._phasors(source, T_world_camera)
        return self._read_out(self._with_stray_light(phasor))

    @property
    def instants(self) -> list[float]:
        """Times of the four images, s from the middle of the integration."""
        return exposure_times(self.config.integration_s, PHASES)

    def measure_moving(
        self, pictures: Iterable[tuple[RangeSource, Pose3]]
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """One measurement over the integration time.

        Args:
            pictures: What is seen, and the camera pose, at each of `instants`, taken one after the other.

        Returns:
            As `measure`.
        """
        samples = []
        for quarter, (source, T_world_camera) in enumerate(pictures):
            phasor, light = self._phasors(source, T_world_camera)
            samples.append(light + (phasor * (-1j) ** quarter).real)
        first, second, third, fourth = samples
        phasor = np.asarray(((first - third) + 1j * (second - fourth)) / 2.0)
        return self._read_out(self._with_stray_light(phasor))

    def _phasors(
        self, source: RangeSource, T_world_camera: Pose3
    ) -> tuple[np.ndarray, Float[np.ndarray, "h w"]]:
        """Means over each pixel's rays: of A exp(j phi), (h, w) complex, and of the amplitude A."""
        config = self.config
        hits = source.look(self._fine, T_world_camera)
        met = np.isfinite(hits.distance_m)
        distance = np.where(met, hits.distance_m, np.float32(1.0))
        amplitude = hits.albedo * hits.cosine * (np.float32(REFERENCE_M) / distance) ** 2
        phase = np.float32(2.0 * math.pi / config.wrap_m) * distance
        real, imaginary, light = (
            self._pixel_means(part)
            for part in (amplitude * np.cos(phase), amplitude * np.sin(phase), amplitude)
        )
        return np.asarray(real + 1j * imaginary), light

    def _pixel_means(self, values: Float32[np.ndarray, "n"]) -> Float[np.ndarray, "h w"]:
        """Mean over the rays of each pixel."""
        config, n = self.config, self.config.sub_rays
        parts = values.reshape(config.height, n, config.width, n)
        return np.asarray(parts.mean(axis=(1, 3), dtype=np.float64))

    def _with_stray_light(self, phasor: np.ndarray) -> np.ndarray:
        config = self.config
        if config.stray_share == 0.0:
            return phasor
        blurred = [_blur(part, STRAY_PX) for part in (phasor.real.copy(), phasor.imag.copy())]
        return np.asarray(phasor + config.stray_share * (blurred[0] + 1j * blurred[1]))

    def _read_out(
        self, phasor: np.ndarray
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        config = self.config
        amplitude = np.abs(phasor)
        phase = np.angle(phasor) % (2.0 * math.pi)
        lit = amplitude >= config.dark
        bright = np.where(lit, amplitude, 1.0)
        sigma = config.noise_m * np.sqrt((bright + AMBIENT) / (1 + AMBIENT)) / bright
        first, second = self._rng.standard_normal((2, *phasor.shape))
        distance = (
            phase / (2.0 * math.pi) * config.wrap_m
            + config.wiggling_m * np.sin(4.0 * phase)
            + self._pattern
            + sigma * first
            + config.floor_noise_m * second
        )
        unit = FULL_SCALE_M / 2**config.bits
        measured = np.rint(distance % config.wrap_m / unit) * unit
        measured[~lit | (measured <= 0.0)] = np.nan
        return measured.astype(np.float32), amplitude.astype(np.float32)


def finer(camera: Camera, count: int) -> Camera:
    """The same camera with count x count pixels, evenly spaced, in each of its pixels."""
    return Camera(
        count * camera.width,
        count * camera.height,
        count * camera.fx,
        count * camera.fy,
        count * (camera.cx + 0.5) - 0.5,
        count * (camera.cy + 0.5) - 0.5,
    )


def _blur(image: Float[np.ndarray, "h w"], sigma_px: float) -> Float[np.ndarray, "h w"]:
    """Wide Gaussian blur at a quarter of the resolution."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / 4, borderType=cv2.BORDER_REFLECT)
    wide = (image.shape[1], image.shape[0])
    return np.asarray(cv2.resize(small, wide, interpolation=cv2.INTER_LINEAR))
