"""MDGHM-SIFT: SIFT with orientations from Gaussian-Hermite moments instead of pixel differences.

Keypoints are extrema of the difference of Gaussians. The orientation of each is a peak of a histogram of
gradients around it; here the gradient is that of `gaussian_hermite`, on the blurred image of the keypoint's
scale. The descriptor is SIFT's, optionally with moments too. OpenCV's SIFT has the same signature.

Pixel coordinates are (u, v), pixel centres at integers; directions are rad from u (right) towards v (down), as
OpenCV's `KeyPoint.angle`.

Source: Kang et al. 2013 (seed 004), section 2.2.1 (moments in the direction); Lowe 2004 (all the rest).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from ..primitives.errors import ConfigError, InputError
from ..primitives.settings import setting
from . import _descriptor_kernels as descriptor_kernels
from . import _orientation_kernels as orientation_kernels
from . import _scale_space_kernels as scale_space_kernels
from .gaussian_hermite import ODD_ORDERS, mask, mask_side

METHODS = ("mdghm", "difference", "opencv")
EXTREMUM_BORDER_PX = 5  # as OpenCV's; closer to the border an extremum is an artefact
TINY_PX = 16  # a smaller image or octave has no features
LAYERS = 3  # Lowe 2004
BLUR_PX = 1.6  # Lowe 2004: sigma of the first level
CAMERA_BLUR_PX = 0.5  # Lowe 2004: blur of the input image
CONTRAST = 0.04  # Lowe 2004 as OpenCV counts it: 0.04 / layers of full scale
EDGE_RATIO = 10.0  # Lowe 2004
WINDOW_SIGMAS = 1.5  # Lowe 2004: weight of the orientation histogram
PEAK_SHARE = 0.8  # Lowe 2004


@dataclass(frozen=True)
class SiftConfig:
    """Number and kind of features."""

    sigma_px: float = 1.6  # seed 004; least width of orthonormal masks; width of the moments
    orders: tuple[int, ...] = setting(
        ODD_ORDERS, "", "odd orders of the moments in the gradient", "seed 004, eq. (8)"
    )
    method: str = "mdghm"  # orientation by moments; "difference": of pixels; "opencv": cv2.SIFT
    moments_in_descriptor: bool = False  # seed 004 uses moments for the orientation only
    first_order: bool = True  # direction by order 1 alone, which has no bias; magnitude by eq. (8)
    literal: bool = False  # seed 004, eq. (4) and (9) as printed, without quadrant; for comparison
    upsample: bool = True  # Lowe 2004: four times the keypoints; false is over twice as fast
    most: int = 0  # number of the strongest features kept; 0 keeps all

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(f"sift: method={self.method!r} is unknown; use {', '.join(METHODS)}")
        if not (self.orders and all(p > 0 and p % 2 == 1 for p in self.orders)):
            raise ConfigError(f"sift: orders={self.orders} must be odd and at least one")
        if not 0.5 <= self.sigma_px <= 4.0:
            raise ConfigError(f"sift: sigma_px={self.sigma_px} must lie in 0.5 to 4; use 1.6")
        if self.most < 0:
            raise ConfigError(f"sift: most={self.most} must not be negative")


@dataclass(frozen=True)
class Features:
    """Features of one image.

    Args:
        pixels: (u, v), px.
        sigma_px: Scale: blur at the extremum, px of the image.
        angle_rad: Direction, from u towards v, in [-pi, pi).
        response: Absolute difference of Gaussians, of full scale 1.
        descriptors: Each of unit length.
    """

    pixels: Float32[np.ndarray, "n 2"]
    sigma_px: Float32[np.ndarray, "n"]
    angle_rad: Float32[np.ndarray, "n"]
    response: Float32[np.ndarray, "n"]
    descriptors: Float32[np.ndarray, "n 128"]

    def __len__(self) -> int:
        return len(self.pixels)

    def only(self, kept: np.ndarray) -> Features:
        """Selected features, by mask or by index, in that order."""
        return Features(
            self.pixels[kept],
            self.sigma_px[kept],
            self.angle_rad[kept],
            self.response[kept],
            self.descriptors[kept],
        )


def detect(
    image: UInt8[np.ndarray, "h w"],
    config: SiftConfig | None = None,
    valid: np.ndarray | None = None,
) -> Features:
    """Features of a grey image.

    Args:
        image: Grey, full scale 255.
        config: Kind and number.
        valid: (h, w), where features may lie; None: everywhere.

    Returns:
        Features in order of octave, layer, row and column; none in an image without contrast.
    """
    config = config or SiftConfig()
    if valid is not None and valid.shape != image.shape:
        raise InputError(f"features: mask of {valid.shape} for an image of {image.shape}")
    if min(image.shape) < TINY_PX:
        return _no_features()
    found = _by_opencv(image, config) if config.method == "opencv" else _by_moments(image, config)
    if valid is not None and len(found):
        u, v = np.rint(found.pixels).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
        inside[inside] = valid[v[inside], u[inside]]
        found = found.only(inside)
    if config.most and len(found) > config.most:
        strongest = np.argsort(-found.response, kind="stable")[: config.most]
        found = found.only(np.sort(strongest))
    return found


def _by_moments(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Features:
    """Octave by octave: blur, extrema, orientations, descriptors."""
    zoom = 2 if config.upsample else 1
    base = _first_level(image, config)
    masks = _masks(config)
    octaves = max(1, round(math.log2(min(base.shape)) - 2))
    parts = []
    for octave in range(octaves):
        if min(base.shape) < TINY_PX:
            break
        levels = _levels(base)
        part = _of_octave(levels, config, masks)
        if part is not None:
            parts.append(_in_image(part, octave, zoom))
        # every second pixel of the level with twice the blur
        base = np.ascontiguousarray(levels[LAYERS, ::2, ::2])
    if not parts:
        return _no_features()
    return Features(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in Features.__dataclass_fields__)
    )


def _first_level(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Float32[np.ndarray, "a b"]:
    """The image, upsampled if configured, blurred to the first level; full scale 1."""
    grey = image.astype(np.float32)
    grey *= np.float32(1.0 / 255.0)
    blur = CAMERA_BLUR_PX
    if config.upsample:
        grey = _upsampled(grey)
        blur *= 2.0
    return _blurred(grey, math.sqrt(BLUR_PX**2 - blur**2))


def _upsampled(grey: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "a b"]:
    """Twice as many pixels along each axis; pixel (2 u, 2 v) is exactly the old (u, v)."""
    height, width = grey.shape
    out = np.empty((2 * height, 2 * width), np.float32)
    wide = np.empty((height, 2 * width), np.float32)
    wide[:, ::2] = grey
    np.add(grey[:, :-1], grey[:, 1:], out=wide[:, 1:-1:2])
    wide[:, 1:-1:2] *= np.float32(0.5)
    wide[:, -1] = grey[:, -1]
    out[::2] = wide
    np.add(wide[:-1], wide[1:], out=out[1:-1:2])
    out[1:-1:2] *= np.float32(0.5)
    out[-1] = wide[-1]
    return out


def _blurred(
    grey: Float32[np.ndarray, "h w"],
    sigma_px: float,
    out: Float32[np.ndarray, "h w"] | None = None,
) -> Float32[np.ndarray, "h w"]:
    side = 2 * math.ceil(3.3 * sigma_px) + 1  # 0.1 % of the weight lies beyond
    border = cv2.BORDER_REFLECT
    return np.asarray(cv2.GaussianBlur(grey, (side, side), sigma_px, out, borderType=border))


def _levels(base: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "n h w"]:
    """One octave: LAYERS + 3 images, each with 2^(1/LAYERS) times the blur of the previous one."""
    levels = np.empty((LAYERS + 3, *base.shape), np.float32)
    levels[0] = base
    growth = 2.0 ** (1.0 / LAYERS)
    for i in range(1, len(levels)):
        before = BLUR_PX * growth ** (i - 1)
        _blurred(levels[i - 1], before * math.sqrt(growth**2 - 1.0), levels[i])
    return levels


def _of_octave(
    levels: Float32[np.ndarray, "n h w"], config: SiftConfig, masks: Float32[np.ndarray, "k half"]
) -> Features | None:
    """Features of one octave in its own pixels; None without any."""
    capacity = levels.shape[1] * levels.shape[2] // 16 + 16
    raw = np.empty((capacity, 5), np.float32)
    least = CONTRAST / LAYERS
    count = scale_space_kernels.extrema(
        levels, 0.5 * least, least, EDGE_RATIO, EXTREMUM_BORDER_PX, LAYERS, raw
    )
    raw = raw[:count]
    sigma = BLUR_PX * np.exp2(raw[:, 2] / np.float32(LAYERS))
    points = np.column_stack([raw[:, 0], raw[:, 1], sigma, raw[:, 4]]).astype(np.float32)
    owners = np.empty(4 * count + 1, np.int64)
    angle, clearness = np.empty((2, 4 * count + 1), np.float32)
    peaks = orientation_kernels.directions(
        levels,
        points,
        masks,
        config.first_order and not config.literal,
        config.literal,
        WINDOW_SIGMAS,
        PEAK_SHARE,
        owners,
        angle,
        clearness,
    )
    if peaks == 0:
        return None
    owners, angle = owners[:peaks], angle[:peaks]
    points = np.ascontiguousarray(points[owners])
    out = np.empty((peaks, 128), np.float32)
    if config.moments_in_descriptor:
        gradients = [
            _gradient_field(level, masks, config.first_order) for level in levels[: LAYERS + 1]
        ]
        x, y = (np.stack([g[axis] for g in gradients]) for axis in (0, 1))
        descriptor_kernels.describe_by_moments(x, y, points, angle, out)
    else:
        descriptor_kernels.describe(levels, points, angle, out)
    return Features(points[:, :2], points[:, 2], angle, raw[owners, 3], out)


def _gradient_field(
    level: Float32[np.ndarray, "h w"], masks: Float32[np.ndarray, "k half"], first_order: bool
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Signed roots of the sums of squared moments along x and y, of a whole level."""
    (height, width), half = level.shape, masks.shape[1] - 1
    patch, wide = np.pad(level, half, mode="edge").ravel(), width + 2 * half
    gx, gy = np.empty((2, height * wide), np.float32)
    work = np.empty((4, patch.size), np.float32)
    orientation_kernels.moment_gradients(patch, height, wide, masks, work, gx, gy, first_order)
    return gx.reshape(height, wide)[:, :width].copy(), gy.reshape(height, wide)[:, :width].copy()


def _in_image(part: Features, octave: int, zoom: int) -> Features:
    """From the octave's pixels to the image's: the first pixel of every octave is that of the image."""
    scale = np.float32(2.0**octave / zoom)
    return Features(
        part.pixels * scale,
        part.sigma_px * scale,
        part.angle_rad,
        part.response,
        part.descriptors,
    )


def _masks(config: SiftConfig) -> Float32[np.ndarray, "k half"]:
    """Order 0 and the odd orders from their middle outwards; a single row for pixel differences."""
    if config.method == "difference":
        return np.ones((1, 2), np.float32)
    return _moment_masks(config.sigma_px, config.orders)


@lru_cache(maxsize=8)
def _moment_masks(sigma_px: float, orders: tuple[int, ...]) -> Float32[np.ndarray, "k half"]:
    side = mask_side(sigma_px, max(5, *orders))
    rows = [mask(order, sigma_px, side)[side // 2 :] for order in (0, *orders)]
    return np.ascontiguousarray(rows, dtype=np.float32)


def _by_opencv(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Features:
    """OpenCV's SIFT with the same parameters; it always upsamples."""
    sift = cv2.SIFT.create(
        nOctaveLayers=LAYERS,
        contrastThreshold=CONTRAST,
        edgeThreshold=EDGE_RATIO,
        sigma=BLUR_PX,
    )
    keypoints, descriptors = sift.detectAndCompute(image, None)
    if not keypoints:
        return _no_features()
    table = np.array([(k.pt[0], k.pt[1], k.size, k.angle, k.response) for k in keypoints])
    angle = (np.radians(table[:, 3]) + math.pi) % (2.0 * math.pi) - math.pi
    length = np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-9)
    return Features(
        table[:, :2].astype(np.float32),
        (table[:, 2] / 2.0).astype(np.float32),  # OpenCV's size is a diameter
        angle.astype(np.float32),
        table[:, 4].astype(np.float32),
        (descriptors / length).astype(np.float32),
    )


def _no_features() -> Features:
    none = np.zeros(0, np.float32)
    return Features(np.zeros((0, 2), np.float32), none, none, none, np.zeros((0, 128), np.float32))
