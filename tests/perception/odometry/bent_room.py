"""Images of a patterned room by a depth camera that bends."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from perception.depth.distortion import Bend
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from .walls import looked_at

CAMERA = Camera(160, 120, 140.0, 140.0, 79.5, 59.5)
WALLS = np.array(  # n.p = d, y down
    [[0.0, 0.0, 1.0, 2.6], [1.0, 0.0, 0.0, 1.9], [-1.0, 0.0, 0.0, 1.7], [0.0, 1.0, 0.0, 1.1]]
)
BENT = Bend(0.008, -0.006, 0.018, -0.015, 0.010)
IMAGES = 36


def pose(number: int) -> Pose3:
    """A camera carried by hand: to and fro, turned to both sides."""
    along = 2.0 * np.pi * number / IMAGES
    position = np.array([0.30 * np.sin(along), 0.10 * np.sin(2.0 * along), 0.25 * np.cos(along)])
    turn = [0.25 + 0.08 * np.sin(along), 0.45 * np.sin(along), 0.05 * np.cos(along)]
    return Pose3.from_rotation(Rotation.from_euler("xyz", turn).as_matrix(), position)


def seen(T: Pose3, bend: Bend, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Depth with noise, bent, and a picture of a patterned room."""
    z, spot = looked_at(WALLS, T, CAMERA)
    light = np.sin(9 * spot[..., 0]) + np.sin(11 * spot[..., 1]) + np.sin(8 * spot[..., 2] + 1.0)
    right = (np.arange(160) - 79.5) / 80.0
    down = ((np.arange(120) - 59.5) / 80.0)[:, None]
    share = bend.right * right + bend.down * down + bend.right_right * right**2
    share = share + bend.right_down * right * down + bend.down_down * down**2
    z = z * (1.0 + share) + (0.0012 + 0.0019 * (z - 0.4) ** 2) * rng.standard_normal(z.shape)
    grey = 128.0 + 30.0 * light + 2.0 * rng.standard_normal(z.shape)
    return z.astype(np.float32), np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2).astype(
        np.uint8
    )
