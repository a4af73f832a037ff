"""Block matching with its costs in the open.

Both images become horizontal gradients, cut off, so that lighting does not matter. For every disparity the
absolute differences are summed over a square block; the least sum wins, and a V through it and its two
neighbours gives the part of a pixel. What the sums say beside the winner is kept: the walls of the valley,
the deepest other valley, and how well the matched pixel of the right image could do elsewhere.

Source: seed 003, section 3 (block cost, second best); Konolige 1997 (gradients, left-right check).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int16, UInt8

from ..primitives.errors import ConfigError
from . import _block_matching_kernels as kernels
from . import _stereo_trust_kernels as trust_kernels

GRADIENT_LIMIT = 31  # OpenCV's: x-Sobel is cut off there
SIDES = (9, 15, 21)  # px, of a block: multiples of three, summed from sums of three
LANES = 8  # disparities are searched in bundles of so many


@dataclass(frozen=True, eq=False)
class Matches:
    """What block costs say of a disparity for every pixel.

    Args:
        disparity_px: Sub-pixel; where nothing fits as well as anywhere.
        costs: At the whole disparity d below it or nearest to it: sums over the block at d - 1, d, d + 1,
            the least two or more away from d, and the least that the pixel matched in the right image
            finds anywhere in the left one. 32767 where there is none.
    """

    disparity_px: Float32[np.ndarray, "h w"]
    costs: Int16[np.ndarray, "h 5 w"]


def match(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    disparities: int,
    block_px: int = 9,
    given: Float32[np.ndarray, "h w"] | None = None,
) -> Matches:
    """Disparity of every pixel of the left image, or the costs of a disparity found otherwise.

    Args:
        left, right: Grey images of one size, rectified.
        disparities: How many are searched, from 0 on; raised to a multiple of eight.
        block_px: Side of the block: 9, 15 or 21.
        given: Disparities to be judged instead of searched, px; NaN and what lies outside the search are
            judged at its nearest end.

    Raises:
        ConfigError: For another side, or no disparity to search.

    Source: seed 003, section 3.
    """
    if block_px not in SIDES:
        raise ConfigError(f"block matching: block_px={block_px} must be one of {SIDES}")
    if disparities < 1:
        raise ConfigError(f"block matching: disparities={disparities} must be at least 1")
    height, width = left.shape
    count = min(-(-disparities // LANES) * LANES, width // LANES * LANES)
    if count < LANES:
        raise ConfigError(f"block matching: images {width} px wide are too small; at least {LANES}")
    radius = block_px // 2
    costs = np.empty((height, 5, width), np.int16)
    if given is None:
        found = np.empty((height, width), np.int16)
    else:
        rounded = np.rint(np.nan_to_num(given, nan=0.0))
        found = np.clip(rounded, 0, np.minimum(count - 1, np.arange(width))).astype(np.int16)
    kernels.match(
        kernels.prefilter(left, GRADIENT_LIMIT, radius),
        kernels.prefilter(right, GRADIENT_LIMIT, radius),
        count,
        radius,
        given is not None,
        found,
        costs,
    )
    return Matches(trust_kernels.between(found, costs) if given is None else given, costs)
