"""The moving links of a described robot with their masses: kinematics, centre of mass, ZMP of a motion.

The pelvis frame is the root of the URDF turned so that x is ahead. Angles have the order of `JointedRobot.tree`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose2, Pose3

from ...robots import urdf
from ...robots.description import Description
from ...robots.jointed import JointedRobot, jointed
from ...robots.masses import Mass, efforts, masses
from ..pendulum import GRAVITY_MPS2
from . import _momentum_kernels as momentum_kernels
from . import _tree_kernels as kernels


class Tree:
    """Kinematics and masses of one robot."""

    def __init__(self, robot: JointedRobot) -> None:
        self.robot = robot
        description, joints = robot.description, robot.tree.joints
        model = urdf.read(description.urdf_path(), description.moving, dict(description.posture))
        turn = robot.T_trunk_base.rotation
        self.names = tuple(joint.name for joint in joints)
        self.masses = tuple(
            _turned(mass, turn) if k == 0 else mass for k, mass in enumerate(masses(model))
        )
        self.efforts = efforts(model)
        self.hip_m = robot.T_trunk_base.translation[2]
        origins = [
            turn @ j.origin.matrix[:3] if j.parent == 0 else j.origin.matrix[:3] for j in joints
        ]
        self.parents = np.array([joint.parent for joint in joints])
        self.origins = np.stack(origins)
        self.axes = np.array([joint.axis for joint in joints])
        self._tree = (
            self.parents,
            self.origins[:, :, :3].copy(),
            self.origins[:, :, 3].copy(),
            self.axes,
        )
        self._bodies = (
            np.array([mass.kg for mass in self.masses]),
            np.array([mass.centre for mass in self.masses]),
            np.array([mass.inertia for mass in self.masses]),
        )
        self._gaze = np.array(robot.gaze)
        x, y, z = description.legs.sole_m
        tools = []
        for foot, level, side in zip(robot.feet, robot.level, (1.0, -1.0), strict=True):
            T_sole_foot = np.eye(4)
            T_sole_foot[:3, :3], T_sole_foot[:3, 3] = level, (-x, -side * y, -z)
            tools.append(foot @ np.linalg.inv(T_sole_foot))
        self.tools = np.stack(tools)
        self.chains = np.array(robot.legs)
        self._legs = (
            self.chains,
            self.tools[:, :3, :3].copy(),
            self.tools[:, :3, 3].copy(),
            np.array([(joint.least_rad, joint.most_rad) for joint in joints]),
        )

    @property
    def weight_n(self) -> float:
        """Weight of the robot."""
        return float(self._bodies[0].sum()) * GRAVITY_MPS2

    def links(
        self, angles: Float[np.ndarray, "n"]
    ) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3"]]:
        """Rotations and places of all links in the pelvis frame."""
        R, p = np.zeros((len(self.masses), 3, 3)), np.zeros((len(self.masses), 3))
        R[0] = np.eye(3)
        kernels.forward(self._tree, angles, R, p)
        return R, p

    def soles(self, angles: Float[np.ndarray, "n"]) -> tuple[Pose3, Pose3]:
        """Left and right sole in the pelvis frame, at the point that a footstep places, x ahead and z up."""
        R, p = self.links(angles)
        left, right = (
            Pose3.from_rotation(R[link] @ tool[:3, :3], R[link] @ tool[:3, 3] + p[link])
            for link, tool in zip(self.chains[:, -1] + 1, self.tools, strict=True)
        )
        return left, right

    def centre_of_mass(self, angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "3"]:
        """Centre of mass of the whole robot in the pelvis frame, m."""
        com = np.empty(3)
        kernels.centre_of_mass(self._tree, self._bodies, angles, com)
        return com

    def follow(
        self,
        com: Float[np.ndarray, "n 2"],
        left: Float[np.ndarray, "n 4"],
        right: Float[np.ndarray, "n 4"],
        yaw: Float[np.ndarray, "n"],
        gaze: Float[np.ndarray, "n 2"],
        angles: Float[np.ndarray, "joints"],
    ) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n joints"]]:
        """Pelvis (x, y, z, yaw) and angles for which the centre of mass is there, over level soles.

        Args:
            com: Centre of mass on the floor, m.
            left, right: Soles, x, y, z and yaw.
            yaw: Of the pelvis, rad.
            gaze: Angles of the gaze joints, rad.
            angles: At the tick before.
        """
        pelvis, found = np.empty((len(com), 4)), np.empty((len(com), len(angles)))
        kernels.follow(
            self._tree, self._bodies, self._legs, com, left, right, yaw, self.hip_m, self._gaze, gaze,
            angles.copy(), pelvis, found,
        )  # fmt: skip
        return pelvis, found

    def pelvis_over(
        self, com: Float[np.ndarray, "2"], yaw: float, angles: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "4"]:
        """Pelvis that puts the centre of mass over a point with these angles."""
        pelvis = np.empty(4)
        kernels.pelvis_over(self._tree, self._bodies, com, self.hip_m, yaw, angles, pelvis)
        return pelvis

    def reach(
        self,
        pelvis: Float[np.ndarray, "4"],
        left: Float[np.ndarray, "4"],
        right: Float[np.ndarray, "4"],
        angles: Float[np.ndarray, "n"],
    ) -> None:
        """Change the angles of both legs so that the soles are there."""
        kernels.leg_inverse(self._tree, self._legs, 0, pelvis, left, angles)
        kernels.leg_inverse(self._tree, self._legs, 1, pelvis, right, angles)

    def zero_moment_points(
        self, pelvis: Float[np.ndarray, "n 4"], angles: Float[np.ndarray, "n joints"], tick_s: float
    ) -> Float[np.ndarray, "n 2"]:
        """ZMP of the whole robot, link by link, on the plane z = 0."""
        n = len(pelvis)
        com, momentum, spin = np.empty((n, 3)), np.empty((n - 1, 3)), np.empty((n - 1, 3))
        zmp = np.empty((n, 2))
        momentum_kernels.moments(
            self._tree, self._bodies, pelvis, angles, tick_s, com, momentum, spin
        )
        momentum_kernels.zero_moment_points(com, momentum, spin, self.weight_n, tick_s, zmp)
        return zmp

    def standing(self, apart_m: float, gaze: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Angles of standing with parallel feet and the centre of mass over the point between them.

        Args:
            apart_m: Between the soles.
            gaze: Angles of the gaze joints; others are ignored.
        """
        turned = np.tile(gaze[self._gaze], (20, 1))
        left, right = (np.tile([0.0, side * apart_m / 2, 0.0, 0.0], (20, 1)) for side in (1, -1))
        _, found = self.follow(
            np.zeros((20, 2)), left, right, np.zeros(20), turned, self.robot.bent
        )
        return np.asarray(found[-1])


@cache
def tree_of(description: Description) -> Tree:
    """The links of a description; cached.

    Raises:
        InputError: Its URDF lacks masses or torque limits.
    """
    return Tree(jointed(description))


def footprint(sole: Pose3) -> Pose2:
    """A sole projected on the floor."""
    x, y, _ = sole.translation
    ahead = sole.rotation[:, 0]
    return Pose2(x, y, float(np.arctan2(ahead[1], ahead[0])))


def _turned(mass: Mass, turn: Float[np.ndarray, "3 3"]) -> Mass:
    """The mass of the root in the axes of the pelvis."""
    return Mass(mass.kg, turn @ mass.centre, turn @ mass.inertia @ turn.T)
