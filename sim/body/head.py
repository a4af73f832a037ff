"""The head: pan and tilt joints with a top speed, encoders that round, and joints that sit a little askew."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3, head_rotation
from planning.commands import GazeCommand

from ..ranges import check_ranges


@dataclass(frozen=True)
class HeadConfig:
    """Where the head sits and how it moves.

    Args:
        hip_m: Height of the pelvis while walking.
        neck_m: Pan joint above the pelvis.
        tilt_m: Tilt joint above the pan joint.
        pan_deg: Reach to each side.
        tilt_deg: (highest, lowest) tilt, down positive.
        speed_radps: Top speed of both joints.
        encoder_deg: Grain of the encoders.
        offset_deg: Deviation of each joint's zero, one value a run.
    """

    hip_m: float = 0.2055  # DARwIn-OP walking; tilted 30 deg the camera then stands at 0.383 m
    neck_m: float = 0.150  # DARwIn-OP
    tilt_m: float = 0.015  # DARwIn-OP
    pan_deg: float = 90.0  # seed 001, our range
    tilt_deg: tuple[float, float] = (0.0, 60.0)  # seed 001, our range
    speed_radps: float = 4.0  # ours: MX-28 servo under load
    encoder_deg: float = 0.088  # MX-28: 4096 to the turn
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


class Head:
    """Turns towards where it was last told to look."""

    def __init__(self, config: HeadConfig, rng: np.random.Generator) -> None:
        self.config = config
        offset = math.radians(config.offset_deg)
        self._offset = tuple(float(v) for v in offset * rng.standard_normal(2))
        self._pan = 0.0
        self._tilt = math.radians(min(max(0.0, config.tilt_deg[0]), config.tilt_deg[1]))
        self._aim = (self._pan, self._tilt)
        self._play = self._lag = (0.0, 0.0)

    @property
    def zeros(self) -> tuple[float, float]:
        """How far askew pan and tilt joint sit, rad; a body with dynamics builds them so."""
        return self._offset[0], self._offset[1]

    @property
    def aims(self) -> tuple[float, float]:
        """Pan and tilt that the servos hold now, rad."""
        return self._pan, self._tilt

    def deflected(self, joints_rad: tuple[float, float], motors_rad: tuple[float, float]) -> None:
        """A body with dynamics tells how far pan and tilt are from where the servos shall hold them.

        Args:
            joints_rad: Of the joints themselves.
            motors_rad: On the motors' side of the gears, where the encoders sit.
        """
        self._play, self._lag = joints_rad, motors_rad

    def look(self, gaze: GazeCommand) -> None:
        """Clipped to the reach of the joints."""
        reach = math.radians(self.config.pan_deg)
        high, low = (math.radians(v) for v in self.config.tilt_deg)
        self._aim = (min(max(gaze.pan_rad, -reach), reach), min(max(gaze.tilt_rad, high), low))

    def advance(self, seconds: float) -> None:
        """Turn on, each joint as fast as it may."""
        step = self.config.speed_radps * seconds
        self._pan += min(max(self._aim[0] - self._pan, -step), step)
        self._tilt += min(max(self._aim[1] - self._tilt, -step), step)

    def camera_by_encoders(self, mount: tuple[float, float, float]) -> Pose3:
        """A camera on the pelvis as the encoders have it; the mount is its place in the head, m."""
        grain = math.radians(self.config.encoder_deg)
        pan, tilt = self._pan + self._lag[0], self._tilt + self._lag[1]
        if grain > 0.0:
            pan, tilt = round(pan / grain) * grain, round(tilt / grain) * grain
        return self._chain(pan, tilt, mount)

    def camera_truly(self, mount: tuple[float, float, float]) -> Pose3:
        """Where it is on a pelvis that does not tremble."""
        pan, tilt = self._pan + self._offset[0], self._tilt + self._offset[1]
        return self._chain(pan + self._play[0], tilt + self._play[1], mount)

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
