"""Head: pan and tilt joints with a speed limit, quantised encoders and joint offsets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3, head_rotation
from planning.commands import GazeCommand

from ..ranges import check_ranges


@dataclass(frozen=True)
class HeadConfig:
    """Geometry and motion of the head.

    Args:
        hip_m: Height of the pelvis while walking.
        neck_m: Pan joint above the pelvis.
        tilt_m: Tilt joint above the pan joint.
        pan_deg: Range to each side.
        tilt_deg: (highest, lowest) tilt, down positive.
        speed_radps: Speed limit of both joints.
        encoder_deg: Resolution of the encoders.
        offset_deg: Standard deviation of each joint's offset, drawn once per run.
    """

    hip_m: float = 0.2055  # DARwIn-OP walking; the camera is then at 0.383 m at a tilt of 30 deg
    neck_m: float = 0.150  # DARwIn-OP
    tilt_m: float = 0.015  # DARwIn-OP
    pan_deg: float = 90.0  # ours, joints of seed 001
    tilt_deg: tuple[float, float] = (0.0, 60.0)  # ours, joints of seed 001
    speed_radps: float = 4.0  # ours: MX-28 servo under load
    encoder_deg: float = 0.088  # MX-28: 4096 counts per turn
    offset_deg: float = 0.3  # measured on walkers of this size

    def __post_init__(self) -> None:
        if not self.speed_radps > 0.0:
            raise ConfigError(f"head: speed_radps={self.speed_radps} must be positive")
        check_ranges(
            "head",
            self,
            hip_m=(0.02, 3.0),
            neck_m=(0.0, 2.0),
            tilt_m=(0.0, 1.0),
            pan_deg=(0.0, 180.0),
            tilt_deg=(-90.0, 90.0),
            encoder_deg=(0.0, 10.0),
            offset_deg=(0.0, 10.0),
        )
        if not self.tilt_deg[0] <= self.tilt_deg[1]:
            raise ConfigError(f"head: tilt_deg={self.tilt_deg} must be (highest, lowest)")


@runtime_checkable
class MovingHead(Protocol):
    """What a kinematic body asks of the joints above it."""

    def advance(self, seconds: float) -> None:
        """Move the joints towards the gaze."""


class Head:
    """Pan and tilt joints that move towards the last gaze command."""

    def __init__(self, config: HeadConfig, rng: np.random.Generator) -> None:
        self.config = config
        offset = math.radians(config.offset_deg)
        self._offset = tuple(float(v) for v in offset * rng.standard_normal(2))
        self._pan = 0.0
        self._tilt = math.radians(min(max(0.0, config.tilt_deg[0]), config.tilt_deg[1]))
        self._aim = (self._pan, self._tilt)
        self._deflection = self._lag = (0.0, 0.0)

    @property
    def joint_offsets(self) -> tuple[float, float]:
        """Offsets of the pan and tilt joints, rad."""
        return self._offset[0], self._offset[1]

    @property
    def setpoints(self) -> tuple[float, float]:
        """Pan and tilt commanded to the servos now, rad."""
        return self._pan, self._tilt

    def set_deflection(
        self, joints_rad: tuple[float, float], motors_rad: tuple[float, float]
    ) -> None:
        """Set the deviation of pan and tilt from their setpoints; called by a body with dynamics.

        Args:
            joints_rad: At the joints.
            motors_rad: At the motors, where the encoders are.
        """
        self._deflection, self._lag = joints_rad, motors_rad

    def look(self, gaze: GazeCommand) -> None:
        """Set the gaze, clipped to the range of the joints."""
        reach = math.radians(self.config.pan_deg)
        high, low = (math.radians(v) for v in self.config.tilt_deg)
        self._aim = (min(max(gaze.pan_rad, -reach), reach), min(max(gaze.tilt_rad, high), low))

    def advance(self, seconds: float) -> None:
        """Move both joints towards the gaze, each within its speed limit."""
        step = self.config.speed_radps * seconds
        self._pan += min(max(self._aim[0] - self._pan, -step), step)
        self._tilt += min(max(self._aim[1] - self._tilt, -step), step)

    def camera_from_encoders(self, mount: tuple[float, float, float]) -> Pose3:
        """Camera in the frame of the pelvis as the encoders give it; the mount is its position in the head, m."""
        count = math.radians(self.config.encoder_deg)
        pan, tilt = self._pan + self._lag[0], self._tilt + self._lag[1]
        if count > 0.0:
            pan, tilt = round(pan / count) * count, round(tilt / count) * count
        return self._chain(pan, tilt, mount)

    def true_camera(self, mount: tuple[float, float, float]) -> Pose3:
        """True camera in the frame of a pelvis without sway."""
        pan, tilt = self._pan + self._offset[0], self._tilt + self._offset[1]
        return self._chain(pan + self._deflection[0], tilt + self._deflection[1], mount)

    def _chain(self, pan: float, tilt: float, mount: tuple[float, float, float]) -> Pose3:
        config = self.config
        (cp, sp), (ct, st) = ((math.cos(a), math.sin(a)) for a in (pan, tilt))
        x, y, z = mount
        ahead, up = ct * x + st * z, -st * x + ct * z  # tilted down about the tilt joint
        place = np.array(
            [
                cp * ahead - sp * y,
                sp * ahead + cp * y,
                config.hip_m + config.neck_m + config.tilt_m + up,
            ]
        )
        return Pose3.from_rotation(head_rotation(pan, tilt), place)
