"""Initial poses for the alignment after a large motion.

People and robots mostly turn about the vertical, on the spot or around the object they look at. The
hypotheses are therefore rotations about the floor's normal, about the camera and about the scene ahead of it.

Source: ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..primitives.pose import Pose3
from .pyramid import Pyramid

TURNS_DEG = (8.0, 16.0, 26.0)  # ours: the alignment itself converges from within 5 deg


def rotation_starts(target: Pyramid, around: Pose3) -> list[Pose3]:
    """Hypotheses of T_target_source after a large rotation.

    Args:
        target: The image that is held fixed; its floor, if known, defines the vertical.
        around: The expected motion, which the hypotheses rotate.

    Returns:
        Rotations to both sides, about the camera and about the median of the points it sees.
    """
    up = np.array([0.0, -1.0, 0.0]) if target.floor is None else target.floor.normal
    ahead = _median_point(target)
    starts = []
    for turn in TURNS_DEG:
        for signed in (turn, -turn):
            R = Rotation.from_rotvec(math.radians(signed) * up).as_matrix()
            for pivot in (around.position, ahead):
                starts.append(Pose3.from_rotation(R, pivot - R @ pivot) @ around)
    return starts


def _median_point(target: Pyramid) -> Float[np.ndarray, "3"]:
    """Median of the points off the floor, camera frame, m; 1 m ahead if there are none."""
    level = target.levels[-1]
    v, u = np.nonzero((level.counts > 0) & np.isfinite(level.z))
    if len(u) == 0:
        return np.array([0.0, 0.0, 1.0])
    z = level.z[v, u].astype(np.float64)
    x, y = level.slopes
    return np.array([np.median(x[u] * z), np.median(y[v] * z), np.median(z)])
