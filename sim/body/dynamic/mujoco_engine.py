"""The robot in MuJoCo: another engine for the same body, so that a result does not rest on PyBullet's contacts.

A servo is a stiff spring and damper with the torque limit and the rotor of a real one, where PyBullet's is a constraint
on the joint's velocity. Contacts are soft, friction cones are elliptic, and a sole resists turning on its spot. A tick
has several steps of integration.

Source: Todorov, Erez, Tassa, "MuJoCo: A physics engine for model-based control" (IROS 2012); gains and contacts: ours,
see `mjcf`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose3, times

from ..pendulum import GRAVITY_MPS2
from .anatomy import Anatomy, links
from .mjcf import DAMPING_S, STIFFNESS, mjcf
from .physics import Stage

STEPS = 5  # ours: of integration per tick


class MujocoPhysics:
    """A robot on a floor in MuJoCo; the members of `Physics` are documented there."""

    def __init__(self, stage: Stage) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        model = self.model = mujoco.MjModel.from_xml_string(mjcf(stage, stage.tick_s / STEPS))
        data = self.data = mujoco.MjData(model)
        self._tick_s, self._up = stage.tick_s, np.array(stage.up)
        assert isinstance(stage.body, Anatomy)
        found = links(stage.body)
        self._base, self._weight = model.body(found[0].name).id, found[0].centre_of_mass
        self._shapes = {link.name: model.geom(link.name).id for link in found if link.solid}
        ground = ("floor", "bump")
        self._ground = np.array([model.geom(k).name.startswith(ground) for k in range(model.ngeom)])
        half = stage.start.yaw / 2
        data.qpos[:3] = stage.start.x, stage.start.y, stage.hip_m
        data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        self._known: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
        names = tuple(link.name for link in found[1:])
        angles = np.array([stage.stance.get(name, 0.0) for name in names])
        data.qpos[self._numbers(names)[0]] = angles
        self.command_joints(names, angles, np.zeros(len(names)))
        self._velocity, self._turned = np.zeros(3), data.qpos[3:7].copy()
        mujoco.mj_forward(model, data)

    def command_joints(
        self, names: tuple[str, ...], angles: Float[np.ndarray, "n"], rates: Float[np.ndarray, "n"]
    ) -> None:
        # a position servo of MuJoCo damps towards rest; the angle is shifted so that it damps towards the rate
        self.data.ctrl[self._numbers(names)[1]] = angles + DAMPING_S / STIFFNESS * rates

    def angles(self, names: tuple[str, ...]) -> Float[np.ndarray, "n"]:
        return np.array(self.data.qpos[self._numbers(names)[0]])

    def step(self) -> None:
        self._velocity, self._turned = self._base_velocity(), self.data.qpos[3:7].copy()
        self._mujoco.mj_step(self.model, self.data, STEPS)
        self._mujoco.mj_kinematics(self.model, self.data)  # frames after the last step, not before
        self.data.xfrc_applied[self._base] = 0.0

    def pelvis(self) -> Pose3:
        x, y, z, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        return Pose3((x, y, z), (qx, qy, qz, qw))

    def imu_reading(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        acceleration = (self._base_velocity() - self._velocity) / self._tick_s
        R, turn = self.pelvis().rotation, np.zeros(3)
        # means over the tick: the rate at its end would miss what its steps turn there and back
        self._mujoco.mju_subQuat(turn, self.data.qpos[3:7], self._turned)
        return turn / self._tick_s, times(R.T, acceleration + GRAVITY_MPS2 * self._up)

    def link(self, name: str) -> Pose3:
        body = self.data.body(name)
        x, y, z = body.xpos.tolist()
        qw, qx, qy, qz = body.xquat.tolist()
        return Pose3((x, y, z), (qx, qy, qz, qw))

    def sole_force(self, name: str) -> float:
        pairs, sole = self.data.contact.geom, self._shapes[name]
        touches = (pairs == sole).any(axis=1) & self._ground[pairs].any(axis=1)
        force, total = np.zeros(6), 0.0
        for k in np.flatnonzero(touches).tolist():
            self._mujoco.mj_contactForce(self.model, self.data, k, force)
            total += float(force[0])
        return total

    def push(self, force: Float[np.ndarray, "3"]) -> None:
        self.data.xfrc_applied[self._base, :3] = force

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        for k, (x, y) in enumerate(where):
            self.data.mocap_pos[k] = x, y, 0.0

    def close(self) -> None:
        """Nothing to release: MuJoCo's arrays go with this object."""

    def _base_velocity(self) -> Float[np.ndarray, "3"]:
        """Velocity of the base's centre of mass, world axes; MuJoCo's is that of the origin, and turns in own axes."""
        lever = np.cross(self.data.qvel[3:6], self._weight)
        return np.asarray(self.data.qvel[:3] + times(self.pelvis().rotation, lever))

    def _numbers(self, names: tuple[str, ...]) -> tuple[list[int], list[int]]:
        """Places of joints in the state, and of their servos in the commands."""
        if names not in self._known:
            model = self.model
            places = [int(model.joint(name).qposadr[0]) for name in names]
            self._known[names] = places, [int(model.actuator(name).id) for name in names]
        return self._known[names]
