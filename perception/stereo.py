"""Stereo: disparity with a reliability for every pixel, and depth with its sigma.

OpenCV's matchers find the disparity. They do not show their costs, so the reliability is measured again
round the disparity they found: the right image is brought into the left one at d - 1, d and d + 1, and the
differences of horizontal gradients, summed over a block, are a cost with a valley. A sharp valley is
texture, a flat one is not; a valley whose bottom stays high belongs to a pixel that the other camera does
not see. A second valley as deep as the first is the matcher's own uniqueness test.

Source: seed 003, section 3 (reliability; sigma_Z = Z^2 sigma_d / (f B)); Hirschmueller 2008 (SGBM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from .primitives.errors import ConfigError, InputError
from .primitives.frame import Depth, StereoView

METHODS = ("sgbm", "bm")
GREY_NOISE = np.float32(0.5)  # gradient cost that image noise alone leaves
GRADIENT_LIMIT = (
    31  # x-Sobel is cut off here, as OpenCV's block matcher does: lighting does not matter
)


@dataclass(frozen=True)
class StereoConfig:
    """The matcher, and what is believed of it."""

    method: str = "sgbm"  # "sgbm" (three directions) or "bm" (blocks alone: faster, with holes)
    block_px: int = 7  # ours: side of the block for SGBM; BM takes `bm_block_px`
    bm_block_px: int = 15  # ours
    nearest_m: float = 0.20  # seed 003: distance reliable from 0.2 m on
    most_disparity_px: int = 128  # seed 003: search 4..128 px
    least_disparity_px: float = 2.0  # ours: beyond, a quarter of a pixel is an eighth of the depth
    uniqueness_pct: int = 10  # OpenCV: the best cost must win by so much
    left_right_px: int = 1  # ours: both directions agree to a pixel
    speckle_px: int = 100  # ours: smaller islands of disparity are noise
    speckle_range_px: int = 2  # ours
    sharpness: float = (
        0.3  # ours: valley of a block, grey levels per px; noise of 2 levels makes 0.1
    )
    fit: float = 0.5  # ours: valley of a block in parts of the cost left at its bottom
    step_px: float = 1.0  # ours: spread of disparity in a block, from where reliability falls
    least_reliability: float = 0.3  # seed 003
    sigma_px: float = 0.25  # seed 003: sigma_d of a reliable pixel

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"stereo: method={self.method!r} is unknown; choose {' or '.join(METHODS)}"
            )
        for name in ("block_px", "bm_block_px"):
            value = getattr(self, name)
            if value < 5 or value % 2 == 0:
                raise ConfigError(f"stereo: {name}={value} must be odd and at least 5")
        for name in (
            "nearest_m",
            "sharpness",
            "fit",
            "step_px",
            "sigma_px",
            "least_disparity_px",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"stereo: {name}={value} must be positive and finite")
        if self.most_disparity_px < 16:
            raise ConfigError(
                f"stereo: most_disparity_px={self.most_disparity_px} must be at least 16"
            )
        for name in ("uniqueness_pct", "left_right_px", "speckle_px", "speckle_range_px"):
            if getattr(self, name) < 0:
                raise ConfigError(f"stereo: {name}={getattr(self, name)} must not be negative")
        if not 0.0 <= self.least_reliability <= 1.0:
            raise ConfigError(
                f"stereo: least_reliability={self.least_reliability} must lie in [0, 1]"
            )


@dataclass(frozen=True)
class Disparity:
    """What matching found.

    Args:
        disparity_px: Column in the left image minus column in the right one; NaN where none was found.
        reliability: In [0, 1]; 0 where none was found.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]


def disparity(view: StereoView, config: StereoConfig | None = None) -> Disparity:
    """Match a rectified pair.

    Args:
        view: Grey images, rectified: a point is in the same row of both.
        config: Matcher and thresholds.

    Returns:
        Disparity and reliability; nothing is cut off by reliability here.

    Raises:
        InputError: The images differ in size or do not fit the camera, or the baseline is not positive.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    _check(view)
    width = view.left.shape[1]
    reach = min(config.most_disparity_px, view.camera.fx * view.baseline_m / config.nearest_m)
    steps = max(16, 16 * math.ceil(reach / 16.0))
    # Columns at the left border would be skipped by the whole search range: give them a margin.
    left, right = (
        cv2.copyMakeBorder(image, 0, 0, steps, 0, cv2.BORDER_REPLICATE)
        for image in (view.left, view.right)
    )
    raw = _matcher(config, steps).compute(left, right)[:, steps:]
    found = raw.astype(np.float32) / np.float32(16.0)
    columns = np.arange(width, dtype=np.float32)
    valid = (raw > 0) & (found >= config.least_disparity_px) & (found <= columns)
    found = np.where(valid, found, np.float32(np.nan))
    return Disparity(found, _reliability(view, found, config))


def depth(view: StereoView, config: StereoConfig | None = None) -> Depth:
    """Depth with its deviation, where matching can be relied on.

    Args:
        view: Grey images, rectified.
        config: Matcher and thresholds.

    Returns:
        Z = f B / d with sigma_Z = Z^2 sigma_d / (f B); sigma_d grows as reliability falls. NaN where
        nothing was found or reliability is below the least.

    Raises:
        InputError: As `disparity`.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    matched = disparity(view, config)
    fB = np.float32(view.camera.fx * view.baseline_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        believed = matched.reliability >= np.float32(config.least_reliability)
        z = np.where(believed, fB / matched.disparity_px, np.float32(np.nan))
        sigma_px = np.float32(config.sigma_px) / np.sqrt(matched.reliability)
        sigma = np.where(np.isfinite(z), z * z * sigma_px / fB, np.float32(np.nan))
    return Depth(z, sigma, view.camera, view.T_body_camera)


def _matcher(config: StereoConfig, steps: int) -> cv2.StereoMatcher:
    """OpenCV's matcher for so many disparities."""
    if config.method == "bm":
        blocks = cv2.StereoBM.create(steps, config.bm_block_px)
        blocks.setUniquenessRatio(config.uniqueness_pct)
        blocks.setDisp12MaxDiff(config.left_right_px)
        blocks.setSpeckleWindowSize(config.speckle_px)
        blocks.setSpeckleRange(config.speckle_range_px)
        return blocks
    area = config.block_px**2
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=steps,
        blockSize=config.block_px,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=config.left_right_px,
        preFilterCap=GRADIENT_LIMIT,
        uniquenessRatio=config.uniqueness_pct,
        speckleWindowSize=config.speckle_px,
        speckleRange=config.speckle_range_px,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def _reliability(
    view: StereoView, found: Float32[np.ndarray, "h w"], config: StereoConfig
) -> Float32[np.ndarray, "h w"]:
    """Texture times fit times smoothness, each in [0, 1].

    Texture: how much worse the better neighbour of the disparity found is. Fit: the same in parts of the
    cost that is left, which is large where the pixel is hidden in the other image. Smoothness: a block
    that spans a step of depth has no disparity of its own.
    """
    height, width = found.shape
    left, right = (_gradient(image) for image in (view.left, view.right))
    is_found = np.isfinite(found)
    filled = np.where(is_found, found, np.float32(0.0))
    columns = np.arange(width, dtype=np.float32) - filled
    rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    side = (config.block_px, config.block_px)
    lower, here, higher = (
        cv2.blur(
            cv2.absdiff(left, cv2.remap(right, columns - offset, rows, cv2.INTER_LINEAR)), side
        )
        for offset in (np.float32(-1.0), np.float32(0.0), np.float32(1.0))
    )
    valley = np.minimum(lower, higher) - here
    share = np.maximum(cv2.blur(is_found.astype(np.float32), side), np.float32(1e-6))
    mean = cv2.blur(filled, side) / share
    spread = np.sqrt(np.maximum(cv2.blur(filled * filled, side) / share - mean * mean, 0.0))
    texture = np.clip(valley / np.float32(config.sharpness), 0.0, 1.0)
    fit = np.clip(valley / (here + GREY_NOISE) / np.float32(config.fit), 0.0, 1.0)
    smooth = np.clip(np.float32(2.0) - spread / np.float32(config.step_px), 0.0, 1.0)
    return np.where(is_found, texture * fit * smooth, np.float32(0.0)).astype(np.float32)


def _gradient(image: np.ndarray) -> Float32[np.ndarray, "h w"]:
    """Horizontal gradient, grey levels per pixel, cut off."""
    sobel = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3) / np.float32(8.0)
    return np.clip(sobel, -GRADIENT_LIMIT, GRADIENT_LIMIT).astype(np.float32)


def _check(view: StereoView) -> None:
    expected = (view.camera.height, view.camera.width)
    if view.left.shape != view.right.shape or view.left.shape != expected:
        raise InputError(
            f"stereo: left image is {view.left.shape}, right {view.right.shape}, the camera says "
            f"{expected} (rows, columns); the pair must be rectified to one size"
        )
    if not (math.isfinite(view.baseline_m) and view.baseline_m > 0.0):
        raise InputError(
            f"stereo: baseline_m={view.baseline_m} must be positive and finite; check the calibration"
        )
