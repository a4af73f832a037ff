"""Information gain of a landmark: how much its sighting reduces the uncertainty of the robot's position.

Source: ours; the linearised measurement update of the localiser.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import deviation


def gains(
    offsets: Float[np.ndarray, "n 2"],
    covariance: Float[np.ndarray, "3 3"],
    range_per_m: float,
    bearing_rad: float,
) -> Float[np.ndarray, "n"]:
    """Relative reduction of the standard deviation of the position by a sighting of each landmark.

    Args:
        offsets: From the mean position of the robot to the landmarks, world axes, m.
        covariance: Of (x, y, yaw).
        range_per_m: Standard deviation of a range divided by its square, 1/m.
        bearing_rad: Standard deviation of a bearing.

    Returns:
        In [0, 1].
    """
    away = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 0.1)
    H = np.zeros((len(offsets), 2, 3))
    H[:, 0, :2] = -offsets / away[:, None]
    H[:, 1, 0], H[:, 1, 1] = offsets[:, 1] / away**2, -offsets[:, 0] / away**2
    H[:, 1, 2] = -1.0
    noise = np.zeros((len(offsets), 2, 2))
    noise[:, 0, 0] = (range_per_m * away**2) ** 2
    noise[:, 1, 1] = bearing_rad**2
    PH = covariance @ H.transpose(0, 2, 1)
    after = covariance - PH @ np.linalg.solve(H @ PH + noise, PH.transpose(0, 2, 1))
    middle, half = (after[:, 0, 0] + after[:, 1, 1]) / 2, (after[:, 0, 0] - after[:, 1, 1]) / 2
    left = np.sqrt(np.maximum(middle + np.hypot(half, after[:, 0, 1]), 0.0))
    before = deviation(covariance[:2, :2])
    return np.maximum(1.0 - left / before, 0.0) if before > 0.0 else np.zeros(len(offsets))
