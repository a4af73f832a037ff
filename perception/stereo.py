"""Stereo: disparity with a reliability per pixel, and depth with its deviation.

OpenCV's semi-global matcher finds the disparity; how far it can be trusted is measured on the images
themselves: a match is reliable where the texture is sharp across, where its cost is clearly below that of
the runner-up, and where matching right to left agrees.

Source: seed 003, sections 2.2 and 3 (disparity to range; reliability).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from .primitives.errors import ConfigError, InputError
from .primitives.frame import Depth, StereoView


@dataclass(frozen=True)
class StereoConfig:
    """Search range, window and what counts as reliable."""

    nearest_m: float = 0.20  # seed 003: distance range 0.2 to 4 m; sets the largest disparity
    farthest_m: float = 4.0  # seed 003
    block_px: int = 7  # ours
    uniqueness_pct: int = 8  # ours: the runner-up must cost this much more
    speckle_px: int = 100  # ours: smaller islands are dropped
    sigma_px: float = 0.25  # seed 003: sub-pixel deviation on good texture
    texture: float = 12.0  # ours: s_0, grey levels of horizontal gradient that count as sharp
    least_reliability: float = 0.3  # seed 003

    def __post_init__(self) -> None:
        if not 0.0 < self.nearest_m < self.farthest_m:
            raise ConfigError(
                f"stereo: nearest_m={self.nearest_m} must be positive and below "
                f"farthest_m={self.farthest_m}"
            )
        if self.block_px < 3 or self.block_px % 2 == 0:
            raise ConfigError(f"stereo: block_px={self.block_px} must be odd and at least 3")


@dataclass(frozen=True)
class Disparity:
    """How far each left pixel is displaced in the right image.

    Args:
        disparity_px: (h, w), NaN where there is no match.
        reliability: (h, w), in [0, 1]; 0 where there is no match.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]


def disparity(view: StereoView, config: StereoConfig | None = None) -> Disparity:
    """Match a rectified pair.

    Args:
        view: The pair.
        config: Search range and bounds.

    Raises:
        InputError: The images differ in size.

    Source: seed 003, section 2.2.
    """
    config = config or StereoConfig()
    if view.left.shape != view.right.shape:
        raise InputError(
            f"stereo: left image {view.left.shape} and right image {view.right.shape} differ in size; "
            "give a rectified pair"
        )
    focal = view.camera.fx * view.baseline_m
    most = 16 * int(np.ceil(focal / config.nearest_m / 16))
    most = int(np.clip(most, 16, 16 * (view.left.shape[1] // 32)))
    pad = most  # the left margin has no partner: padded, so that the search range does not eat it
    left = cv2.copyMakeBorder(view.left, 0, 0, pad, 0, cv2.BORDER_REPLICATE)
    right = cv2.copyMakeBorder(view.right, 0, 0, pad, 0, cv2.BORDER_REPLICATE)
    matcher = cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=most,
        blockSize=config.block_px,
        P1=8 * config.block_px**2,
        P2=32 * config.block_px**2,
        disp12MaxDiff=1,
        uniquenessRatio=config.uniqueness_pct,
        speckleWindowSize=config.speckle_px,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    found = matcher.compute(left, right)[:, pad:].astype(np.float32) / 16.0
    found[found < focal / config.farthest_m / 2] = np.nan
    columns = np.arange(found.shape[1], dtype=np.float32)
    with np.errstate(invalid="ignore"):
        found[found > columns] = np.nan  # its partner would lie outside the right image
    sharp = cv2.blur(np.abs(cv2.Sobel(view.left, cv2.CV_32F, 1, 0, scale=0.25)), (config.block_px,) * 2)
    reliability = np.clip(sharp / config.texture, 0.0, 1.0) * _agreement(view, found, config)
    reliability[~np.isfinite(found)] = 0.0
    return Disparity(found, reliability.astype(np.float32))


def depth(view: StereoView, config: StereoConfig | None = None) -> Depth:
    """Depth of the left camera with its deviation, sigma_Z = Z^2 sigma_d / (f B).

    Returns:
        NaN where no reliable match was found.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    matched = disparity(view, config)
    focal = view.camera.fx * view.baseline_m
    with np.errstate(invalid="ignore", divide="ignore"):
        z = focal / matched.disparity_px
        bad = (matched.reliability < config.least_reliability) | ~(z <= config.farthest_m)
        z[bad] = np.nan
        doubt = config.sigma_px / np.sqrt(np.maximum(matched.reliability, 0.1))
        sigma = z**2 * doubt / focal
    return Depth(z, sigma.astype(np.float32), view.camera, view.T_body_camera)


def _agreement(view: StereoView, found: np.ndarray, config: StereoConfig) -> np.ndarray:
    """1 where both images look alike at the match, falling to 0 as they differ more than noise does."""
    rows, columns = np.indices(found.shape, dtype=np.float32)
    partner = columns - np.nan_to_num(found, nan=0.0)
    moved = cv2.remap(view.right, partner, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = cv2.blur(cv2.absdiff(view.left, moved).astype(np.float32), (config.block_px,) * 2)
    return np.clip(2.0 - difference / config.texture, 0.0, 1.0)
