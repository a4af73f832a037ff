"""Dead reckoning from foot to foot: what the joints' encoders and the change of the standing foot say.

While a foot stands it is taken not to move, and the encoders tell where body and other foot are from it;
when the weight has changed over, the other foot becomes the one that stands. What soles slip and gears
play the encoders do not see, and that is the whole error of it.

Source: seed 003, section 2.2 (foot-to-foot odometry).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, wrap_angle

from .legs import Legs


class FootToFoot:
    """The body in the frame where it began, by encoders alone."""

    def __init__(self, legs: Legs, encoders: Float[np.ndarray, "12"]) -> None:
        self._legs = legs
        self._standing = 1
        self._foot = Pose2()
        self._foot = self.seen(encoders)[0].inverse() @ self._sole(encoders)

    def read(self, encoders: Float[np.ndarray, "12"], standing: int) -> None:
        """Take the angles of a tick.

        Args:
            encoders: Of the legs, rad.
            standing: The foot that bears the weight now, +1 left, -1 right.
        """
        if standing == self._standing:
            return
        before = self._sole(encoders)
        self._standing = standing
        self._foot = self._foot @ before.inverse() @ self._sole(encoders)

    def body(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        """The body frame: midway between the feet, heading with the pelvis."""
        body, _ = self.seen(encoders)
        return self._foot @ self._sole(encoders).inverse() @ body

    def pelvis(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        """The pelvis in the body frame."""
        return self.seen(encoders)[0].inverse()

    def seen(self, encoders: Float[np.ndarray, "12"]) -> tuple[Pose2, float]:
        """The body frame in the pelvis, and how much of the pelvis' heading is not the feet's, rad."""
        left, right = self._legs.footprints(encoders)
        turn = left.yaw + wrap_angle(right.yaw - left.yaw) / 2
        return Pose2((left.x + right.x) / 2, (left.y + right.y) / 2, 0.0), -turn

    def _sole(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        left, right = self._legs.footprints(encoders)
        return left if self._standing > 0 else right


def midway(left: Pose2, right: Pose2, heading_rad: float) -> Pose2:
    """The body frame over two feet and under a pelvis."""
    yaw = math.remainder(heading_rad, 2 * math.pi)
    return Pose2((left.x + right.x) / 2, (left.y + right.y) / 2, yaw)
