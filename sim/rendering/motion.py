"""Camera motion during an exposure: constant linear and angular velocity. Source: ours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.pose import Pose3


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a camera, world axes.

    Args:
        velocity: Of its centre, m/s.
        angular_velocity: About its centre, rad/s.
    """

    velocity: Float[np.ndarray, "3"]
    angular_velocity: Float[np.ndarray, "3"]

    def pose_after(self, pose: Pose3, seconds: float) -> Pose3:
        """Camera pose that long after a pose; before it if negative."""
        turned = Rotation.from_rotvec(self.angular_velocity * seconds).as_matrix() @ pose.rotation
        return Pose3.from_rotation(turned, pose.position + self.velocity * seconds)


STATIONARY = Motion(np.zeros(3), np.zeros(3))


def motion_between(before: Pose3, after: Pose3, seconds: float) -> Motion:
    """Motion from one pose to another in a time."""
    turned = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec()
    return Motion((after.position - before.position) / seconds, turned / seconds)


def exposure_times(length_s: float, count: int) -> list[float]:
    """Midpoints of equal parts of an exposure, s from its middle."""
    return [length_s * ((k + 0.5) / count - 0.5) for k in range(count)]
