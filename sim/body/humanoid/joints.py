"""Angles of all joints of a body in a physics engine, as `sim.body.jointed.JointedLegs` gives them for a kinematic one."""

from __future__ import annotations

import numpy as np

from perception.primitives.kinematics import link_poses
from perception.primitives.own_body import JointReading
from perception.primitives.pose import Pose3

from .walker import HumanoidBody


class EngineJoints:
    """What the encoders say, and where the links are."""

    def __init__(self, body: HumanoidBody) -> None:
        self._body = body
        self._robot = body.tree.robot
        # from the pelvis, which is turned so that x is ahead, to the root of the URDF
        self._T_pelvis_base = Pose3.from_rotation(self._robot.T_trunk_base.rotation, np.zeros(3))

    def reading(self) -> JointReading:
        """All angles by the encoders at this instant."""
        base = self._body.trunk_from_encoders() @ self._robot.T_trunk_base
        return JointReading(base, tuple(self._body.encoders.tolist()))

    def true_links(self) -> list[Pose3]:
        """True pose of every link in the world at this instant, base first."""
        base = self._body.physics.pelvis() @ self._T_pelvis_base
        poses = link_poses(self._robot.tree, self._body.joints)
        return [base @ Pose3.from_matrix(T) for T in poses]
