"""The inertial sensor in the trunk: mean angular velocity and specific force between two instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Imu
from perception.primitives.pose import wrap_angle

from ..ranges import check_ranges
from .gait import GRAVITY_MPS2
from .kinematic import Tremble


@dataclass(frozen=True)
class ImuConfig:
    """Noise of the means, and biases that stay for a run."""

    gyro_sigma_radps: float = 0.002  # ours: MEMS gyro averaged over 0.2 s, mounting included
    gyro_bias_radps: float = 0.005  # ours: after a calibration at rest minutes ago
    force_sigma_mps2: float = 0.05  # ours
    force_bias_mps2: float = 0.03  # ours

    def __post_init__(self) -> None:
        check_ranges(
            "imu",
            self,
            gyro_sigma_radps=(0.0, 10.0),
            gyro_bias_radps=(0.0, 10.0),
            force_sigma_mps2=(0.0, 100.0),
            force_bias_mps2=(0.0, 100.0),
        )


@dataclass(frozen=True, eq=False)
class TrunkState:
    """What the sensor feels the change of.

    Args:
        yaw_rad: True heading of the body.
        velocity_body: Of the trunk over the floor, body axes, m/s.
        tremble: Roll and pitch of the trunk; the yaw of the tremble is the neck's, and is not felt.
    """

    yaw_rad: float
    velocity_body: Float[np.ndarray, "2"]
    tremble: Tremble


class InertialSensor:
    """Gyro and accelerometer with their own biases."""

    def __init__(self, config: ImuConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self.gyro_bias = config.gyro_bias_radps * rng.standard_normal(3)
        self.force_bias = config.force_bias_mps2 * rng.standard_normal(3)

    def measure(self, before: TrunkState, now: TrunkState, seconds: float) -> Imu:
        """Means over the time between two states, body axes: exact ones, plus bias and noise."""
        turn = wrap_angle(now.yaw_rad - before.yaw_rad)
        rate = np.array(
            [
                now.tremble.roll_rad - before.tremble.roll_rad,
                now.tremble.pitch_rad - before.tremble.pitch_rad,
                turn,
            ]
        )
        # the change of velocity, seen from the heading half way
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        back = np.array([[c, -s], [s, c]])
        change = back @ now.velocity_body - back.T @ before.velocity_body
        roll = (before.tremble.roll_rad + now.tremble.roll_rad) / 2
        pitch = (before.tremble.pitch_rad + now.tremble.pitch_rad) / 2
        up = GRAVITY_MPS2 * np.array(
            [-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)]
        )
        force = up + np.array([*change, 0.0]) / seconds
        config = self._config
        return Imu(
            rate / seconds
            + self.gyro_bias
            + config.gyro_sigma_radps * self._rng.standard_normal(3),
            force + self.force_bias + config.force_sigma_mps2 * self._rng.standard_normal(3),
        )
