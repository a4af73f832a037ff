"""How much of the floor ahead a depth image answers for: whether depth can be relied on where feet will go.

Stereo on a bare floor rejects nearly every pixel, a dead camera gives none at all; what stands on the floor
answers as well as the floor itself. So the share says whether the sensor works, not what it sees.

Source: ours; it reads the reliability of seed 003, section 3, after its threshold.
"""

from __future__ import annotations

import numpy as np

from ..primitives.frame import Depth
from ..primitives.plane import Plane

STRIDE = 4  # ours: every fourth row and column is enough for a share
LEAST_SHARE = 0.02  # ours: of the image, below which too little of the floor is looked at


def answered_share(depth: Depth, floor: Plane, nearest_m: float, farthest_m: float) -> float | None:
    """Of the pixels that look towards the floor within reach, the share that have a depth.

    Args:
        depth: NaN where nothing was found, or nothing to be relied on.
        floor: Camera frame, seen or expected.
        nearest_m, farthest_m: Along the optical axis; floor nearer or farther is left out.

    Returns:
        In [0, 1]; None if the camera looks elsewhere.
    """
    x, y = (np.asarray(s, np.float64) for s in depth.camera.slopes)
    x, y = x[:: _step(x, 0), :: _step(x, 1)], y[:: _step(y, 0), :: _step(y, 1)]
    a, b, c = (float(v) for v in floor.normal)
    sinks = -(a * x + b * y + c)  # per metre along the axis; positive towards the floor
    with np.errstate(divide="ignore"):
        reach = np.where(sinks > 0.0, floor.offset_m / sinks, np.inf)
    asked = (reach >= nearest_m) & (reach <= farthest_m)
    if np.count_nonzero(asked) < LEAST_SHARE * asked.size:
        return None
    return float(np.isfinite(depth.z[::STRIDE, ::STRIDE][asked]).mean())


def _step(slopes: np.ndarray, axis: int) -> int:
    """Stride along an axis; slopes of an undistorted camera have length 1 along one of theirs."""
    return STRIDE if slopes.shape[axis] > 1 else 1
