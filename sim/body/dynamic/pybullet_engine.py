"""The robot in PyBullet: servos, sole force sensors, an inertial sensor, and a floor with bumps.

Servos are PyBullet's position constraints, whose gain acts once per tick. Each body has its own client; close it.

Friction by velocities alone lets a shaking body creep: a body on the edges of its soles turned by 40 degrees in 20
seconds. Contacts are therefore anchored where they came to rest (0.2 degrees).

Source: gains from walking trials; control period 5 ms: seed 001.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives.pose import Pose3, times

from ... import bullet
from ...rendering.renderer import silenced_output
from ...shapes import Box, Solid
from ..pendulum import GRAVITY_MPS2
from .anatomy import Anatomy, links
from .physics import FRICTION, Machine, Stage, convex
from .urdf import robot_urdf, static_urdf

POSITION_GAIN = 0.3  # walking trials, per tick: with 5 sub-steps per tick the robot falls
ANCHOR = 0.05  # ours: share of a creep that a resting contact undoes per tick; 0.2 falls more often


class PyBulletPhysics:
    """A robot on a floor in PyBullet; the members of `Physics` are documented there."""

    def __init__(self, stage: Stage) -> None:
        with silenced_output():
            pybullet = bullet.library()
            self._bullet: Any = pybullet
            self.client = bullet.connect(pybullet)
        b, c = pybullet, self.client
        self.up = np.array(stage.up)
        b.setGravity(*(-GRAVITY_MPS2 * self.up), physicsClientId=c)
        b.setPhysicsEngineParameter(
            fixedTimeStep=stage.tick_s,
            numSubSteps=0,
            numSolverIterations=50,
            deterministicOverlappingPairs=1,
            frictionERP=ANCHOR,
            physicsClientId=c,
        )
        self._tick_s = stage.tick_s
        plane = b.createCollisionShape(b.GEOM_PLANE, physicsClientId=c)
        floor = b.createMultiBody(0, plane, physicsClientId=c)
        b.changeDynamics(floor, -1, lateralFriction=FRICTION, physicsClientId=c)
        self._ground = {int(floor)}
        body, start, stance = _machine(stage.body), stage.start, stage.stance
        place = [start.x, start.y, stage.hip_m]
        turn = [0.0, 0.0, math.sin(start.yaw / 2), math.cos(start.yaw / 2)]
        self.robot = self._load(body.urdf, place, turn, fixed=False)
        self.index = {
            b.getJointInfo(self.robot, k, physicsClientId=c)[1].decode(): k
            for k in range(b.getNumJoints(self.robot, physicsClientId=c))
        }
        self._weight, self._axes = body.centre, body.axes
        self._turned = not np.array_equal(body.axes, np.eye(3))
        for link in range(-1, len(self.index)):
            b.changeDynamics(
                self.robot,
                link,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                lateralFriction=FRICTION,
                spinningFriction=body.spin_m,
                frictionAnchor=1,
                physicsClientId=c,
            )
        for name, k in self.index.items():
            b.resetJointState(self.robot, k, stance.get(name, 0.0), physicsClientId=c)
        self._torques = body.torques
        self._commanded: dict[tuple[str, ...], tuple[list[int], list[float]]] = {}
        names = tuple(self.index)
        angles = np.array([stance.get(name, 0.0) for name in names])
        self.command_joints(names, angles, np.zeros(len(names)))
        self._velocity = np.zeros(3)
        self._moving = self._add_objects(stage)

    def command_joints(
        self, names: tuple[str, ...], angles: Float[np.ndarray, "n"], rates: Float[np.ndarray, "n"]
    ) -> None:
        found, torques = self._numbers(names)
        b, count = self._bullet, len(found)
        b.setJointMotorControlArray(
            self.robot,
            found,
            b.POSITION_CONTROL,
            targetPositions=angles.tolist(),
            targetVelocities=rates.tolist(),
            forces=torques,
            positionGains=[POSITION_GAIN] * count,
            velocityGains=[1.0] * count,
            physicsClientId=self.client,
        )

    def angles(self, names: tuple[str, ...]) -> Float[np.ndarray, "n"]:
        states = self._bullet.getJointStates(
            self.robot, self._numbers(names)[0], physicsClientId=self.client
        )
        return np.array([state[0] for state in states])

    def step(self) -> None:
        self._velocity = np.array(self._motion()[0])
        self._bullet.stepSimulation(physicsClientId=self.client)

    def pelvis(self) -> Pose3:
        """Frame of the base in the world; PyBullet reports its centre of mass."""
        place, turn = self._bullet.getBasePositionAndOrientation(
            self.robot, physicsClientId=self.client
        )
        x, y, z, w = turn
        rotation = Pose3((0.0, 0.0, 0.0), (x, y, z, w)).rotation
        if self._turned:
            rotation = times(rotation, self._axes.T)
        return Pose3.from_rotation(rotation, np.array(place) - times(rotation, self._weight))

    def imu_reading(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        velocity, rate = self._motion()
        _, turn = self._bullet.getBasePositionAndOrientation(
            self.robot, physicsClientId=self.client
        )
        R = np.array(self._bullet.getMatrixFromQuaternion(turn)).reshape(3, 3)
        if self._turned:
            R = times(R, self._axes.T)
        force = (np.array(velocity) - self._velocity) / self._tick_s + GRAVITY_MPS2 * self.up
        return times(R.T, np.array(rate)), times(R.T, force)

    def link(self, name: str) -> Pose3:
        state = self._bullet.getLinkState(
            self.robot, self.index[name], computeForwardKinematics=1, physicsClientId=self.client
        )
        (x, y, z), (qx, qy, qz, qw) = state[4], state[5]
        return Pose3((x, y, z), (qx, qy, qz, qw))

    def sole_force(self, name: str) -> float:
        touched = self._bullet.getContactPoints(
            bodyA=self.robot, linkIndexA=self.index[name], physicsClientId=self.client
        )
        return float(sum(point[9] for point in touched if point[2] in self._ground))

    def push(self, force: Float[np.ndarray, "3"]) -> None:
        at, _ = self._bullet.getBasePositionAndOrientation(self.robot, physicsClientId=self.client)
        self._bullet.applyExternalForce(
            self.robot,
            -1,
            force.tolist(),
            at,
            self._bullet.WORLD_FRAME,
            physicsClientId=self.client,
        )

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._bullet.resetBasePositionAndOrientation(
                body, [x, y, 0.0], [0.0, 0.0, 0.0, 1.0], physicsClientId=self.client
            )

    def close(self) -> None:
        if self.client >= 0:
            self._bullet.disconnect(physicsClientId=self.client)
            self.client = -1

    def _add_objects(self, stage: Stage) -> list[int]:
        """Add bumps and objects; the moving ones are returned, out of reach below the floor."""
        moving = [
            self._load(static_urdf(parts), [0.0, 0.0, -9.0], [0.0, 0.0, 0.0, 1.0], fixed=True)
            for parts in stage.moving
        ]
        rest = [0.0, 0.0, 0.0]
        bodies = []
        if stage.bumps:
            bodies.append(self._load(static_urdf(stage.bumps), rest, [*rest, 1.0], fixed=True))
        self._ground |= set(bodies)
        plain = [shape for shape in stage.still if not isinstance(shape, Solid)]
        if plain:
            bodies.append(self._load(static_urdf(plain), rest, [*rest, 1.0], fixed=True))
        bodies += [self._hull(shape) for shape in stage.still if isinstance(shape, Solid)]
        for body in bodies + moving:
            self._bullet.changeDynamics(
                body, -1, lateralFriction=FRICTION, physicsClientId=self.client
            )
        return moving

    def _hull(self, solid: Solid) -> int:
        b, c, part = self._bullet, self.client, convex(solid)
        if isinstance(part, Box):
            half = [size / 2 for size in part.size]
            box = b.createCollisionShape(b.GEOM_BOX, halfExtents=half, physicsClientId=c)
            return int(b.createMultiBody(0, box, basePosition=part.centre, physicsClientId=c))
        hull = b.createCollisionShape(b.GEOM_MESH, vertices=part.tolist(), physicsClientId=c)
        return int(b.createMultiBody(0, hull, physicsClientId=c))

    def _motion(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        found = self._bullet.getBaseVelocity(self.robot, physicsClientId=self.client)
        return found[0], found[1]

    def _numbers(self, names: tuple[str, ...]) -> tuple[list[int], list[float]]:
        """Numbers and torque limits of joints."""
        if names not in self._commanded:
            self._commanded[names] = (
                [self.index[name] for name in names],
                [self._torques[name] for name in names],
            )
        return self._commanded[names]

    def _load(self, text: str, place: list[float], turn: list[float], fixed: bool) -> int:
        b = self._bullet
        with tempfile.TemporaryDirectory(prefix="surefoot-") as folder, silenced_output():
            path = Path(folder) / "body.urdf"
            path.write_text(text)
            return int(
                b.loadURDF(
                    str(path),
                    place,
                    turn,
                    useFixedBase=fixed,
                    flags=b.URDF_USE_INERTIA_FROM_FILE | b.URDF_MAINTAIN_LINK_ORDER
                    if not fixed
                    else 0,
                    physicsClientId=self.client,
                )
            )


def _machine(body: Anatomy | Machine) -> Machine:
    """Our own robot as the engine loads it."""
    if isinstance(body, Machine):
        return body
    found = links(body)
    torques = {link.name: body.servo_nm for link in found[1:]}
    return Machine(robot_urdf(body), found[0].centre_of_mass, np.eye(3), torques)
