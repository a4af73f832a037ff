"""A time-of-flight camera: light goes out modulated, and the phase of what returns tells the range.

Every pixel looks along several rays; what returns adds up as phasors A exp(j 4 pi f d / c). So a pixel on
an edge sees a range that nothing has (flying pixels), and anything beyond c / 2f = 5 m appears 5 m nearer
(wrap-around), without being told to. On top: light scattered in the lens, the wiggling of a modulation
that is not a pure sine, the pattern of the pixels, noise that falls with the amplitude, and 14 bits. Four pictures, a
quarter of a period apart, make one phase; over an integration time each is taken from where the camera then is,
so what moves has ranges at its edges that nothing has.

Source: seed 004, Table 3 (SR-4000); figures of noise: published SR-4000 tests (4 mm at 1.3 m); stray
light and wiggling are plausible, not calibrated.
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

from ..ranges import check_ranges
from ..rendering.motion import exposure_times
from ..rendering.rays import RayCaster

LIGHT_MPS = 299_792_458.0
PHASES = 4  # SR-4000: pictures of one measurement


@dataclass(frozen=True)
class TofConfig:
    """An SR-4000 as it is modelled; amplitude 1 is a white surface facing the camera at 2 m."""

    width: int = 176  # seed 004
    height: int = 144  # seed 004
    across_deg: float = 44.0  # seed 004; the pixels are not square
    down_deg: float = 35.0  # seed 004
    modulation_hz: float = 30e6  # seed 004: c / 2f = 4.997 m
    sub_rays: int = 2  # ours, per axis: 9 / 27 / 50 ms for 1 / 2 / 3
    reference_m: float = 2.0  # ours: where amplitude equals albedo
    noise_m: float = 0.004  # published tests: 4 mm at 1.3 m
    ambient: float = 0.1  # ours: shot noise of light that is not ours
    floor_noise_m: float = 0.0025  # ours: what remains however bright
    stray_share: float = 0.02  # plausible: light scattered inside the lens
    stray_px: float = 25.0  # plausible: how far
    wiggling_m: float = 0.004  # plausible: four periods a wrap
    pattern_m: float = 0.003  # plausible: fixed, every pixel its own
    dark: float = 0.03  # ours: below this amplitude there is no range
    full_scale_m: float = 5.0  # seed 004
    bits: int = 14  # SR-4000
    integration_s: float = (
        0.0  # ours: an instant; of an SR-4000 0.01 to 0.05 s, all four pictures together
    )

    def __post_init__(self) -> None:
        for name in ("across_deg", "down_deg"):
            if not 0.0 < getattr(self, name) < 170.0:
                raise ConfigError(f"tof: {name}={getattr(self, name)} must lie in (0, 170)")
        for name in ("modulation_hz", "reference_m", "full_scale_m", "stray_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"tof: {name}={value} must be positive and finite")
        check_ranges(
            "tof",
            self,
            width=(4.0, 1e4),  # stray light is blurred at a quarter of the size
            height=(4.0, 1e4),
            sub_rays=(1.0, 16.0),
            noise_m=(0.0, math.inf),
            ambient=(0.0, math.inf),
            floor_noise_m=(0.0, math.inf),
            stray_share=(0.0, 1.0),
            stray_px=(0.1, 1000.0),
            wiggling_m=(-1.0, 1.0),
            pattern_m=(0.0, math.inf),
            dark=(0.0, math.inf),
            bits=(1.0, 32.0),
            integration_s=(0.0, 1.0),
        )

    @property
    def camera(self) -> Camera:
        """Its pinhole: f_x 217.8, f_y 228.4 px."""
        return Camera.from_view(
            self.width, self.height, math.radians(self.across_deg), math.radians(self.down_deg)
        )

    @property
    def wrap_m(self) -> float:
        """Beyond it ranges start again from 0."""
        return LIGHT_MPS / (2.0 * self.modulation_hz)


class TofCamera:
    """One camera with its own fixed pattern and its own noise."""

    def __init__(self, config: TofConfig, rng: np.random.Generator) -> None:
        self.config = config
        self.camera = config.camera
        self._rng = rng
        shape = (config.height, config.width)
        self._pattern = config.pattern_m * rng.standard_normal(shape)
        self._rays = _sub_rays(self.camera, config.sub_rays)

    def measure(
        self, caster: RayCaster, T_world_camera: Pose3
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """One exposure from a pose.

        Returns:
            Range along each pixel's ray, m, NaN where too little light returns, and the amplitude
            (1: a white surface facing the camera at 2 m; not bounded above).
        """
        phasor, _ = self._phasors(caster, T_world_camera)
        return self._read_out(self._with_stray_light(phasor))

    @property
    def instants(self) -> list[float]:
        """When the four pictures are taken, s from the middle of the integration."""
        return exposure_times(self.config.integration_s, PHASES)

    def measure_moving(
        self, pictures: Iterable[tuple[RayCaster, Pose3]]
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """One exposure over the integration time.

        Args:
            pictures: At each of `instants` the rays and the pose of the camera; taken one after the other.

        Returns:
            As `measure`.
        """
        samples = []
        for quarter, (caster, T_world_camera) in enumerate(pictures):
            phasor, light = self._phasors(caster, T_world_camera)
            samples.append(light + (phasor * (-1j) ** quarter).real)
        first, second, third, fourth = samples
        phasor = np.asarray(((first - third) + 1j * (second - fourth)) / 2.0)
        return self._read_out(self._with_stray_light(phasor))

    def _phasors(
        self, caster: RayCaster, T_world_camera: Pose3
    ) -> tuple[np.ndarray, Float[np.ndarray, "h w"]]:
        """(h, w) complex: the mean over each pixel's rays of A exp(j phi); and of A, the light as such."""
        config = self.config
        world = self._rays @ np.ascontiguousarray(T_world_camera.rotation.T, dtype=np.float32)
        hits = caster.cast(T_world_camera.position, world)
        met = np.isfinite(hits.distance_m)
        distance = np.where(met, hits.distance_m, np.float32(1.0))
        amplitude = hits.albedo * hits.cosine * (np.float32(config.reference_m) / distance) ** 2
        phase = np.float32(2.0 * math.pi / config.wrap_m) * distance
        shape = (config.sub_rays**2, config.height, config.width)
        real = (amplitude * np.cos(phase)).reshape(shape).mean(axis=0, dtype=np.float64)
        imaginary = (amplitude * np.sin(phase)).reshape(shape).mean(axis=0, dtype=np.float64)
        light = np.asarray(amplitude.reshape(shape).mean(axis=0, dtype=np.float64))
        return np.asarray(real + 1j * imaginary), light

    def _with_stray_light(self, phasor: np.ndarray) -> np.ndarray:
        config = self.config
        if config.stray_share == 0.0:
            return phasor
        blurred = [
            _blur(part, config.stray_px) for part in (phasor.real.copy(), phasor.imag.copy())
        ]
        return np.asarray(phasor + config.stray_share * (blurred[0] + 1j * blurred[1]))

    def _read_out(
        self, phasor: np.ndarray
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        config = self.config
        amplitude = np.abs(phasor)
        phase = np.angle(phasor) % (2.0 * math.pi)
        lit = amplitude >= config.dark
        bright = np.where(lit, amplitude, 1.0)
        sigma = config.noise_m * np.sqrt((bright + config.ambient) / (1 + config.ambient)) / bright
        first, second = self._rng.standard_normal((2, *phasor.shape))
        distance = (
            phase / (2.0 * math.pi) * config.wrap_m
            + config.wiggling_m * np.sin(4.0 * phase)
            + self._pattern
            + sigma * first
            + config.floor_noise_m * second
        )
        unit = config.full_scale_m / 2**config.bits
        measured = np.rint(distance % config.wrap_m / unit) * unit
        measured[~lit | (measured <= 0.0)] = np.nan
        return measured.astype(np.float32), amplitude.astype(np.float32)


def _sub_rays(camera: Camera, count: int) -> Float32[np.ndarray, "n 3"]:
    """Unit rays in the camera frame: for each of count x count places in the pixel, all pixels."""
    within = (np.arange(count) + 0.5) / count - 0.5
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    bundles = []
    for dv in within:
        for du in within:
            x = (u + du - camera.cx) / camera.fx
            y = (v + dv - camera.cy) / camera.fy
            bundles.append(np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3))
    rays = np.concatenate(bundles)
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


def _blur(image: Float[np.ndarray, "h w"], sigma_px: float) -> Float[np.ndarray, "h w"]:
    """A wide Gaussian, at a quarter of the resolution: 25 px change nothing over four."""
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / 4, borderType=cv2.BORDER_REFLECT)
    wide = (image.shape[1], image.shape[0])
    return np.asarray(cv2.resize(small, wide, interpolation=cv2.INTER_LINEAR))
