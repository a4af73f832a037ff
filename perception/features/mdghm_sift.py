"""MDGHM-SIFT: SIFT whose directions come from Gaussian-Hermite moments instead of differences of pixels.

Keypoints are the extrema of the difference of Gaussians. Each gets its direction from a histogram of
gradients about it, and here the gradient is that of `gaussian_hermite`, on the blurred image of the
keypoint's own scale. The descriptor is SIFT's; by an option it uses the moments too. OpenCV's SIFT stands
behind the same signature, so that whoever asks for features need not know which they are.

Places are (u, v) px, pixel centres at integers; directions are rad from u (right) towards v (down), which
is also what OpenCV's `KeyPoint.angle` means.

Source: seed 004, section 2.2.1 (moments in the direction); Lowe 2004 (all the rest).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from ..primitives.errors import ConfigError, InputError
from . import _descriptor_kernels as descriptor_kernels
from . import _orientation_kernels as orientation_kernels
from . import _scale_space_kernels as scale_space_kernels
from .gaussian_hermite import ODD_ORDERS, mask, mask_side

METHODS = ("mdghm", "difference", "opencv")
EXTREMUM_BORDER_PX = 5  # as OpenCV's; nearer to the border an extremum is the border's own
TINY_PX = 16  # an image, or an octave of it, that is smaller has no features


@dataclass(frozen=True)
class SiftConfig:
    """How many features, of which kind."""

    method: str = "mdghm"  # direction by moments; "difference": of pixels; "opencv": cv2.SIFT
    moments_in_descriptor: bool = False  # seed 004 names the direction only
    sigma_px: float = (
        1.6  # of the moments; least for which the masks are orthonormal (spec: 004, 3)
    )
    orders: tuple[int, ...] = ODD_ORDERS  # seed 004, eq. (8); (1,) has no bias
    straight: bool = (
        True  # spec of 004, eq. (9): direction by order 1 alone, magnitude (8); no bias
    )
    literal: bool = False  # eq. (4) and (9) as printed, which know no quadrant; for comparison
    upsample: bool = True  # Lowe 2004: four times the keypoints; False is over twice as fast
    layers: int = 3  # Lowe 2004
    blur_px: float = 1.6  # Lowe 2004: sigma of the first level
    camera_blur_px: float = 0.5  # Lowe 2004: blur the image comes with
    contrast: float = 0.04  # Lowe 2004 as OpenCV counts it: 0.04 / layers of full scale
    edge_ratio: float = 10.0  # Lowe 2004
    window_sigmas: float = 1.5  # Lowe 2004: weight of the histogram of directions
    peak_share: float = 0.8  # Lowe 2004
    most: int = 0  # keep so many of the strongest; 0 keeps all

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(f"sift: method={self.method!r} is unknown; use {', '.join(METHODS)}")
        if not (self.orders and all(p > 0 and p % 2 == 1 for p in self.orders)):
            raise ConfigError(f"sift: orders={self.orders} must be odd and at least one")
        if not 0.5 <= self.sigma_px <= 4.0:
            raise ConfigError(f"sift: sigma_px={self.sigma_px} must lie in 0.5 to 4; use 1.6")
        if self.layers < 1 or self.most < 0:
            raise ConfigError(f"sift: layers={self.layers}, most={self.most} must be >= 1 and >= 0")
        if not self.blur_px > 2.0 * self.camera_blur_px > 0.0:
            raise ConfigError(
                f"sift: blur_px={self.blur_px} must exceed twice camera_blur_px={self.camera_blur_px}"
            )
        for name in ("contrast", "edge_ratio", "window_sigmas", "peak_share"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"sift: {name}={getattr(self, name)} must be positive")


@dataclass(frozen=True)
class Features:
    """What was found in one image.

    Args:
        pixels: (u, v), px.
        sigma_px: Scale: blur at which the place stood out, px of the image.
        angle_rad: Direction, from u towards v, in [-pi, pi).
        response: How strongly it stands out, of full scale 1.
        descriptors: Each of length 1.
    """

    pixels: Float32[np.ndarray, "n 2"]
    sigma_px: Float32[np.ndarray, "n"]
    angle_rad: Float32[np.ndarray, "n"]
    response: Float32[np.ndarray, "n"]
    descriptors: Float32[np.ndarray, "n 128"]

    def __len__(self) -> int:
        return len(self.pixels)

    def only(self, kept: np.ndarray) -> Features:
        """A part of them, by mask or by index, in that order."""
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
    """Features of a grey picture.

    Args:
        image: Grey, full scale 255.
        config: Which kind, how many.
        valid: (h, w), where features may lie; None: everywhere.

    Returns:
        Features in order of octave, layer, row and column; none at all in a picture without contrast.
    """
    config = config or SiftConfig()
    if valid is not None and valid.shape != image.shape:
        raise InputError(f"features: mask of {valid.shape} for an image of {image.shape}")
    if min(image.shape) < TINY_PX:
        return _no_features()
    found = _by_opencv(image, config) if config.method == "opencv" else _by_us(image, config)
    if valid is not None and len(found):
        u, v = np.rint(found.pixels).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
        inside[inside] = valid[v[inside], u[inside]]
        found = found.only(inside)
    if config.most and len(found) > config.most:
        strongest = np.argsort(-found.response, kind="stable")[: config.most]
        found = found.only(np.sort(strongest))
    return found


def _by_us(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Features:
    """Octave by octave: blur, extrema, directions, descriptors."""
    zoom = 2 if config.upsample else 1
    base = _first_level(image, config)
    masks = _masks(config)
    octaves = max(1, round(math.log2(min(base.shape)) - 2))
    parts = []
    for octave in range(octaves):
        if min(base.shape) < TINY_PX:
            break
        levels = _levels(base, config)
        part = _of_octave(levels, config, masks)
        if part is not None:
            parts.append(_in_image(part, octave, zoom))
        # every second pixel of the level with twice the blur
        base = np.ascontiguousarray(levels[config.layers, ::2, ::2])
    if not parts:
        return _no_features()
    return Features(
        *(np.concatenate([getattr(p, n) for p in parts]) for n in Features.__dataclass_fields__)
    )


def _first_level(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Float32[np.ndarray, "a b"]:
    """The picture, twice as large if asked for, blurred to the first level; full scale 1."""
    grey = image.astype(np.float32)
    grey *= np.float32(1.0 / 255.0)
    had = config.camera_blur_px
    if config.upsample:
        grey = _twice(grey)
        had *= 2.0
    return _blurred(grey, math.sqrt(config.blur_px**2 - had**2))


def _twice(grey: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "a b"]:
    """Twice as many pixels each way, pixel (2 u, 2 v) exactly the old (u, v)."""
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


def _blurred(grey: Float32[np.ndarray, "h w"], sigma_px: float) -> Float32[np.ndarray, "h w"]:
    side = 2 * math.ceil(3.3 * sigma_px) + 1  # beyond it lies a thousandth
    return np.asarray(cv2.GaussianBlur(grey, (side, side), sigma_px, borderType=cv2.BORDER_REFLECT))


def _levels(base: Float32[np.ndarray, "h w"], config: SiftConfig) -> Float32[np.ndarray, "n h w"]:
    """One octave: layers + 3 images, each blurred 2^(1/layers) times as much as the one before."""
    levels = np.empty((config.layers + 3, *base.shape), np.float32)
    levels[0] = base
    growth = 2.0 ** (1.0 / config.layers)
    for i in range(1, len(levels)):
        before = config.blur_px * growth ** (i - 1)
        levels[i] = _blurred(levels[i - 1], before * math.sqrt(growth**2 - 1.0))
    return levels


def _of_octave(
    levels: Float32[np.ndarray, "n h w"], config: SiftConfig, masks: Float32[np.ndarray, "k half"]
) -> Features | None:
    """Features of one octave in its own pixels; None if there is none."""
    capacity = levels.shape[1] * levels.shape[2] // 16 + 16
    raw = np.empty((capacity, 5), np.float32)
    distinct = config.contrast / config.layers
    count = scale_space_kernels.extrema(
        levels, 0.5 * distinct, distinct, config.edge_ratio, EXTREMUM_BORDER_PX, config.layers, raw
    )
    raw = raw[:count]
    sigma = config.blur_px * np.exp2(raw[:, 2] / np.float32(config.layers))
    points = np.column_stack([raw[:, 0], raw[:, 1], sigma, raw[:, 4]]).astype(np.float32)
    owners = np.empty(4 * count + 1, np.int64)
    angle, clearness = np.empty((2, 4 * count + 1), np.float32)
    peaks = orientation_kernels.directions(
        levels,
        points,
        masks,
        config.straight and not config.literal,
        config.literal,
        config.window_sigmas,
        config.peak_share,
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
        gradients = [_field(level, masks, config.straight) for level in levels[: config.layers + 1]]
        x, y = (np.stack([g[axis] for g in gradients]) for axis in (0, 1))
        descriptor_kernels.describe_by_moments(x, y, points, angle, out)
    else:
        descriptor_kernels.describe(levels, points, angle, out)
    return Features(points[:, :2], points[:, 2], angle, raw[owners, 3], out)


def _field(
    level: Float32[np.ndarray, "h w"], masks: Float32[np.ndarray, "k half"], straight: bool
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Signed roots of the sums of squared moments along x and y, of a whole level."""
    height, width = level.shape
    half = masks.shape[1] - 1
    patch = np.pad(level, half, mode="edge")
    gx, gy, square = np.empty((3, height, width), np.float32)
    sums, total = np.empty((2, width), np.float32)
    orientation_kernels.moment_gradients(
        patch, height, width, masks, np.empty_like(patch), sums, total, gx, gy, square, straight
    )
    return gx, gy


def _in_image(part: Features, octave: int, zoom: int) -> Features:
    """From the octave's pixels to the image's: every octave keeps its first pixel where it is."""
    scale = np.float32(2.0**octave / zoom)
    return Features(
        part.pixels * scale,
        part.sigma_px * scale,
        part.angle_rad,
        part.response,
        part.descriptors,
    )


def _masks(config: SiftConfig) -> Float32[np.ndarray, "k half"]:
    """Order 0 and the odd orders from their middle outwards; one row only for plain differences."""
    if config.method == "difference":
        return np.ones((1, 2), np.float32)
    return _moment_masks(config.sigma_px, config.orders)


@lru_cache(maxsize=8)
def _moment_masks(sigma_px: float, orders: tuple[int, ...]) -> Float32[np.ndarray, "k half"]:
    side = mask_side(sigma_px, max(5, *orders))
    rows = [mask(order, sigma_px, side)[side // 2 :] for order in (0, *orders)]
    return np.ascontiguousarray(rows, dtype=np.float32)


def _by_opencv(image: UInt8[np.ndarray, "h w"], config: SiftConfig) -> Features:
    """OpenCV's own SIFT with the same settings; it always upsamples."""
    sift = cv2.SIFT.create(
        nOctaveLayers=config.layers,
        contrastThreshold=config.contrast,
        edgeThreshold=config.edge_ratio,
        sigma=config.blur_px,
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
