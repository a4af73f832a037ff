"""The colour camera and the stereo pair: sizes, places in the head, lens, exposure, noise of the image.

Brightness follows the gain alone: light is as much as the exposure needs, the exposure only smears what moves.
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

from ..ranges import check_ranges
from ..rendering import lens as lenses
from ..rendering.motion import STATIONARY, Motion, exposure_times
from ..world import World


@dataclass(frozen=True)
class ImageConfig:
    """A camera that takes pictures: square pixels, optical axis through the middle.

    Args:
        width, height: Of the picture, px.
        across_deg: Full opening angle without its lens.
        mount_m: Place in the head.
        noise_grey: Deviation at gain 1, every pixel and colour its own, grey levels.
        lens: (k1, k2, p1, p2, k3); all zero draws straight.
        gain: Of brightness and noise alike; what is too bright is white.
        exposure_s: About the stamp; 0 takes an instant.
        exposure_parts: Renderings whose mean is the picture.
    """

    width: int
    height: int
    across_deg: float
    mount_m: tuple[float, float, float]
    noise_grey: float = 2.0  # notes on cameras of this size
    lens: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)  # ours: rectified
    gain: float = 1.0  # ours: brightness as painted
    exposure_s: float = 0.0  # ours: instantaneous; indoors 0.01 to 0.03 s
    exposure_parts: int = 5  # ours: a smear of up to 10 px stays even

    def __post_init__(self) -> None:
        if not 0.0 < self.across_deg < 170.0:
            raise ConfigError(f"camera: across_deg={self.across_deg} must lie in (0, 170)")
        check_ranges(
            "camera",
            self,
            width=(1.0, 1e4),
            height=(1.0, 1e4),
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
        """Its intrinsics, the lens included."""
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
    """A picture with the lens, the exposure and the noise of its sensor, red first.

    Args:
        world: At the middle of the exposure.
        config: Of the camera.
        T_world_camera: At that instant.
        rng: Of the noise.
        motion: Of the camera while it looks.
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
    """Left and right grey picture of a parallel pair with equal lenses, each with its own noise.

    Without a lens the pair is perfectly rectified; with one it is as raw as that of a real rig.
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
    """The mean over the exposure of what the lens throws on the sensor."""
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
    """What the sensor makes of it: gain on light and noise, white where it is full."""
    if config.gain != 1.0:
        bright = np.rint(image * np.float32(config.gain))
        image = np.minimum(bright, np.float32(255.0)).astype(np.uint8)
    return _noisy(image, config.noise_grey * config.gain, rng)


def _noisy(
    image: UInt8[np.ndarray, "h w *c"], sigma: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w *c"]:
    """Gaussian noise in whole grey levels, drawn by its 256 quantiles: ten times faster than normals."""
    if sigma == 0.0:
        return image
    drawn = np.frombuffer(rng.bytes(image.size), np.uint8).reshape(image.shape)
    return np.asarray(cv2.add(image, _levels(sigma)[drawn], dtype=cv2.CV_8U), dtype=np.uint8)


@cache
def _levels(sigma: float) -> Int8[np.ndarray, "256"]:
    from scipy.special import ndtri

    quantiles = ndtri((np.arange(256) + 0.5) / 256)
    return np.clip(np.rint(sigma * quantiles), -127, 127).astype(np.int8)
