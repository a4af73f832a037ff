"""Dead reckoning from foot to foot: what the joints' encoders and the change of the standing foot say.

While a foot stands it is taken not to move, and the encoders tell where body and other foot are from it;
when the weight has changed over, the other foot becomes the one that stands. What soles slip and gears
play the encoders do not see, and that is the whole error of it.

The body frame lies midway between the feet and heads with the pelvis: cameras and gyro head with it.

Source: seed 003, section 2.2 (foot-to-foot odometry).
"""

from __future__ import annotations

from perception.primitives.pose import Pose2

Footprints = tuple[Pose2, Pose2]


class FootToFoot:
    """The body in the frame where it began, by footprints alone: (left, right) below an upright pelvis."""

    def __init__(self, prints: Footprints) -> None:
        self.standing = 1  # +1 left, -1 right
        self._foot = self.pelvis(prints) @ self.sole(prints)

    def read(self, prints: Footprints, standing: int) -> None:
        """The foot that bears the weight now: +1 left, -1 right."""
        before = self.sole(prints)
        self.standing = standing
        self._foot = self._foot @ before.inverse() @ self.sole(prints)

    def body(self, prints: Footprints) -> Pose2:
        """The body frame, from the foot that stands."""
        pelvis = self._foot @ self.sole(prints).inverse()
        return pelvis @ self.pelvis(prints).inverse()

    def pelvis(self, prints: Footprints) -> Pose2:
        """The pelvis in the body frame."""
        left, right = prints
        return Pose2(-(left.x + right.x) / 2, -(left.y + right.y) / 2)

    def sole(self, prints: Footprints) -> Pose2:
        """The foot that stands, as seen from the pelvis."""
        left, right = prints
        return left if self.standing > 0 else right


def body_over(left: Pose2, right: Pose2, heading_rad: float) -> Pose2:
    """The body frame over two feet and under a pelvis of that heading."""
    return Pose2((left.x + right.x) / 2, (left.y + right.y) / 2, heading_rad)
