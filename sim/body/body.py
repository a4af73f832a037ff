"""The interface of a simulated body: what the robot's sensors and the truth ask of it.

`kinematic`, `dynamic.walker` and `humanoid.walker` implement it. A body owns its inertial sensor and moves the head along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from perception.primitives.frame import Imu
from perception.primitives.pose import Pose2, Pose3
from planning.commands import WalkCommand


@dataclass(frozen=True)
class Advance:
    """Motion between two instants, by the robot's own odometry.

    Args:
        motion: Body pose now in the previous body frame.
        steps: Share of a footstep made.
        seconds: Time passed.
        rise_m: Height of the body frame now above the previous one.
    """

    motion: Pose2
    steps: float
    seconds: float
    rise_m: float = 0.0


@runtime_checkable
class Body(Protocol):
    """Walks by footsteps from a start pose; advanced in whole ticks of the gait."""

    @property
    def ticks(self) -> int:
        """Ticks since the start."""

    @property
    def ticks_left(self) -> int:
        """Ticks to the end of the step, which is the end of its single support."""

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen, by its own inertial sensor."""

    @property
    def up(self) -> tuple[float, float, float]:
        """Unit vector against gravity, world frame."""

    @property
    def true_pose(self) -> Pose2:
        """True body frame in the world: midway between the feet, heading of the pelvis."""

    @property
    def true_height_m(self) -> float:
        """Height of the true body frame above the floor, midway between the feet; 0 on flat ground."""

    @property
    def feet_body(self) -> tuple[tuple[Pose2, float], tuple[Pose2, float]]:
        """Left and right foot in the true body frame, each with its height above that frame, m."""

    def walk(self, command: WalkCommand) -> None:
        """Set the command of the next step; the last one given counts, without one the robot stands."""

    def start_due_step(self) -> None:
        """Start the next step if the current one is over."""

    def advance(self, ticks: int) -> Advance:
        """Simulate some ticks of the planned gait, at least 1; they may reach into the following steps."""

    def measure_imu(self) -> Imu:
        """Mean angular velocity and specific force since the previous call, body axes."""

    def trunk_from_encoders(self) -> Pose3:
        """Pelvis in the body frame as the joint encoders give it, lowered by its height while walking."""

    def feet_from_encoders(self) -> tuple[tuple[Pose2, bool], tuple[Pose2, bool]]:
        """Left and right foot in the body frame as the joint encoders give them, each with whether it is lifted."""

    def foot_heights(self) -> tuple[float, float]:
        """Heights of left and right sole in the body frame by the joint encoders, m."""

    def true_trunk(self) -> Pose3:
        """True pelvis in the true body frame, lowered by its height while walking."""

    def steady_trunk(self) -> Pose3:
        """The same without sway that is drawn anew at every instant: cameras interpolate between these."""

    def close(self) -> None:
        """Release the physics engine, if there is one; a second call does nothing."""


def true_frame(body: Body) -> Pose3:
    """The true body frame in the world, with its height."""
    pose = body.true_pose.lifted()
    x, y, _ = pose.translation
    return replace(pose, translation=(x, y, body.true_height_m))
