"""Faults of what is no picture: frames that get lost, the clock, step odometry, feet, gyro."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from perception.primitives.frame import Frame
from perception.primitives.pose import Pose2

TWIST_RAD = math.radians(4.0)  # ours: a foot that slides also turns the body, per step


class Dropped:
    """A share of the frames is lost whole, with their odometry."""

    def __init__(self, share: float, rng: np.random.Generator) -> None:
        self._share, self._rng = share, rng

    def apply(self, frame: Frame, active: bool) -> Frame | None:
        """The frame, or None."""
        return None if active and self._rng.random() < self._share else frame


class ClockJump:
    """The clock is set: the stamps jump when the fault begins, and back when it ends."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The frame with its stamp by the clock that was set."""
        return replace(frame, stamp_s=frame.stamp_s + self._seconds) if active else frame


class ClockDrift:
    """The clock runs too fast by a share of the time while the fault lasts; what it gained stays."""

    def __init__(self, share: float) -> None:
        self._share = share
        self._gained_s = 0.0
        self._last_s: float | None = None

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The frame with its stamp by the drifting clock."""
        if active and self._last_s is not None:
            self._gained_s += self._share * (frame.stamp_s - self._last_s)
        self._last_s = frame.stamp_s
        return replace(frame, stamp_s=frame.stamp_s + self._gained_s)


class LostOdometry:
    """No step odometry; pictures and gyro go on."""

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The frame without odometry."""
        return replace(frame, odometry=None) if active else frame


class SlippingFoot:
    """The stance foot slides: of the motion by the joints the body makes only a part, and it turns.

    The body of the simulation walks as before, and the joints report more than it walked: the same for the stack.
    """

    def __init__(self, share: float) -> None:
        self._share = share

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The frame with the odometry of joints whose foot slid."""
        odometry = frame.odometry
        if not active or odometry is None:
            return frame
        made, more = odometry.motion, 1.0 / (1.0 - self._share)
        turn = made.yaw + TWIST_RAD * odometry.steps
        motion = Pose2(more * made.x, more * made.y, turn)
        return replace(frame, odometry=replace(odometry, motion=motion))


class GyroBias:
    """The gyro's bias about the vertical axis makes a step."""

    def __init__(self, degrees_per_s: float) -> None:
        self._bias = np.array([0.0, 0.0, math.radians(degrees_per_s)])

    def apply(self, frame: Frame, active: bool) -> Frame:
        """The frame with the gyro off by the step."""
        if not active or frame.imu is None:
            return frame
        rate = frame.imu.angular_velocity + self._bias
        return replace(frame, imu=replace(frame.imu, angular_velocity=rate))
