"""Colour camera and stereo pair: resolution, mount, lens, exposure and image noise.

Brightness depends on the gain only; the exposure time only adds motion blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Int8, UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3
from perception.primitives.settings import setting

from ..ranges import MOST_PX, check_ranges
from ..rendering import lens as lenses
from ..rendering.motion import STATIONARY, Motion, exposure_times
from ..world import World


@dataclass(frozen=True)
class ImageConfig:
    """A camera with square pixels and its principal point at the image centre.

    Args:
        noise_grey: Standard deviation at gain 1, independent per pixel and channel, grey levels.
        lens: (k1, k2, p1, p2, k3).
        gain: Of brightness and noise; values saturate at white.
        exposure_s: Exposure time, centred at the stamp; 0 is instantaneous.
        exposure_parts: Renderings that are averaged over the exposure.
    """

    width: int = setting(720, "px", "width of the image", "seed 000; stereo: ours")
    height: int = setting(720, "px", "height of the image", "seed 000; stereo: ours")
    across_deg: float = setting(
        90.0, "deg", "horizontal field of view without the lens", "seed 000; stereo: ours"
    )
    mount_m: tuple[float, float, float] = (0.035, 0.0, 0.035)  # DARwIn-OP; position in the head
    noise_grey: float = 2.0  # typical cameras of this size
    lens: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)  # ours: rectified
    gain: float = 1.0  # ours
    exposure_s: float = 0.0  # ours: instantaneous; indoors 0.01 to 0.03 s
    exposure_parts: int = 5  # ours: enough for a blur of 10 px

    def __post_init__(self) -> None:
        if not 0.0 < self.across_deg < 170.0:
            raise ConfigError(f"camera: across_deg={self.across_deg} must lie in (0, 170)")
        check_ranges(
            "camera",
            self,
            width=(1.0, MOST_PX),
            height=(1.0, MOST_PX),
            mount_m=(-2.0, 2.0),
            noise_grey=(0.0, 127.0),
            gain=(0.01, 100.0),
            exposure_s=(0.0, 1.0),
            exposure_parts=(1.0, 100.0),
        )
        if self.camera.is_distorted:
            lenses.check_lens(self.camera)

    @property
    def camera(self) -> Camera:
        """Intrinsics, with the lens."""
        focal = self.width / 2 / math.tan(math.radians(self.across_deg) / 2)
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        return Camera(self.width, self.height, focal, focal, *middle, self.lens)


def colour_picture(
    world: World,
    config: ImageConfig,
    T_world_camera: Pose3,
    rng: np.random.Generator,
    motion: Motion = STATIONARY,
) -> UInt8[np.ndarray, "h w 3"]:
    """Image with lens, exposure and sensor noise, red first.

    Args:
        world: At the middle of the exposure.
        config: Of the camera.
        T_world_camera: At that time.
        rng: Source of the noise.
        motion: Of the camera during the exposure.
    """
    return _read_out(_exposed(world, config, T_world_camera, Pose3(), motion), config, rng)


def stereo_pair(
    world: World,
    config: ImageConfig,
    baseline_m: float,
    T_world_left: Pose3,
    rng: np.random.Generator,
    motion: Motion = STATIONARY,
) -> tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """Left and right grey image of a parallel pair with equal lenses and independent noise.

    Without a lens the pair is perfectly rectified; with one it is as raw as that of a real camera.
    """
    left, right = (
        _read_out(
            cv2.cvtColor(_exposed(world, config, T_world_left, place, motion), cv2.COLOR_RGB2GRAY),
            config,
            rng,
        )
        for place in (Pose3(), Pose3((baseline_m, 0.0, 0.0)))
    )
    return left, right


def _exposed(
    world: World, config: ImageConfig, T_world_rig: Pose3, T_rig_camera: Pose3, motion: Motion
) -> UInt8[np.ndarray, "h w 3"]:
    """Mean over the exposure of the image behind the lens."""
    camera = config.camera
    ideal = lenses.lens_for(camera).ideal if camera.is_distorted else camera
    if config.exposure_s == 0.0:
        picture = world.picture(ideal, T_world_rig @ T_rig_camera)
    else:
        total = np.zeros((ideal.height, ideal.width, 3), np.float32)
        for after_s in exposure_times(config.exposure_s, config.exposure_parts):
            pose = motion.pose_after(T_world_rig, after_s) @ T_rig_camera
            total += world.picture(ideal, pose, after_s)
        picture = np.rint(total / config.exposure_parts).astype(np.uint8)
    return lenses.lens_for(camera).distorted(picture) if camera.is_distorted else picture


def _read_out(
    image: UInt8[np.ndarray, "h w *c"], config: ImageConfig, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w *c"]:
    """Apply gain, saturation and noise of the sensor."""
    if config.gain != 1.0:
        bright = np.rint(image * np.float32(config.gain))
        image = np.minimum(bright, np.float32(255.0)).astype(np.uint8)
    return _noisy(image, config.noise_grey * config.gain, rng)


def _noisy(
    image: UInt8[np.ndarray, "h w *c"], sigma: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w *c"]:
    """Add Gaussian noise in whole grey levels, drawn by its 256 quantiles: ten times faster than normal deviates."""
    if sigma == 0.0:
        return image
    drawn = np.frombuffer(rng.bytes(image.size), np.uint8).reshape(image.shape)
    return np.asarray(cv2.add(image, _levels(sigma)[drawn], dtype=cv2.CV_8U), dtype=np.uint8)


@cache
def _levels(sigma: float) -> Int8[np.ndarray, "256"]:
    from scipy.special import ndtri

    quantiles = ndtri((np.arange(256) + 0.5) / 256)
    return np.clip(np.rint(sigma * quantiles), -127, 127).astype(np.int8)
