"""Connected components of a mask with bounding box, area and centroid.

OpenCV labels them. A single pass of ours over the labels takes a fifth of the time of OpenCV's statistics.

Source: seed 000, section 3.1 (components).
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8, UInt16

from . import _monocular_kernels


def components(
    mask: UInt8[np.ndarray, "h w"], connectivity: int
) -> tuple[UInt16[np.ndarray, "h w"], Int[np.ndarray, "n 5"], Float[np.ndarray, "n 2"]]:
    """Connected components of the non-zero pixels, numbered as OpenCV does; label 0 is the background.

    Args:
        mask: Non-zero in the foreground.
        connectivity: 4 or 8.

    Returns:
        Labels; left, top, width, height and area of each label, px; its centroid (u, v), px.
    """
    count, labels = cv2.connectedComponents(mask, connectivity=connectivity, ltype=cv2.CV_16U)
    boxes, centroids = np.empty((count, 5), np.int32), np.zeros((count, 2))
    _monocular_kernels.measure(np.asarray(labels), boxes, centroids)
    return np.asarray(labels, dtype=np.uint16), boxes, centroids
