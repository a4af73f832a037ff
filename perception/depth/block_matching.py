"""Block matching that returns the costs its reliability is computed from.

Both images become clipped horizontal gradients, which do not depend on lighting. For every disparity the
absolute differences are summed over a block of 9 x 9 pixels; the lowest sum wins, and a V through it and its
two neighbours gives the sub-pixel part. Kept besides: the costs next to the minimum, the lowest cost at any
other disparity, and the lowest cost of the matched pixel of the right image.

Source: seed 003, section 3 (block cost, second best); Konolige 1997 (gradients, left-right
check).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, UInt8

from ..primitives.errors import ConfigError
from . import _block_matching_kernels as kernels
from ._stereo_trust_kernels import Rating

GRADIENT_LIMIT = 31  # OpenCV: the x-Sobel is clipped there
LANES = 8  # disparities searched together


@dataclass(frozen=True, eq=False)
class Matches:
    """Disparity and block costs of every pixel.

    Args:
        disparity_px: Sub-pixel; every pixel has one, reliable or not.
        reliability: By costs alone, in [0, 1].
        sigma_px: Standard deviation of a correct match.
        best, costs: With d the integer disparity: d, and the block cost at d - 1, d and d + 1, lowest cost two or more
            away from d, lowest cost of the matched right pixel with any left pixel. 32767 where undefined. Of the last
            row only, unless all were to be kept.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    reliability: Float32[np.ndarray, "h w"]
    sigma_px: Float32[np.ndarray, "h w"]
    best: Int16[np.ndarray, "some w"]
    costs: Int16[np.ndarray, "kept 5 w"]


def match(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    disparities: int,
    rating: Rating,
    given: Float32[np.ndarray, "h w"] | None = None,
    keep_costs: bool = False,
) -> Matches:
    """Disparity of every pixel of the left image, or the costs of given disparities.

    Args:
        left, right: Grey images of one size, rectified.
        disparities: Number of disparities searched, from 0; rounded up to a multiple of eight.
        rating: Parameters of reliability and standard deviation.
        given: Disparities to evaluate instead of searching, px; clipped to the search range, NaN counts
            as 0.
        keep_costs: Whether the costs of all rows are kept.

    Raises:
        ConfigError: There is no disparity to search, or the images are too narrow.

    Source: seed 003, section 3.
    """
    if disparities < 1:
        raise ConfigError(f"block matching: disparities={disparities} must be at least 1")
    height, width = left.shape
    count = min(-(-disparities // LANES) * LANES, width // LANES * LANES)
    if count < LANES:
        raise ConfigError(f"block matching: images {width} px wide are too small; at least {LANES}")
    rows = height if keep_costs else 1
    if given is None:
        found, disparity = np.empty((rows, width), np.int16), np.empty((height, width), np.float32)
    else:
        rounded = np.rint(np.nan_to_num(given, nan=0.0))
        found = np.clip(rounded, 0, np.minimum(count - 1, np.arange(width))).astype(np.int16)
        disparity = given
    result = Matches(
        disparity,
        np.empty((height, width), np.float32),
        np.empty((height, width), np.float32),
        found,
        np.empty((rows, 5, width), np.int16),
    )
    kernels.match(
        kernels.prefilter(left, GRADIENT_LIMIT),
        kernels.prefilter(right, GRADIENT_LIMIT),
        count,
        given is not None,
        rating,
        result.best,
        result.costs,
        result.disparity_px,
        result.reliability,
        result.sigma_px,
    )
    return result
