"""Dead reckoning from foot to foot: what the joints' encoders and the change of the standing foot say.

While a foot stands it is taken not to move, and the encoders tell where body and other foot are from it;
when the weight has changed over, the other foot becomes the one that stands. What soles slip and gears
play the encoders do not see, and that is the whole error of it.

The body frame lies midway between the feet and heads with the pelvis: cameras and gyro head with it.

Source: seed 003, section 2.2 (foot-to-foot odometry).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2

from .legs import Legs


class FootToFoot:
    """The body in the frame where it began, by encoders alone; angles are those of the legs, rad."""

    def __init__(self, legs: Legs, encoders: Float[np.ndarray, "12"]) -> None:
        self._legs = legs
        self._standing = 1
        self._foot = self.pelvis(encoders) @ self.sole(encoders)

    def read(self, encoders: Float[np.ndarray, "12"], standing: int) -> None:
        """The foot that bears the weight now: +1 left, -1 right."""
        if standing == self._standing:
            return
        before = self.sole(encoders)
        self._standing = standing
        self._foot = self._foot @ before.inverse() @ self.sole(encoders)

    def body(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        """The body frame, from the foot that stands."""
        pelvis = self._foot @ self.sole(encoders).inverse()
        return pelvis @ self.pelvis(encoders).inverse()

    def pelvis(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        """The pelvis in the body frame."""
        left, right = self._legs.footprints(encoders)
        return Pose2(-(left.x + right.x) / 2, -(left.y + right.y) / 2)

    def sole(self, encoders: Float[np.ndarray, "12"]) -> Pose2:
        """The foot that stands, as seen from the pelvis."""
        left, right = self._legs.footprints(encoders)
        return left if self._standing > 0 else right


def body_over(left: Pose2, right: Pose2, heading_rad: float) -> Pose2:
    """The body frame over two feet and under a pelvis of that heading."""
    return Pose2((left.x + right.x) / 2, (left.y + right.y) / 2, heading_rad)
