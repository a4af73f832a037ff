"""One RGB-D image made ready for alignment: small, smaller, smallest.

What moves is a plain list of points; what it is aligned with also has a plane and grey slopes at every pixel.
Those cost more and only references need them, so they are made when first asked for.

Source: Newcombe et al., KinectFusion (2011), projective association; planes by inverse depth are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float32, UInt8, UInt16

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth
from ..primitives.plane import Plane
from . import _pyramid_kernels as kernels

NO_GREY = np.zeros((1, 1), np.float32)


@dataclass(frozen=True)
class PyramidConfig:
    """How far images are shrunk."""

    finest_px: int = 320  # ours: width from which on more pixels cost time and give no accuracy
    levels: int = 3  # ours: each half as wide as the one before; 80 pixels forgive large steps
    off_floor_sigmas: float = 4.0  # ours: points nearer to the floor plane count as floor
    off_floor_m: float = 0.02  # ours: the same, at least

    def __post_init__(self) -> None:
        if self.finest_px < 40:
            raise ConfigError(f"odometry: finest_px={self.finest_px} must be at least 40")
        if not 1 <= self.levels <= 6:
            raise ConfigError(f"odometry: levels={self.levels} must lie in 1 .. 6")


@dataclass(frozen=True, eq=False)
class Level:
    """One size of the image.

    Args:
        z: Along the axis, m, NaN where there is none.
        sigma: Deviation of z, m.
        grey: Full scale 255; (1, 1) where there is no picture.
        camera: Intrinsics of this size.
        counts: 1 where a pixel is not floor: overlap is judged by those.
    """

    z: Float32[np.ndarray, "h w"]
    sigma: Float32[np.ndarray, "h w"]
    grey: Float32[np.ndarray, "a b"]
    camera: Camera
    counts: UInt8[np.ndarray, "h w"]

    @cached_property
    def packed(self) -> Float32[np.ndarray, "h w 8"]:
        """Plane, depth, grey and its slopes of every pixel, in 32 bytes."""
        x, y = self.slopes
        camera = self.camera
        return np.asarray(kernels.pack(self.z, self.sigma, self.grey, x, y, camera.fx, camera.fy))

    @cached_property
    def slopes(self) -> tuple[Float32[np.ndarray, "w"], Float32[np.ndarray, "h"]]:
        """x/z of every column and y/z of every row."""
        x, y = self.camera.single_slopes
        return x[0], y[:, 0]

    @cached_property
    def intrinsics(self) -> np.ndarray:
        """fx, fy, cx, cy in px."""
        camera = self.camera
        return np.array([camera.fx, camera.fy, camera.cx, camera.cy])


@dataclass(frozen=True, eq=False)
class Pyramid:
    """The sizes of one image, finest first."""

    levels: tuple[Level, ...]
    floor: Plane | None = None

    @property
    def has_grey(self) -> bool:
        """Whether there is a picture beside the depth."""
        return self.levels[0].grey.shape == self.levels[0].z.shape


@dataclass(frozen=True, eq=False)
class Kept:
    """An image put away in a sixth of its room: depth in tenths of a millimetre, grey in 8 bit."""

    z: UInt16[np.ndarray, "h w"]
    sigma: UInt16[np.ndarray, "h w"]
    grey: UInt8[np.ndarray, "a b"]
    camera: Camera
    floor: Plane | None
    config: PyramidConfig

    def pyramid(self) -> Pyramid:
        """The image made ready again."""
        z = self.z.astype(np.float32) * np.float32(1e-4)
        z[self.z == 0] = np.nan
        sigma = self.sigma.astype(np.float32) * np.float32(2e-5)
        return _levels(z, sigma, self.grey.astype(np.float32), self.camera, self.floor, self.config)


def keep(image: Pyramid, config: PyramidConfig | None = None) -> Kept:
    """Put an image away; depth beyond 6.5 m is forgotten."""
    level = image.levels[0]
    with np.errstate(invalid="ignore"):
        near = level.z < 6.5
        z = np.where(near, level.z * 1e4 + 0.5, 0.0).astype(np.uint16)
        sigma = np.where(near, np.clip(level.sigma * 5e4, 1.0, 65535.0), 0.0).astype(np.uint16)
    grey = level.grey.astype(np.uint8)
    return Kept(z, sigma, grey, level.camera, image.floor, config or PyramidConfig())


def build(
    depth: Depth,
    rgb: UInt8[np.ndarray, "h w 3"] | None = None,
    floor: Plane | None = None,
    config: PyramidConfig | None = None,
) -> Pyramid:
    """Make one image ready.

    Args:
        depth: Image with its deviation.
        rgb: Picture registered to the depth, red first; None aligns by depth alone.
        floor: In the camera frame, if known: overlap is judged off it, for a bare floor fits everywhere.
        config: Sizes.

    Raises:
        InputError: The picture is not as large as the depth image.
    """
    config = config or PyramidConfig()
    z, sigma, camera = depth.z, depth.sigma, depth.camera
    grey: np.ndarray = NO_GREY.astype(np.uint8)
    if rgb is not None:
        if rgb.shape[:2] != z.shape:
            raise InputError(
                f"odometry: picture of {rgb.shape[:2]} for a depth image of {z.shape}; register it first"
            )
        grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if camera.is_distorted:
        z, sigma, grey, camera = _straightened(z, sigma, grey, camera)
    factor = max(1, round(camera.width / config.finest_px))
    light = grey.astype(np.float32) if factor == 1 else grey
    if factor > 1:
        z, sigma, light = kernels.shrink(z, sigma, light, factor)
        camera = shrunk(camera, factor)
    return _levels(z, sigma, light, camera, floor, config)


def _levels(
    z: np.ndarray,
    sigma: np.ndarray,
    light: np.ndarray,
    camera: Camera,
    floor: Plane | None,
    config: PyramidConfig,
) -> Pyramid:
    """The image at its finest size and all smaller ones."""
    levels = []
    for number in range(config.levels):
        if number > 0:
            z, sigma, light = kernels.shrink(z, sigma, light, 2)
            camera = shrunk(camera, 2)
        levels.append(Level(z, sigma, light, camera, _off_floor(z, sigma, camera, floor, config)))
        if min(camera.width, camera.height) < 32:
            break
    return Pyramid(tuple(levels), floor)


def shrunk(camera: Camera, factor: int) -> Camera:
    """The camera of an image each pixel of which is the mean of factor x factor."""
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
    z: np.ndarray, sigma: np.ndarray, camera: Camera, floor: Plane | None, config: PyramidConfig
) -> UInt8[np.ndarray, "h w"]:
    if floor is None:
        return np.ones(z.shape, np.uint8)
    x, y = camera.single_slopes
    nx, ny, nz = floor.normal.astype(np.float32)
    drop = nx * x + ny * y + nz  # height lost per metre along the axis
    away = np.abs(drop * z + np.float32(floor.offset_m))
    near = np.float32(config.off_floor_sigmas) * sigma * np.abs(drop)
    return np.asarray(away > np.maximum(near, np.float32(config.off_floor_m))).astype(np.uint8)


def _straightened(
    z: np.ndarray, sigma: np.ndarray, grey: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Camera]:
    """The images as the same camera without lens errors sees them; nearest pixel, so edges stay."""
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

    def turned(image: np.ndarray, border: float) -> np.ndarray:
        return np.asarray(
            cv2.remap(
                image, *maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=border
            )
        )

    if grey.shape == z.shape:
        grey = turned(grey, 0.0)
    return turned(z, nothing), turned(sigma, nothing), grey, straight
