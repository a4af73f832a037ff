"""Images of a road between walls by a stereo pair whose right camera may be turned against the calibration."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

from .walls import looked_at

CAMERA = Camera(310, 94, 180.0, 180.0, 154.5, 46.5)
BASELINE_M = 0.54
SIGMA_PX = 0.05  # of a disparity, at the size of these images
STEP_M = 1.0
WALLS = np.array(  # n.p = d, y down: the road, walls on both sides, and what closes the view
    [[0.0, 1.0, 0.0, 1.65], [-1.0, 0.0, 0.0, 9.0], [1.0, 0.0, 0.0, 14.0], [0.0, 0.0, 1.0, 90.0]]
)


def pose(number: int) -> Pose3:
    """A car that drives ahead in a slight curve."""
    turn = Rotation.from_euler("y", 0.004 * number).as_matrix()
    return Pose3.from_rotation(turn, np.array([0.002 * number**2, 0.0, STEP_M * number]))


def seen(T: Pose3, vergence: float, rng: np.random.Generator) -> tuple[Depth, np.ndarray]:
    """Depth by disparities of a right camera that is turned outwards by `vergence`, rad, and the left picture."""
    z, spot = looked_at(WALLS, T, CAMERA)
    x = CAMERA.rays[..., 0] / CAMERA.rays[..., 2]
    # Seen from the right camera the slope of the ray is that of its direction turned by the angle.
    slope = x - BASELINE_M / z
    right = np.tan(np.arctan(slope) - vergence)
    disparity = CAMERA.fx * (x - right) + SIGMA_PX * rng.standard_normal(z.shape)
    fB = CAMERA.fx * BASELINE_M
    with np.errstate(divide="ignore"):
        found = np.where(disparity > 0.2, fB / disparity, np.nan)
    sigma = found**2 * SIGMA_PX / fB
    light = sum(np.sin(k * spot[..., i] + k) for i in range(3) for k in (0.5, 1.1, 2.3)) * np.exp(
        -0.01 * z
    )
    grey = 128.0 + 16.0 * light + 2.0 * rng.standard_normal(z.shape)
    rgb = np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2).astype(np.uint8)
    return Depth(
        found.astype(np.float32), sigma.astype(np.float32), CAMERA, Pose3(), BASELINE_M
    ), rgb
