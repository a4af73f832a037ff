"""What a camera between walls sees."""

from __future__ import annotations

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3


def looked_at(walls: np.ndarray, pose: Pose3, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Depth, m, and the point in space of every pixel.

    Args:
        walls: (n, 4), n.p = d for points p in space in view of the camera.
        pose: Of the camera in space.
        camera: Its intrinsics.
    """
    directions = camera.rays @ pose.rotation.T
    ahead = directions @ walls[:, :3].T
    with np.errstate(divide="ignore"):
        away = (walls[:, 3] - walls[:, :3] @ pose.position) / ahead
    z = np.where(ahead > 1e-6, away, np.inf).min(axis=-1)
    return z, pose.position + directions * z[..., None]
