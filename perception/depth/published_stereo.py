"""Sub-pixel disparity and reliability of seed 003 by its formulas, beside ours.

With the block costs c_-, c_0, c_+ at the best disparity d_0 and its two neighbours, and the least cost c_2 farther
away: the vertex of the parabola through the three, d_0 + (c_- - c_+) / (2 (c_- - 2 c_0 + c_+)), and

    reliability = clip(s / s_0, 0, 1) clip((c_2 / c_0 - 1) / u_0, 0, 1),  s = (c_- - 2 c_0 + c_+) / 2.

Source: seed 003, section 3; s_0 is said to be tuned on a texture chart and not printed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int16

from ._stereo_trust_kernels import NEVER, SIDE

SHARPNESS = 2.0  # ours: s_0, grey levels per pixel; largest area under the ROC curve on other faces than 003-E2's
MEASURED = Int16[np.ndarray, "h 5 w"]
"""Block costs of `block_matching.Matches`."""


def parabola(best: Int16[np.ndarray, "h w"], costs: MEASURED) -> Float32[np.ndarray, "h w"]:
    """Sub-pixel disparity; the whole one at the ends of the search range."""
    lower, here, higher = (costs[:, k].astype(np.float32) for k in range(3))
    curvature = lower - 2.0 * here + higher
    inside = (costs[:, 0] != NEVER) & (costs[:, 2] != NEVER) & (curvature > 0.0)
    step = np.where(inside, (lower - higher) / np.where(inside, 2.0 * curvature, 1.0), 0.0)
    return (best + step).astype(np.float32)


def reliability(costs: MEASURED, uniqueness: float) -> Float32[np.ndarray, "h w"]:
    """Reliability in [0, 1].

    Args:
        costs: Of the disparity found.
        uniqueness: u_0.
    """
    lower, here, higher, rival = (costs[:, k].astype(np.float32) for k in range(4))
    sharp = (lower - 2.0 * here + higher) / np.float32(2.0 * SIDE**2 * SHARPNESS)
    unique = (rival - here) / (np.float32(uniqueness) * np.maximum(here, np.float32(1.0)))
    return np.clip(sharp, 0.0, 1.0) * np.clip(unique, 0.0, 1.0)
