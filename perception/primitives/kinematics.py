"""A kinematic tree: rigid links joined by turning joints, and where its links are at given joint angles.

Link 0 is the base; joint i carries link i + 1, and parents come before their children. Joints that do not move are
merged into their links, so a humanoid has about fifteen.

Source: Craig 2005, chapter 3 (forward kinematics); Rodrigues' formula for the rotation about an axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .errors import InputError
from .pose import Pose3, times


@dataclass(frozen=True)
class Joint:
    """One turning joint.

    Args:
        name: Of the joint.
        parent: Number of the link that carries it.
        origin: Its frame in that of the parent, at angle zero.
        axis: Unit vector, own frame.
        least_rad, most_rad: Its range.
    """

    name: str
    parent: int
    origin: Pose3
    axis: tuple[float, float, float]
    least_rad: float
    most_rad: float


@dataclass(frozen=True)
class KinematicTree:
    """The joints, parents before children.

    Raises:
        InputError: A joint is carried by a link that comes after it.
    """

    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        for number, joint in enumerate(self.joints):
            if not 0 <= joint.parent <= number:
                raise InputError(
                    f"joint {joint.name!r} is carried by link {joint.parent}; expected one of 0 to {number}"
                )

    def index(self, name: str) -> int:
        """Number of the joint of that name.

        Raises:
            InputError: for a name that no joint has.
        """
        for number, joint in enumerate(self.joints):
            if joint.name == name:
                return number
        raise InputError(
            f"joint {name!r} is not in the tree; it has {', '.join(j.name for j in self.joints)}"
        )

    def path(self, link: int) -> list[int]:
        """The joints from the base to a link, in order."""
        found: list[int] = []
        while link > 0:
            found.append(link - 1)
            link = self.joints[link - 1].parent
        return found[::-1]

    def joints_between(self, one: int, other: int) -> int:
        """Number of joints on the way from one link to another."""
        return len(set(self.path(one)) ^ set(self.path(other)))


def link_poses(
    tree: KinematicTree, angles: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "links 4 4"]:
    """Pose of every link in the frame of the base, as homogeneous matrices.

    Args:
        tree: Of n joints.
        angles: Of the joints, rad.

    Raises:
        InputError: for another number of angles than joints.
    """
    if len(angles) != len(tree.joints):
        raise InputError(f"{len(angles)} joint angles; the tree has {len(tree.joints)} joints")
    poses = np.empty((len(tree.joints) + 1, 4, 4))
    poses[0] = np.eye(4)
    for number, joint in enumerate(tree.joints):
        turn = np.eye(4)
        turn[:3, :3] = rotation_about(joint.axis, float(angles[number]))
        poses[number + 1] = times(times(poses[joint.parent], joint.origin.matrix), turn)
    return poses


def rotation_about(axis: tuple[float, float, float], angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about a unit vector."""
    x, y, z = axis
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    v = 1.0 - c
    return np.array(
        [
            [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
        ]
    )
