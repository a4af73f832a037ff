"""What the bodies in a physics engine have in common: footsteps by the tick, odometry from encoders, the truth of the plan.

A tick of the planned gait may take several of the engine, while a foot that lands late is awaited.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from perception.primitives.frame import Imu
from perception.primitives.pose import Pose2, Pose3
from planning.commands import WalkCommand

from ...world import World
from ..body import Advance
from ..gait import Step
from .odometry import Footprints, FootToFootOdometry
from .physics import Physics
from .sensing import TrunkSensor

SETTLE_S = 1.0  # ours: standing before the start


class ServoBody(ABC):
    """Members of `Body`, documented there, that need no more than the plan, the engine and footprints by the encoders."""

    physics: Physics
    fallen: bool
    _world: World
    _sensor: TrunkSensor
    _tick_s: float
    _ticks: int  # of the engine, since the start
    _tick: int  # of the plan, in this step
    _step: Step
    _command: WalkCommand | None
    _odometry: FootToFootOdometry

    @property
    @abstractmethod
    def _footprints(self) -> Footprints:
        """Left and right foot as the robot estimates them, from a level pelvis."""

    @abstractmethod
    def _begin_step(self) -> None:
        """Plan the step that was commanded."""

    @abstractmethod
    def _advance_tick(self) -> None:
        """Plan, balance, servos, physics, sensors."""

    @abstractmethod
    def true_trunk(self) -> Pose3:
        """True pelvis in the true body frame."""

    @property
    def _body_m(self) -> float:
        """Height of the body frame by the plan, above the start, m."""
        return 0.0

    def _settle(self) -> None:
        """Stand for `SETTLE_S`, then begin the first step."""
        self._command = None
        self.fallen = False
        self._ticks = -round(SETTLE_S / self._tick_s)
        self._tick = 0
        self._odometry = FootToFootOdometry(self._footprints)
        self._begin_step()
        while self._ticks < 0:
            self.start_due_step()
            self._advance_tick()
        self._odometry = FootToFootOdometry(self._footprints)
        self._begin_step()

    def walk(self, command: WalkCommand) -> None:
        self._command = command

    def start_due_step(self) -> None:
        if self._tick == self._step.ticks:
            self._begin_step()

    @property
    def ticks_left(self) -> int:
        return self._step.ticks - self._tick

    @property
    def ticks(self) -> int:
        return self._ticks

    def advance(self, ticks: int) -> Advance:
        """Simulate some ticks of the planned gait; waiting for a late landing adds time."""
        before, steps, began = self._odometry.body(self._footprints), 0.0, self._ticks
        low_m = self._body_m
        moving_bodies = self._world.body_states()
        while ticks > 0:
            self.start_due_step()
            late = (self._ticks + 1 - began) * self._tick_s
            self.physics.place([(x + vx * late, y + vy * late) for x, y, vx, vy in moving_bodies])
            tick, done = self._tick, self._done
            self._advance_tick()
            ticks -= self._tick - tick
            steps += self._done - done
        motion = before.inverse() @ self._odometry.body(self._footprints)
        return Advance(motion, steps, (self._ticks - began) * self._tick_s, self._body_m - low_m)

    def measure_imu(self) -> Imu:
        """Means since the previous call, in level axes of the sensor's own attitude estimate."""
        return self._sensor.measure()

    def close(self) -> None:
        self.physics.close()

    @property
    def swinging(self) -> int:
        """Foot in the air by plan, +1 left, -1 right, 0 none."""
        in_air = self._step.stepping and self._tick > self._step.double_support_ticks
        return self._step.swing if in_air else 0

    def feet_from_encoders(self) -> tuple[tuple[Pose2, bool], tuple[Pose2, bool]]:
        """Left and right foot in the body frame as the robot estimates them; lifted by plan."""
        left, right = self._footprints
        pelvis = self._odometry.pelvis((left, right))
        return (pelvis @ left, self.swinging > 0), (pelvis @ right, self.swinging < 0)

    def steady_trunk(self) -> Pose3:
        """The same as the true trunk, which moves continuously."""
        return self.true_trunk()

    @property
    def planned_pose(self) -> Pose2:
        """Body pose in the gait's own dead reckoning: the commanded motion."""
        x, y, yaw = (float(v) for v in self._step.body[max(self._tick - 1, 0)])
        return Pose2(x, y, yaw)

    @property
    def _done(self) -> float:
        """Planned share of the step's motion completed by now."""
        return float(self._step.progress[self._tick - 1]) if self._tick > 0 else 0.0

    def _shift_weight(self, tick: int) -> None:
        """Change the stance foot of the odometry half-way through the double support."""
        step = self._step
        shifted = step.stepping and 2 * tick >= step.double_support_ticks
        if shifted and self._odometry.standing != -step.swing:
            self._odometry.set_stance(self._footprints, -step.swing)
