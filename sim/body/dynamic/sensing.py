"""The inertial sensor in the trunk of a body with dynamics: noise, attitude, and means between two readings."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.frame import Imu
from perception.primitives.pose import times

from ..inertial import ImuConfig
from .balance import Attitude, BalanceConfig

MEAN_S = 0.2  # time over which `ImuConfig` states its noise


class TrunkSensor:
    """Reads an ideal sensor tick by tick; adds bias and noise."""

    def __init__(
        self, imu: ImuConfig, balance: BalanceConfig, tick_s: float, rng: np.random.Generator
    ) -> None:
        self._imu, self._tick_s, self._rng = imu, tick_s, rng
        self._gyro_bias = imu.gyro_bias_radps * rng.standard_normal(3)
        self._force_bias = imu.force_bias_mps2 * rng.standard_normal(3)
        self._sums: tuple[np.ndarray, np.ndarray, int] = (np.zeros(3), np.zeros(3), 0)
        self._velocity = np.zeros(2)
        self.attitude = Attitude(balance, tick_s)
        self.rate = np.zeros(3)

    def begin_step(self, velocity: Float[np.ndarray, "n 2"], yaw: Float[np.ndarray, "n"]) -> None:
        """Take the planned velocity of the centre of mass and its heading, and draw the noise of a step."""
        planned = np.vstack([self._velocity, velocity])
        self._velocity = planned[-1]
        push = np.diff(planned, axis=0) / self._tick_s
        c, s = np.array([(math.cos(angle), math.sin(angle)) for angle in yaw]).T
        self._planned_push = np.column_stack(
            [c * push[:, 0] + s * push[:, 1], c * push[:, 1] - s * push[:, 0]]
        )
        noise = self._rng.standard_normal((len(velocity), 6))
        scale = math.sqrt(MEAN_S / self._tick_s)
        noise[:, :3] *= scale * self._imu.gyro_sigma_radps
        noise[:, 3:] *= scale * self._imu.force_sigma_mps2
        self._noise = noise

    def sense(
        self, tick: int, reading: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]
    ) -> None:
        """Take the ideal angular velocity and specific force, trunk axes, of a tick of the step."""
        rate = reading[0] + self._gyro_bias + self._noise[tick, :3]
        force = reading[1] + self._force_bias + self._noise[tick, 3:]
        self.rate = rate
        attitude = self.attitude
        attitude.update(rate, force, self._planned_push[tick])
        level = attitude.level()
        upright = times(level, rate)
        upright[2] = attitude.yaw_rate(rate)
        turned, pushed, count = self._sums
        self._sums = (turned + upright, pushed + times(level, force), count + 1)

    def measure(self) -> Imu:
        """Means since the previous call, in level axes of the sensor's own attitude estimate."""
        rate, force, count = self._sums
        self._sums = (np.zeros(3), np.zeros(3), 0)
        return Imu(rate / max(count, 1), force / max(count, 1))
