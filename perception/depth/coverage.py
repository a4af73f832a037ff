"""Depth coverage of the floor ahead: the share of pixels towards the floor that have a depth.

Stereo on a floor without texture rejects nearly every pixel, and a failed camera gives none. Obstacles on the
floor count as much as the floor itself, so the share measures whether the sensor works, not what is in view.

Source: ours; stereo pixels have a depth where the reliability of seed 003, section 3, passes its threshold.
"""

from __future__ import annotations

import numpy as np

from ..primitives.frame import Depth
from ..primitives.plane import Plane

STRIDE = 4  # ours: every fourth row and column suffices for a share
LEAST_SHARE = 0.02  # ours: of the image; with less floor in view there is no result


def answered_share(depth: Depth, floor: Plane, nearest_m: float, farthest_m: float) -> float | None:
    """Share of the pixels towards the floor within a depth range that have a depth.

    Args:
        depth: NaN where no depth was found, or where it is not reliable.
        floor: Measured or predicted floor, camera frame.
        nearest_m, farthest_m: Depth range of the floor along the optical axis.

    Returns:
        In [0, 1]; None if less than `LEAST_SHARE` of the image looks at that floor.
    """
    x, y = (np.asarray(s, np.float64) for s in depth.camera.slopes)
    x, y = x[:: _step(x, 0), :: _step(x, 1)], y[:: _step(y, 0), :: _step(y, 1)]
    a, b, c = (float(v) for v in floor.normal)
    descent = -(a * x + b * y + c)  # per metre along the axis; positive towards the floor
    with np.errstate(divide="ignore"):
        reach = np.where(descent > 0.0, floor.offset_m / descent, np.inf)
    expected = (reach >= nearest_m) & (reach <= farthest_m)
    if np.count_nonzero(expected) < LEAST_SHARE * expected.size:
        return None
    return float(np.isfinite(depth.z[::STRIDE, ::STRIDE][expected]).mean())


def _step(slopes: np.ndarray, axis: int) -> int:
    """Stride along an axis; 1 for the axis of length 1 in the slopes of an undistorted camera."""
    return STRIDE if slopes.shape[axis] > 1 else 1
