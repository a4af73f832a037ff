"""Stereo: disparity with a reliability for every pixel, and depth with its standard deviation.

Our block matcher or one of OpenCV's finds the disparity; all are rated alike, by our block costs and by the
neighbourhood. A disparity is reliable if the minimum of its cost is sharp (texture), no other minimum is nearly
as low (uniqueness), the matched pixel of the right image has no better match (occlusion), neighbouring
pixels have the same disparity (mismatches scatter), and its surroundings are reliable too (a block beside a lone edge
carries the edge's disparity to a surface without texture, `_reduce_rims`). The neighbours are by far the strongest
criterion.

The standard deviation of a disparity grows with the ratio of the remaining cost to the slope of the minimum.

Seed 003's own reliability (texture and uniqueness alone) and its parabola are settings (`published_stereo`).

Source: seed 003, section 3 (reliability; sigma_Z = Z^2 sigma_d / (f B)); support by neighbours
after Park and Yoon, CVPR 2015; Hirschmueller 2008 (SGBM).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import Depth, StereoView
from ..primitives.settings import setting
from . import _stereo_trust_kernels as kernels
from . import published_stereo
from ._stereo_trust_kernels import SIDE
from .block_matching import GRADIENT_LIMIT, match
from .rectification import check_baseline

METHODS = ("block", "sgbm", "bm")
SUBPIXEL = ("v", "parabola")
RELIABILITY = ("ours", "seed")
SGBM_BLOCK_PX = 5  # OpenCV's advice: 3 to 11
BM_BLOCK_PX = 15  # OpenCV's advice for 640 x 480
SIGMA_PER_BLUR = 0.035  # ours: growth of sigma_d with the ratio of remaining cost to slope
AROUND_PX = 41  # ours: side of the surroundings: voting neighbours reach half as far
AROUND = 0.3  # ours: mean reliability of the surroundings from which they do not reduce a pixel's
HOLES_PX = 15  # ours: holes in a reliable region up to this size do not count as its rim
MOST_VERGENCE_DEG = 2.0  # ours: more is no small error of a calibration
SGBM_SIGMAS = 1.3  # ours: the path costs of SGBM make its sub-pixel part less accurate


@dataclass(frozen=True)
class StereoConfig:
    """Matcher and reliability."""

    method: str = setting(
        "block",
        "",
        "matcher: ours (block), or OpenCV's sgbm (three directions, four times slower) or bm",
        "ours: most accurate",
    )
    subpixel: str = setting(
        "v",
        "",
        "curve through the lowest costs of our matcher: v, or parabola as in seed 003",
        "ours: smaller error",
    )
    reliability: str = setting(
        "ours",
        "",
        "ours, or seed: texture and uniqueness alone, as in seed 003",
        "ours: larger area under the ROC curve",
    )
    nearest_m: float = 0.20  # seed 003: distance is reliable from 0.2 m; limits the search
    most_disparity_px: int = setting(
        256,
        "px",
        "largest disparity searched, for wide pairs whose disparity at 0.2 m is larger",
        "ours: limits the time; seed 003 has 128 for a pair of 4 cm",
    )
    uniqueness: float = setting(
        0.15, "", "u_0, relative distance of the second-best cost of a unique match", "seed 003"
    )
    least_reliability: float = setting(
        0.3, "", "reliability below which a pixel has no depth", "seed 003"
    )
    sigma_px: float = setting(
        0.12, "px", "sigma_d of a perfect match", "ours: measured; seed 003 has 0.25 for all"
    )
    vergence_deg: float = setting(
        0.0,
        "deg",
        "angle that the right camera is turned outwards more than the calibration says; its effect is taken out of depth",
        "none: `surefoot calibrate-noise`",
    )

    def __post_init__(self) -> None:
        for name, known in (
            ("method", METHODS),
            ("subpixel", SUBPIXEL),
            ("reliability", RELIABILITY),
        ):
            if getattr(self, name) not in known:
                raise ConfigError(
                    f"stereo: {name}={getattr(self, name)!r} is unknown; choose {', '.join(known)}"
                )
        for name in ("nearest_m", "uniqueness", "sigma_px"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"stereo: {name}={value} must be positive and finite")
        if not abs(self.vergence_deg) <= MOST_VERGENCE_DEG:
            raise ConfigError(
                f"stereo: vergence_deg={self.vergence_deg} must lie within -{MOST_VERGENCE_DEG} .. {MOST_VERGENCE_DEG}"
            )
        if self.most_disparity_px < 16:
            raise ConfigError(
                f"stereo: most_disparity_px={self.most_disparity_px} must be at least 16"
            )
        if not 0.0 <= self.least_reliability <= 1.0:
            raise ConfigError(
                f"stereo: least_reliability={self.least_reliability} must lie in [0, 1]"
            )


@dataclass(frozen=True)
class Disparity:
    """Result of matching.

    Args:
        disparity_px: Column in the left image minus column in the right one; NaN where there is none.
        reliability: In [0, 1]; 0 where there is no disparity.
        sigma_px: Standard deviation of a correct match; NaN where there is no disparity.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]
    sigma_px: Float32[np.ndarray, "h w"]


def disparity(view: StereoView, config: StereoConfig | None = None) -> Disparity:
    """Match a rectified pair.

    Args:
        view: Rectified grey images: a point is in the same row of both.
        config: Matcher and thresholds.

    Returns:
        Disparity, reliability and standard deviation; unreliable disparities are included.

    Raises:
        InputError: The images differ in size or do not fit the camera, or the baseline is not positive.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    _check(view)
    steps = searched(view, config)
    given = None if config.method == "block" else _opencv(view, config.method, steps)
    spread = SGBM_SIGMAS if config.method == "sgbm" else 1.0
    rating = kernels.Rating(
        np.float32(config.uniqueness),
        np.float32(config.sigma_px * spread),
        np.float32(SIGMA_PER_BLUR * spread),
    )
    parabola, seed = config.subpixel == "parabola", config.reliability == "seed"
    matches = match(view.left, view.right, steps, rating, given, keep_costs=parabola or seed)
    found, reliability, sigma = matches.disparity_px, matches.reliability, matches.sigma_px
    if parabola and given is None:
        found = published_stereo.parabola(matches.best, matches.costs)
    missing = np.empty(found.shape, np.uint8)
    kernels.agree(found, reliability, sigma, missing)
    if seed:
        by_costs = published_stereo.reliability(matches.costs, config.uniqueness)
        return Disparity(found, np.where(missing, np.float32(0.0), by_costs), sigma)
    _reduce_rims(reliability, missing, config.least_reliability)
    return Disparity(found, reliability, sigma)


def searched(view: StereoView, config: StereoConfig) -> int:
    """Number of disparities searched, from 0: to those of the nearest depth, as far as the setting allows."""
    reach = min(config.most_disparity_px, view.camera.fx * view.baseline_m / config.nearest_m)
    return max(16, 16 * math.ceil(reach / 16.0))


def _reduce_rims(
    reliability: Float32[np.ndarray, "h w"], missing: UInt8[np.ndarray, "h w"], least: float
) -> None:
    """Reduce the reliability in unreliable surroundings, and to below `least` on the rims of reliable regions.

    A block that sees the edge of a thing carries its disparity half a block too far, on to a surface behind it. With
    texture there, the surface's own disparity wins and is as reliable; without, the region ends in a wrong rim. It does not
    end where no block has a disparity, as at the image border: there `missing` is 1; it is overwritten.
    """
    around = np.empty(reliability.shape, np.uint8)  # in 255ths
    kernels.in_bytes(reliability, around)
    cv2.blur(around, (AROUND_PX, AROUND_PX), dst=around, borderType=cv2.BORDER_REFLECT)
    block = np.ones((SIDE, SIDE), np.uint8)
    region = cv2.morphologyEx(missing, cv2.MORPH_OPEN, block, dst=missing)
    kernels.reduce_isolated(
        reliability, around, np.float32(255.0 * AROUND), np.float32(max(least, 1e-6)), region
    )
    holes = np.ones((HOLES_PX, HOLES_PX), np.uint8)
    region = cv2.erode(cv2.morphologyEx(region, cv2.MORPH_CLOSE, holes, dst=region), block)
    kernels.reduce_outside(reliability, np.asarray(region), np.float32(0.5 * least))


def depth(view: StereoView, config: StereoConfig | None = None) -> Depth:
    """Depth with its standard deviation, where matching is reliable.

    Args:
        view: Rectified grey images.
        config: Matcher and thresholds.

    Returns:
        Z = f B / d with sigma_Z = Z^2 sigma_d / (f B). NaN where there is no disparity or its reliability is
        below `least_reliability`.

    Raises:
        InputError: As `disparity`.

    Source: seed 003, section 3.
    """
    config = config or StereoConfig()
    return depth_of(view, disparity(view, config), config)


def depth_of(view: StereoView, matched: Disparity, config: StereoConfig) -> Depth:
    """Depth of a pair that is matched already, as `depth` gives it."""
    fB = np.float32(view.camera.fx * view.baseline_m)
    found = matched.disparity_px
    if config.vergence_deg:
        x = view.camera.single_slopes[0]
        found = found - np.float32(view.camera.fx * math.radians(config.vergence_deg)) * (1 + x * x)
    with np.errstate(invalid="ignore", divide="ignore"):
        reliable = matched.reliability >= np.float32(max(config.least_reliability, 1e-6))
        z = np.where(reliable & (found > 0.0), fB / found, np.float32(np.nan))
        sigma = z * z * matched.sigma_px / fB
    return Depth(z, sigma, view.camera, view.T_body_camera, view.baseline_m)


def _opencv(view: StereoView, method: str, steps: int) -> Float32[np.ndarray, "h w"]:
    """Disparities of OpenCV's matcher without its own filters; NaN where it gives none."""
    # OpenCV skips as many columns at the left border as it searches disparities: pad them.
    left, right = (
        cv2.copyMakeBorder(image, 0, 0, steps, 0, cv2.BORDER_REPLICATE)
        for image in (view.left, view.right)
    )
    raw = _matcher(method, steps).compute(left, right)[:, steps:]
    return np.where(raw >= 0, raw.astype(np.float32) / np.float32(16.0), np.float32(np.nan))


def _matcher(method: str, steps: int) -> cv2.StereoMatcher:
    """OpenCV's matcher "bm" or "sgbm" for `steps` disparities."""
    if method == "bm":
        blocks = cv2.StereoBM.create(steps, BM_BLOCK_PX)
        blocks.setUniquenessRatio(0)
        blocks.setTextureThreshold(0)
        return blocks
    area = SGBM_BLOCK_PX**2
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=steps,
        blockSize=SGBM_BLOCK_PX,
        P1=8 * area,
        P2=32 * area,
        preFilterCap=GRADIENT_LIMIT,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )


def _check(view: StereoView) -> None:
    expected = (view.camera.height, view.camera.width)
    if view.left.shape != view.right.shape or view.left.shape != expected:
        raise InputError(
            f"stereo: left image is {view.left.shape}, right {view.right.shape}, the camera has "
            f"{expected} (rows, columns); the pair must be rectified to one size"
        )
    check_baseline(view.baseline_m)
