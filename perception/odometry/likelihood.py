"""Which of two motions explains a pair of images better.

Overlap alone does not tell: it is largest where the view slid along a wall and floor until it coincides with the
other one. Compared is the truncated likelihood of depth and grey values at the pixels that both motions bring into
view, on the coarsest level. A gain that chance may explain does not count.

Source: Torr and Zisserman 2000 (truncated likelihood); the paired test is ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.pose import Pose3
from .pyramid import Pyramid

OUTLIER = 3.0  # standard deviations: larger residuals are outliers and cost the same
LEAST_GREY_SIGMA = 2.0  # of 255, as in the alignment
LEAST_COMMON = 0.35  # ours: a smaller share of common pixels may be a single edge
SURELY = 3.0  # standard deviations of the mean gain
COMMON_PX = 15.0  # ours: neighbouring pixels with one common error; NEES of 6 with depth noise


def residuals(
    target: Pyramid, source: Pyramid, motion: Pose3, with_grey: bool
) -> Float[np.ndarray, "2 n"]:
    """Distances to the target's planes in standard deviations, and grey differences; NaN out of view.

    Args:
        target, source: The images.
        motion: T_target_source.
        with_grey: False leaves grey values out: their differences are 0.
    """
    to, of = target.levels[-1], source.levels[-1]
    seen = of.z > 0.0
    points = motion.apply(of.camera.rays[seen] * of.z[seen, None])
    pixels = to.camera.project(points)
    inside = np.flatnonzero(to.camera.contains(pixels))
    last = (to.camera.width - 1, to.camera.height - 1)
    u, v = np.minimum(np.rint(pixels[inside]).astype(int), last).T
    known = to.packed[v, u, 4] > 0.0
    inside, cell = inside[known], to.packed[v, u][known]
    found = np.full((2, len(points)), np.nan)
    away = np.sum(cell[:, :3] * points[inside], axis=1) - cell[:, 3]
    found[0, inside] = away / of.sigma[seen][inside]
    found[1, inside] = cell[:, 5] - of.grey[seen][inside] if with_grey else 0.0
    return found


def likelier(one: Float[np.ndarray, "2 n"], other: Float[np.ndarray, "2 n"]) -> bool:
    """True if the residuals of one motion are smaller than those of another one, and not by chance."""
    both = np.isfinite(one[0]) & np.isfinite(other[0])
    if np.count_nonzero(both) <= LEAST_COMMON * len(both):
        return False
    distance, grey = np.stack([one[:, both], other[:, both]], axis=1)
    grey = np.abs(grey - np.median(grey, axis=1, keepdims=True))  # exposures may differ
    sigma = max(1.4826 * float(np.median(grey, axis=1).min()), LEAST_GREY_SIGMA)
    costs = np.minimum(distance**2, OUTLIER**2) + np.minimum((grey / sigma) ** 2, OUTLIER**2)
    gain = costs[1] - costs[0]
    chance = float(np.std(gain)) * math.sqrt(COMMON_PX / len(gain))
    return float(np.mean(gain)) > SURELY * chance
