"""The robot's own body as its cameras may see it: convex parts on a kinematic tree, and the joint angles of a frame.

A recording carries it, so that what the robot sees of itself is removed offline as it was live.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .kinematics import KinematicTree, link_poses
from .pose import Pose3


@dataclass(frozen=True)
class JointReading:
    """Joint angles by the encoders.

    Args:
        T_body_base: Base of the tree in the body frame.
        angles: Of its joints, rad.
    """

    T_body_base: Pose3
    angles: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class OwnPart:
    """A convex part of one link.

    Args:
        name: Of the part.
        link: Number of the link.
        corners: In the frame of the link, m.
        margin_m: By which the part may reach out of its corners.
        angle_sigma_rad: Standard deviation of its direction from the camera by joint angles: offsets of the joints
            between them, and what no encoder measures.
    """

    name: str
    link: int
    corners: Float[np.ndarray, "n 3"]
    margin_m: float
    angle_sigma_rad: float


@dataclass(frozen=True, eq=False)
class OwnBody:
    """All parts that a camera may see."""

    tree: KinematicTree
    parts: tuple[OwnPart, ...]

    def corners(self, joints: JointReading) -> list[Float[np.ndarray, "n 3"]]:
        """Corners of every part in the body frame at measured angles, m.

        Raises:
            InputError: The tree has another number of joints.
        """
        poses = link_poses(self.tree, np.array(joints.angles))
        base = joints.T_body_base.matrix
        found = []
        for part in self.parts:
            T = base @ poses[part.link]
            found.append(part.corners @ T[:3, :3].T + T[:3, 3])
        return found
