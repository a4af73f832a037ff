"""Stereo: disparity with a reliability for every pixel, and depth with its sigma.

Our own block matcher, or one of OpenCV's, finds the disparity; all of them are judged alike, by our own
block costs and by the neighbourhood. A disparity is believed if the valley of its cost is sharp (texture),
if no other valley is nearly as deep (ambiguity), if the matched pixel of the right image has no better
partner (hidden surfaces), and if the pixels about it have the same disparity: where costs are chance,
disparities scatter. The last is by far the strongest sign.

The deviation of a disparity is the cost that is left at the bottom in parts of the slope of the valley.

Source: seed 003, section 3 (reliability; sigma_Z = Z^2 sigma_d / (f B)); support by neighbours after the
confidence study of Park and Yoon, CVPR 2015; Hirschmueller 2008 (SGBM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth, StereoView
from . import _stereo_trust_kernels as kernels
from .block_matching import GRADIENT_LIMIT, SIDES, match

METHODS = ("block", "sgbm", "bm")
VOTES = 96  # of all neighbours together


@dataclass(frozen=True)
class StereoConfig:
    """The matcher, and what is believed of it."""

    method: str = "block"  # ours; "sgbm" (three directions, four times slower) or "bm": OpenCV's
    block_px: int = 9  # ours: side of the block that is matched, and judges; 9, 15 or 21
    sgbm_block_px: int = 5  # OpenCV's advice: 3 to 11
    bm_block_px: int = 15  # OpenCV's advice for 640 x 480
    nearest_m: float = 0.20  # seed 003: distance reliable from 0.2 m on
    most_disparity_px: int = 128  # seed 003: search 4..128 px
    least_disparity_px: float = 2.0  # ours: beyond, a quarter of a pixel is an eighth of the depth
    same_px: float = 1.0  # ours: neighbours this close have the same disparity
    few_support: float = (
        0.30  # ours: share of the neighbours' votes below which nothing is believed
    )
    full_support: float = 1.0  # ours: and from which all is
    sharpness: float = (
        0.5  # ours: s_0, grey levels of gradient; noise of 2 grey levels alone makes about 1
    )
    uniqueness: float = 0.15  # seed 003: u_0, distance of the second best cost in parts of the best
    rival_share: float = (
        0.30  # ours: reliability that is left beside an equal rival: support decides
    )
    grey_noise: float = 1.0  # ours: cost per pixel that keeps a ratio of small costs quiet
    least_reliability: float = 0.3  # seed 003
    sigma_px: float = 0.12  # ours: sigma_d of a block of 9 at best; seed 003 takes 0.25 for all
    sigma_per_blur: float = 0.035  # ours: and what is left of the cost in parts of the slope adds
    most_sigma_px: float = 1.0  # ours
    sgbm_sigmas: float = 1.3  # ours: SGBM's path costs make its sub-pixel part coarser

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(
                f"stereo: method={self.method!r} is unknown; choose {', '.join(METHODS)}"
            )
        if self.block_px not in SIDES:
            raise ConfigError(f"stereo: block_px={self.block_px} must be one of {SIDES}")
        for name in ("sgbm_block_px", "bm_block_px"):
            value = getattr(self, name)
            if value < 5 or value % 2 == 0:
                raise ConfigError(f"stereo: {name}={value} must be odd and at least 5")
        for name in (
            "nearest_m",
            "least_disparity_px",
            "same_px",
            "sharpness",
            "uniqueness",
            "grey_noise",
            "sigma_px",
            "sigma_per_blur",
            "most_sigma_px",
            "sgbm_sigmas",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"stereo: {name}={value} must be positive and finite")
        if self.most_disparity_px < 16:
            raise ConfigError(
                f"stereo: most_disparity_px={self.most_disparity_px} must be at least 16"
            )
        if not 0.0 <= self.few_support < self.full_support <= 1.0:
            raise ConfigError(
                f"stereo: few_support={self.few_support} must lie below "
                f"full_support={self.full_support}, both in [0, 1]"
            )
        for name in ("rival_share", "least_reliability"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"stereo: {name}={getattr(self, name)} must lie in [0, 1]")


@dataclass(frozen=True)
class Disparity:
    """What matching found.

    Args:
        disparity_px: Column in the left image minus column in the right one; NaN where none was found.
        reliability: In [0, 1]; 0 where none was found.
        sigma_px: Deviation of a disparity that is right at all; NaN where none was found.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]
    sigma_px: Float32[np.ndarray, "h w"]


def disparity(view: StereoView, config: StereoConfig | None = None) -> Disparity:
    """Match a rectified pair.

    Args:
        view: Grey images, rectified: a point is in the same row of both.
        config: Matcher and thresholds.

    Returns:
        Disparity, reliability and deviation; nothing is cut off by reliability here.

    Raises:
        InputError: The images differ in size or do not fit the camera, or the baseline is not positive.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    _check(view)
    reach = min(config.most_disparity_px, view.camera.fx * view.baseline_m / config.nearest_m)
    steps = max(16, 16 * math.ceil(reach / 16.0))
    given = None if config.method == "block" else _opencv(view, config, steps)
    matches = match(view.left, view.right, steps, config.block_px, given)
    found, least = matches.disparity_px, np.float32(config.least_disparity_px)
    votes = kernels.support(found, least, np.float32(config.same_px))
    reliability, sigma = np.empty_like(found), np.empty_like(found)
    # Noise is averaged over the block: its deviation falls with the side.
    spread = SIDES[0] / config.block_px * (config.sgbm_sigmas if config.method == "sgbm" else 1.0)
    shape = (
        VOTES * config.few_support,
        VOTES * config.full_support,
        config.sharpness,
        config.uniqueness,
        config.rival_share,
        config.grey_noise,
        config.sigma_px * spread,
        config.sigma_per_blur * spread,
        config.most_sigma_px,
    )
    kernels.trust(
        found,
        matches.costs,
        votes,
        config.block_px**2,
        least,
        np.array(shape, np.float32),
        reliability,
        sigma,
    )
    return Disparity(found, reliability, sigma)


def depth(view: StereoView, config: StereoConfig | None = None) -> Depth:
    """Depth with its deviation, where matching can be relied on.

    Args:
        view: Grey images, rectified.
        config: Matcher and thresholds.

    Returns:
        Z = f B / d with sigma_Z = Z^2 sigma_d / (f B). NaN where nothing was found or reliability is
        below the least.

    Raises:
        InputError: As `disparity`.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    return depth_of(view, disparity(view, config), config)


def depth_of(view: StereoView, matched: Disparity, config: StereoConfig) -> Depth:
    """Depth of a pair that is matched already, as `depth` gives it."""
    fB = np.float32(view.camera.fx * view.baseline_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        believed = matched.reliability >= np.float32(max(config.least_reliability, 1e-6))
        z = np.where(believed, fB / matched.disparity_px, np.float32(np.nan))
        sigma = z * z * matched.sigma_px / fB
    return Depth(z, sigma, view.camera, view.T_body_camera, view.baseline_m)


def _opencv(view: StereoView, config: StereoConfig, steps: int) -> Float32[np.ndarray, "h w"]:
    """Disparities of OpenCV's matcher, its own filters off; NaN where it gives none."""
    # Columns at the left border would be skipped by the whole search range: give them a margin.
    left, right = (
        cv2.copyMakeBorder(image, 0, 0, steps, 0, cv2.BORDER_REPLICATE)
        for image in (view.left, view.right)
    )
    raw = _matcher(config, steps).compute(left, right)[:, steps:]
    return np.where(raw >= 0, raw.astype(np.float32) / np.float32(16.0), np.float32(np.nan))


def _matcher(config: StereoConfig, steps: int) -> cv2.StereoMatcher:
    """OpenCV's matcher for so many disparities."""
    if config.method == "bm":
        blocks = cv2.StereoBM.create(steps, config.bm_block_px)
        blocks.setUniquenessRatio(0)
        blocks.setTextureThreshold(0)
        return blocks
    area = config.sgbm_block_px**2
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=steps,
        blockSize=config.sgbm_block_px,
        P1=8 * area,
        P2=32 * area,
        preFilterCap=GRADIENT_LIMIT,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


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
