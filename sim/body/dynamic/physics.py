"""The interface of a physics engine as the dynamic body uses it, and what both engines are told.

`pybullet_engine` and `mujoco_engine` implement it, and `engines` starts them. A slope tilts gravity instead of the
floor: the physics is the same and the floor stays z = 0.

Source: friction from walking trials with PyBullet; the rest is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from perception.primitives.pose import Pose2, Pose3

from ...shapes import Box, Cylinder, Shape, Solid
from .anatomy import Anatomy

ENGINES = ("pybullet", "mujoco")
FRICTION = 1.0  # walking trials: rubber on wood
SPIN_M = 0.01  # ours: rubber soles touch by patches of about a centimetre
THINNEST_M = 0.01  # ours: side of the box that replaces a solid without volume


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot as an engine loads it.

    Args:
        urdf: Text; each link but the base has the name of the joint that carries it.
        centre: Centre of mass of the base, own frame, m.
        axes: Axes in which the text states the inertia of the base, own frame.
        torques: Limits by joint, N m.
        spin_m: Friction of a sole that turns on its spot.
    """

    urdf: str
    centre: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    torques: Mapping[str, float]
    spin_m: float = SPIN_M


@dataclass(frozen=True)
class Stage:
    """What is simulated: a robot on a floor, among objects.

    Args:
        body: Dimensions and masses of the robot; a `Machine` for PyBullet only.
        start: Its pose, world frame.
        stance: Joint angles by name, rad; the others are zero.
        hip_m: Height of the pelvis in that posture, above the floor z = 0.
        tick_s: Period of control.
        up: Unit vector against gravity, world frame.
        bumps: Bumps and steps of the floor, world frame.
        still: Shapes of static objects, world frame: walls, furniture.
        moving: Parts of each moving object about its origin; `Physics.place` moves them.
    """

    body: Anatomy | Machine
    start: Pose2
    stance: dict[str, float]
    hip_m: float
    tick_s: float
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    bumps: Sequence[Box] = ()
    still: Sequence[Shape] = ()
    moving: Sequence[Sequence[Cylinder]] = ()


@runtime_checkable
class Physics(Protocol):
    """A robot on a floor, simulated tick by tick. Joints and links have the names of `anatomy.links` or of the `Machine`."""

    def command_joints(
        self, names: tuple[str, ...], angles: Float[np.ndarray, "n"], rates: Float[np.ndarray, "n"]
    ) -> None:
        """Set joint angles and rates of the servos, rad and rad/s; they hold until the next command."""

    def angles(self, names: tuple[str, ...]) -> Float[np.ndarray, "n"]:
        """Current joint angles, rad."""

    def step(self) -> None:
        """Simulate one tick."""

    def pelvis(self) -> Pose3:
        """Frame of the base in the world."""

    def imu_reading(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Ideal inertial sensor at the base's centre of mass over the last tick, trunk axes.

        Returns:
            Mean angular velocity, rad/s, and mean specific force, m/s^2.
        """

    def link(self, name: str) -> Pose3:
        """Frame of a link in the world, exact after a tick."""

    def sole_force(self, name: str) -> float:
        """Normal force of floor and bumps on a sole, N.

        Contact with furniture does not count: a toe that hits an object has not landed.
        """

    def push(self, force: Float[np.ndarray, "3"]) -> None:
        """Apply a force at the base's centre of mass during the coming tick, world axes, N."""

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m; they need no support."""

    def close(self) -> None:
        """Release the engine; a second call does nothing."""


def convex(solid: Solid) -> Box | Float[np.ndarray, "n 3"]:
    """Corners of the convex hull of a solid, world frame, m; its bounding box if it has no volume."""
    try:
        corners: Float[np.ndarray, "n 3"] = solid.vertices[ConvexHull(solid.vertices).vertices]
    except QhullError:
        x, y, z = np.maximum(np.ptp(solid.vertices, axis=0), THINNEST_M).tolist()
        return Box(solid.centre, (x, y, z))
    return corners
