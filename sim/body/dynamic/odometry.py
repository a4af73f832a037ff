"""Foot-to-foot odometry from the joint encoders.

The stance foot is assumed not to move, and the encoders give body and other foot relative to it; after the weight has
shifted, the other foot becomes the stance foot. Slip of the soles and backlash of the gears are not measured: they are
the error of this odometry. The body frame lies midway between the feet with the heading of the pelvis, which cameras
and gyro share.

Source: seed 003, section 2.2 (foot-to-foot odometry).
"""

from __future__ import annotations

from perception.primitives.pose import Pose2

Footprints = tuple[Pose2, Pose2]


class FootToFootOdometry:
    """Body pose in its start frame from footprints (left, right) below a level pelvis."""

    def __init__(self, feet: Footprints) -> None:
        self.standing = 1  # +1 left, -1 right
        self._foot = self.pelvis(feet) @ self.sole(feet)

    def set_stance(self, feet: Footprints, standing: int) -> None:
        """Set the stance foot: +1 left, -1 right."""
        before = self.sole(feet)
        self.standing = standing
        self._foot = self._foot @ before.inverse() @ self.sole(feet)

    def body(self, feet: Footprints) -> Pose2:
        """Body frame, from the stance foot."""
        pelvis = self._foot @ self.sole(feet).inverse()
        return pelvis @ self.pelvis(feet).inverse()

    def pelvis(self, feet: Footprints) -> Pose2:
        """Pelvis in the body frame."""
        left, right = feet
        return Pose2(-(left.x + right.x) / 2, -(left.y + right.y) / 2)

    def sole(self, feet: Footprints) -> Pose2:
        """Stance foot in the frame of the pelvis."""
        left, right = feet
        return left if self.standing > 0 else right


def body_between_feet(left: Pose2, right: Pose2, heading_rad: float) -> Pose2:
    """Body frame midway between two feet, with the heading of the pelvis."""
    return Pose2((left.x + right.x) / 2, (left.y + right.y) / 2, heading_rad)
