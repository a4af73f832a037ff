"""Image pyramid of an RGB-D image, prepared for alignment.

The source image of an alignment needs only its points. The target also needs a plane and grey gradients at
every pixel; these cost more and only references need them, so they are computed on first use.

Source: Newcombe et al., KinectFusion (2011), projective association; planes by inverse depth are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float32, UInt8, UInt16

from ..depth.distortion import Distortion, DistortionConfig
from ..primitives.camera import Camera
from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth
from ..primitives.plane import Plane
from . import _pyramid_kernels as kernels
from ._align_kernels import Source, Target

NO_GREY = np.zeros((1, 1), np.float32)


OFF_FLOOR_SIGMAS = 4.0  # ours: points closer to the floor plane count as floor
OFF_FLOOR_M = 0.02  # ours: the same, at least
STEP_M = 1e-4  # ours: steps of compressed depth; longer where an image reaches beyond 6.5 m
SIGMA_STEP = 0.2  # of a step of depth: those of its standard deviation
VAGUE = 0.25
"""Ours: compressed images leave out depth whose standard deviation is a larger share of it."""


@dataclass(frozen=True)
class PyramidConfig:
    """Sizes of the image pyramid."""

    finest_px: int = 320  # ours: more pixels add time and no accuracy; width of the finest level
    levels: int = 3  # ours: each half as wide as the previous one; 80 px converge from large steps

    def __post_init__(self) -> None:
        if self.finest_px < 40:
            raise ConfigError(f"odometry: finest_px={self.finest_px} must be at least 40")
        if not 1 <= self.levels <= 6:
            raise ConfigError(f"odometry: levels={self.levels} must lie in 1 .. 6")


@dataclass(frozen=True, eq=False)
class Level:
    """One level of the pyramid.

    Args:
        z: Depth along the optical axis, m, NaN where missing.
        sigma: Standard deviation of z, m.
        grey: 0 to 255; (1, 1) without a colour image.
        camera: Intrinsics of this level.
        counts: 1 where a pixel is off the floor: only those count for the overlap.
    """

    z: Float32[np.ndarray, "h w"]
    sigma: Float32[np.ndarray, "h w"]
    grey: Float32[np.ndarray, "a b"]
    camera: Camera
    counts: UInt8[np.ndarray, "h w"]

    @cached_property
    def packed(self) -> Float32[np.ndarray, "h w 8"]:
        """Plane, depth, grey value and its gradient of every pixel, 32 bytes each."""
        x, y = self.slopes
        camera = self.camera
        return np.asarray(kernels.pack(self.z, self.sigma, self.grey, x, y, camera.fx, camera.fy))

    @cached_property
    def slopes(self) -> tuple[Float32[np.ndarray, "w"], Float32[np.ndarray, "h"]]:
        """x/z of every column and y/z of every row."""
        x, y = self.camera.single_slopes
        return x[0], y[:, 0]

    @cached_property
    def as_source(self) -> Source:
        """The level as the moved image of an alignment."""
        return Source(self.z, self.sigma, self.grey, self.counts, *self.slopes)

    @cached_property
    def as_target(self) -> Target:
        """The level as the fixed image of an alignment."""
        camera = self.camera
        return Target(self.packed, np.array([camera.fx, camera.fy, camera.cx, camera.cy]))


@dataclass(frozen=True, eq=False)
class Pyramid:
    """The levels of one image.

    Args:
        levels: Finest first.
        floor: In the camera frame, if known.
        bend: Relative depth error common to large regions of the image: median of its standard deviation.
    """

    levels: tuple[Level, ...]
    floor: Plane | None = None
    bend: float = 0.0

    @property
    def has_grey(self) -> bool:
        """True if there is a colour image beside the depth."""
        return self.levels[0].grey.shape == self.levels[0].z.shape


@dataclass(frozen=True, eq=False)
class CompressedImage:
    """An image in a sixth of its memory: depth in steps, mostly tenths of a millimetre, and grey values in 8 bit."""

    z: UInt16[np.ndarray, "h w"]
    sigma: UInt16[np.ndarray, "h w"]
    grey: UInt8[np.ndarray, "a b"]
    camera: Camera
    floor: Plane | None
    bend: float
    levels: int
    step_m: float

    def pyramid(self) -> Pyramid:
        """The decompressed image pyramid."""
        z = self.z.astype(np.float32) * np.float32(self.step_m)
        z[self.z == 0] = np.nan
        sigma = self.sigma.astype(np.float32) * np.float32(SIGMA_STEP * self.step_m)
        grey = self.grey.astype(np.float32)
        levels = _levels(z, sigma, grey, self.camera, self.floor, self.levels)
        return Pyramid(levels, self.floor, self.bend)


def compress(image: Pyramid) -> CompressedImage:
    """Compress an image; depth that is hardly known is dropped, see `VAGUE`."""
    level = image.levels[0]
    known = level.sigma < VAGUE * level.z
    step = max(STEP_M, float(np.max(level.z, initial=0.0, where=known)) / 65534.0)
    with np.errstate(invalid="ignore"):
        z = np.where(known, level.z / step + 0.5, 0.0).astype(np.uint16)
        steps = np.clip(level.sigma / (SIGMA_STEP * step), 1.0, 65535.0)
        sigma = np.where(known, steps, 0.0).astype(np.uint16)
    grey = level.grey.astype(np.uint8)
    count = len(image.levels)
    return CompressedImage(z, sigma, grey, level.camera, image.floor, image.bend, count, step)


def build(
    depth: Depth,
    rgb: UInt8[np.ndarray, "h w 3"] | None = None,
    floor: Plane | None = None,
    config: PyramidConfig | None = None,
    distortion: Distortion | None = None,
) -> Pyramid:
    """Build the pyramid of one image.

    Args:
        depth: Depth image with standard deviations.
        rgb: Colour image registered to the depth; None aligns by depth alone.
        floor: In the camera frame, if known: overlap is measured off it, since a bare floor fits everywhere.
        config: Sizes; the defaults if None.
        distortion: Of the depth camera; the published one of an RGB-D camera if None.

    Raises:
        InputError: The colour image is not as large as the depth image.
    """
    config = config or PyramidConfig()
    z, sigma, camera = depth.z, depth.sigma, depth.camera
    grey: np.ndarray = NO_GREY.astype(np.uint8)
    if rgb is not None:
        if rgb.shape[:2] != z.shape:
            raise InputError(
                f"odometry: colour image of {rgb.shape[:2]} for a depth image of {z.shape}; register it first"
            )
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if camera.is_distorted:
        z, sigma, grey, camera = _undistorted(z, sigma, grey, camera)
    factor = max(1, round(camera.width / config.finest_px))
    light = grey.astype(np.float32) if factor == 1 else grey
    if factor > 1:
        z, sigma, light = kernels.downsample(z, sigma, light, factor)
        camera = downsampled(camera, factor)
    levels = _levels(z, sigma, light, camera, floor, config.levels)
    return Pyramid(levels, floor, _bend(levels[-1], distortion or DistortionConfig().depth))


def _bend(level: Level, distortion: Distortion) -> float:
    """Median over the image of the relative depth error by distortion; 0 without depth."""
    z, sigma = level.z.astype(float), level.sigma.astype(float)
    seen = z > 0.0
    return float(np.median(distortion.size(z[seen], sigma[seen]))) if seen.any() else 0.0


def _levels(
    z: np.ndarray,
    sigma: np.ndarray,
    light: np.ndarray,
    camera: Camera,
    floor: Plane | None,
    count: int,
) -> tuple[Level, ...]:
    """The finest level and all smaller ones."""
    levels = []
    for number in range(count):
        if number > 0:
            z, sigma, light = kernels.downsample(z, sigma, light, 2)
            camera = downsampled(camera, 2)
        levels.append(Level(z, sigma, light, camera, _off_floor(z, sigma, camera, floor)))
        if min(camera.width, camera.height) < 32:
            break
    return tuple(levels)


def downsampled(camera: Camera, factor: int) -> Camera:
    """Intrinsics of an image whose pixels are the means of factor x factor pixels."""
    half = (factor - 1) / 2
    return Camera(
        camera.width // factor,
        camera.height // factor,
        camera.fx / factor,
        camera.fy / factor,
        (camera.cx - half) / factor,
        (camera.cy - half) / factor,
    )


def _off_floor(
    z: np.ndarray, sigma: np.ndarray, camera: Camera, floor: Plane | None
) -> UInt8[np.ndarray, "h w"]:
    if floor is None:
        return np.ones(z.shape, np.uint8)
    x, y = camera.single_slopes
    nx, ny, nz = floor.normal.astype(np.float32)
    drop = nx * x + ny * y + nz  # distance to the plane lost per metre of depth
    distance = np.abs(drop * z + np.float32(floor.offset_m))
    near = np.float32(OFF_FLOOR_SIGMAS) * sigma * np.abs(drop)
    return np.asarray(distance > np.maximum(near, np.float32(OFF_FLOOR_M))).astype(np.uint8)


def _undistorted(
    z: np.ndarray, sigma: np.ndarray, grey: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Camera]:
    """The images without lens distortion; nearest pixel, which keeps depth edges sharp."""
    straight = Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    maps = cv2.initUndistortRectifyMap(
        camera.matrix,
        np.array(camera.distortion),
        np.eye(3),
        camera.matrix,
        (camera.width, camera.height),
        cv2.CV_32FC1,
    )
    nothing = float("nan")

    def remapped(image: np.ndarray, border: float) -> np.ndarray:
        return np.asarray(
            cv2.remap(
                image, *maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=border
            )
        )

    if grey.shape == z.shape:
        grey = remapped(grey, 0.0)
    return remapped(z, nothing), remapped(sigma, nothing), grey, straight
