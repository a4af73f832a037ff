"""Inertial sensor in the trunk: mean angular velocity and specific force between two instants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Imu
from perception.primitives.pose import times, wrap_angle
from perception.primitives.settings import setting

from ..ranges import check_ranges
from .pendulum import GRAVITY_MPS2


@dataclass(frozen=True)
class ImuConfig:
    """Noise of the means, and biases that are constant within a run."""

    gyro_sigma_radps: float = setting(
        0.002,
        "rad/s",
        "standard deviation of the gyro",
        "ours: MEMS gyro averaged over 0.2 s, with its mounting",
    )
    gyro_bias_radps: float = setting(
        0.005,
        "rad/s",
        "standard deviation of the gyro's bias, constant within a run",
        "ours: calibrated at rest minutes before",
    )
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
    """State of the trunk whose change the sensor measures.

    Args:
        yaw_rad: True heading of the body.
        velocity_body: Velocity of the trunk over the floor, body axes, m/s.
        roll_rad, pitch_rad: Tilt of the trunk.
    """

    yaw_rad: float
    velocity_body: Float[np.ndarray, "2"]
    roll_rad: float
    pitch_rad: float


class InertialSensor:
    """Gyro and accelerometer, each with its own bias."""

    def __init__(self, config: ImuConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng
        self.gyro_bias = config.gyro_bias_radps * rng.standard_normal(3)
        self.force_bias = config.force_bias_mps2 * rng.standard_normal(3)

    def measure(self, before: TrunkState, now: TrunkState, seconds: float) -> Imu:
        """Means between two states, body axes: the exact values plus bias and noise."""
        turn = wrap_angle(now.yaw_rad - before.yaw_rad)
        rate = np.array([now.roll_rad - before.roll_rad, now.pitch_rad - before.pitch_rad, turn])
        # change of velocity in the axes of the mean heading
        c, s = math.cos(turn / 2), math.sin(turn / 2)
        back = np.array([[c, -s], [s, c]])
        change = times(back, now.velocity_body) - times(back.T, before.velocity_body)
        roll = (before.roll_rad + now.roll_rad) / 2
        pitch = (before.pitch_rad + now.pitch_rad) / 2
        up = GRAVITY_MPS2 * np.array(
            [
                -math.sin(pitch),
                math.sin(roll) * math.cos(pitch),
                math.cos(roll) * math.cos(pitch),
            ]
        )
        force = up + np.array([*change, 0.0]) / seconds
        config = self._config
        return Imu(
            rate / seconds
            + self.gyro_bias
            + config.gyro_sigma_radps * self._rng.standard_normal(3),
            force + self.force_bias + config.force_sigma_mps2 * self._rng.standard_normal(3),
        )
