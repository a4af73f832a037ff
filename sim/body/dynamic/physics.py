"""PyBullet model of the robot: servos, sole force sensors, an inertial sensor, and a floor with bumps.

A slope tilts gravity instead of the floor: the physics is the same and the floor stays z = 0. Servos are PyBullet's
position constraints, whose gain acts once per tick. Each body has its own client; close it.

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
from scipy.spatial import ConvexHull, QhullError

from perception.primitives.pose import Pose2, Pose3, times

from ... import bullet
from ...rendering.renderer import silenced_output
from ...shapes import Box, Cylinder, Shape, Solid
from ..gait import GRAVITY_MPS2
from .anatomy import Anatomy, links
from .urdf import robot_urdf, static_urdf

POSITION_GAIN = 0.3  # walking trials, per tick: with 5 sub-steps per tick the robot falls
FRICTION = 1.0  # walking trials: rubber on wood
THINNEST_M = 0.01  # ours: side of the box that replaces a solid without volume
SPIN_M = 0.01  # ours: rubber soles touch by patches of about a centimetre
ANCHOR = 0.05  # ours: share of a creep that a resting contact undoes per tick; 0.2 falls more often


class Physics:
    """A robot on a floor."""

    def __init__(
        self,
        body: Anatomy,
        start: Pose2,
        stance: dict[str, float],
        hip_m: float,
        tick_s: float,
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
    ) -> None:
        """Place the robot.

        Args:
            body: Its dimensions.
            start: Its pose, world frame.
            stance: Joint angles by name; the others are zero.
            hip_m: Height of the pelvis in that posture.
            tick_s: Period of control and physics.
            up: Unit vector against gravity, world frame.
        """
        with silenced_output():
            pybullet = bullet.library()
            self._bullet: Any = pybullet
            self.client = pybullet.connect(pybullet.DIRECT)
        b, c = pybullet, self.client
        self.up = np.array(up)
        b.setGravity(*(-GRAVITY_MPS2 * self.up), physicsClientId=c)
        b.setPhysicsEngineParameter(
            fixedTimeStep=tick_s,
            numSubSteps=0,
            numSolverIterations=50,
            deterministicOverlappingPairs=1,
            frictionERP=ANCHOR,
            physicsClientId=c,
        )
        self._tick_s = tick_s
        plane = b.createCollisionShape(b.GEOM_PLANE, physicsClientId=c)
        floor = b.createMultiBody(0, plane, physicsClientId=c)
        b.changeDynamics(floor, -1, lateralFriction=FRICTION, physicsClientId=c)
        self._ground = {int(floor)}
        self._moving: list[int] = []
        place = [start.x, start.y, hip_m]
        turn = [0.0, 0.0, math.sin(start.yaw / 2), math.cos(start.yaw / 2)]
        self.robot = self._load(robot_urdf(body), place, turn, fixed=False)
        self.index = {
            b.getJointInfo(self.robot, k, physicsClientId=c)[1].decode(): k
            for k in range(b.getNumJoints(self.robot, physicsClientId=c))
        }
        self._weight = links(body)[0].centre_of_mass
        for link in range(-1, len(self.index)):
            b.changeDynamics(
                self.robot,
                link,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                lateralFriction=FRICTION,
                spinningFriction=SPIN_M,
                frictionAnchor=1,
                physicsClientId=c,
            )
        for name, k in self.index.items():
            b.resetJointState(self.robot, k, stance.get(name, 0.0), physicsClientId=c)
        self._torque = body.servo_nm
        self._commanded: dict[tuple[str, ...], list[int]] = {}
        names = tuple(self.index)
        angles = np.array([stance.get(name, 0.0) for name in names])
        self.command_joints(names, angles, np.zeros(len(names)))
        self._velocity = np.zeros(3)

    def command_joints(
        self, names: tuple[str, ...], angles: Float[np.ndarray, "n"], rates: Float[np.ndarray, "n"]
    ) -> None:
        """Set joint angles and rates of the servos, rad and rad/s."""
        found = self._numbers(names)
        b, count = self._bullet, len(found)
        b.setJointMotorControlArray(
            self.robot,
            found,
            b.POSITION_CONTROL,
            targetPositions=angles.tolist(),
            targetVelocities=rates.tolist(),
            forces=[self._torque] * count,
            positionGains=[POSITION_GAIN] * count,
            velocityGains=[1.0] * count,
            physicsClientId=self.client,
        )

    def angles(self, names: tuple[str, ...]) -> Float[np.ndarray, "n"]:
        """Current joint angles, rad."""
        states = self._bullet.getJointStates(
            self.robot, self._numbers(names), physicsClientId=self.client
        )
        return np.array([state[0] for state in states])

    def step(self) -> None:
        """Simulate one tick."""
        self._velocity = np.array(self._motion()[0])
        self._bullet.stepSimulation(physicsClientId=self.client)

    def pelvis(self) -> Pose3:
        """Frame of the base in the world; PyBullet reports its centre of mass."""
        place, turn = self._bullet.getBasePositionAndOrientation(
            self.robot, physicsClientId=self.client
        )
        x, y, z, w = turn
        rotation = Pose3((0.0, 0.0, 0.0), (x, y, z, w)).rotation
        return Pose3.from_rotation(rotation, np.array(place) - times(rotation, self._weight))

    def imu_reading(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Ideal inertial sensor at the base's centre of mass over the last tick, trunk axes.

        Returns:
            Angular velocity, rad/s, and specific force, m/s^2.
        """
        velocity, rate = self._motion()
        _, turn = self._bullet.getBasePositionAndOrientation(
            self.robot, physicsClientId=self.client
        )
        R = np.array(self._bullet.getMatrixFromQuaternion(turn)).reshape(3, 3)
        force = (np.array(velocity) - self._velocity) / self._tick_s + GRAVITY_MPS2 * self.up
        return times(R.T, np.array(rate)), times(R.T, force)

    def link(self, name: str) -> Pose3:
        """Frame of a link in the world, exact after a tick."""
        state = self._bullet.getLinkState(
            self.robot, self.index[name], computeForwardKinematics=1, physicsClientId=self.client
        )
        (x, y, z), (qx, qy, qz, qw) = state[4], state[5]
        return Pose3((x, y, z), (qx, qy, qz, qw))

    def sole_force(self, name: str) -> float:
        """Force of floor and bumps on a sole, N.

        Contact with furniture does not count: a toe that hits an object has not landed.
        """
        touched = self._bullet.getContactPoints(
            bodyA=self.robot, linkIndexA=self.index[name], physicsClientId=self.client
        )
        return float(sum(point[9] for point in touched if point[2] in self._ground))

    def push(self, force: Float[np.ndarray, "3"]) -> None:
        """Apply a force at the pelvis during the coming tick, world axes, N."""
        at, _ = self._bullet.getBasePositionAndOrientation(self.robot, physicsClientId=self.client)
        self._bullet.applyExternalForce(
            self.robot,
            -1,
            force.tolist(),
            at,
            self._bullet.WORLD_FRAME,
            physicsClientId=self.client,
        )

    def add_objects(
        self, bumps: Sequence[Box], still: Sequence[Shape], moving: Sequence[Sequence[Cylinder]]
    ) -> None:
        """Add solid objects.

        Args:
            bumps: Bumps of the floor, world frame.
            still: Shapes of static objects, world frame: walls, furniture.
            moving: Parts of each moving object about its origin; `place` moves them.
        """
        self._moving = [
            self._load(static_urdf(parts), [0.0, 0.0, -9.0], [0.0, 0.0, 0.0, 1.0], fixed=True)
            for parts in moving
        ]
        rest = [0.0, 0.0, 0.0]
        bodies = [self._load(static_urdf(bumps), rest, [*rest, 1.0], fixed=True)] if bumps else []
        self._ground |= set(bodies)
        plain = [shape for shape in still if not isinstance(shape, Solid)]
        bodies += [self._load(static_urdf(plain), rest, [*rest, 1.0], fixed=True)] if plain else []
        bodies += [self._hull(shape) for shape in still if isinstance(shape, Solid)]
        for body in bodies + self._moving:
            self._bullet.changeDynamics(
                body, -1, lateralFriction=FRICTION, physicsClientId=self.client
            )

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m; they need no support."""
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._bullet.resetBasePositionAndOrientation(
                body, [x, y, 0.0], [0.0, 0.0, 0.0, 1.0], physicsClientId=self.client
            )

    def close(self) -> None:
        """Close the client; a second call does nothing."""
        if self.client >= 0:
            self._bullet.disconnect(physicsClientId=self.client)
            self.client = -1

    def _hull(self, solid: Solid) -> int:
        """Add the convex hull of a solid."""
        b, c = self._bullet, self.client
        try:
            points = solid.vertices[ConvexHull(solid.vertices).vertices]
        except QhullError:  # no volume: use the bounding box
            half = np.maximum(np.ptp(solid.vertices, axis=0), THINNEST_M) / 2
            box = b.createCollisionShape(b.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=c)
            return int(b.createMultiBody(0, box, basePosition=solid.centre, physicsClientId=c))
        hull = b.createCollisionShape(b.GEOM_MESH, vertices=points.tolist(), physicsClientId=c)
        return int(b.createMultiBody(0, hull, physicsClientId=c))

    def _motion(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        found = self._bullet.getBaseVelocity(self.robot, physicsClientId=self.client)
        return found[0], found[1]

    def _numbers(self, names: tuple[str, ...]) -> list[int]:
        if names not in self._commanded:
            self._commanded[names] = [self.index[name] for name in names]
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
