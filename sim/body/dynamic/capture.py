"""Capture point error after a push, and the extension of the next step.

A body held stiff by its servos rotates about an edge of its sole when it is pushed, while its joints follow the plan.
Tilt and tilt rate therefore give the deviation of the capture point from the plan: h (tilt + tilt'/w), in the
direction of the fall. For a fall forward or back the next footstep is extended; for a fall towards the foot in the
air that foot lands at once; the trunk bends as well (`hip_strategy`).

Source: Pratt et al. 2006 (capture point of a pushed pendulum).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..pendulum import GRAVITY_MPS2
from .balance import TILT_MEMORY, BalanceConfig

STEP_GAIN = 2.0  # ours: the error grows until the foot lands


class CapturePoint:
    """Deviation of the capture point from the plan, updated every tick from the inertial sensor.

    Args:
        config: Thresholds.
        height_m: Height of the centre of mass.
        scale: Size of the body relative to a DARwIn-OP.
    """

    def __init__(self, config: BalanceConfig, height_m: float, scale: float = 1.0) -> None:
        self._height = height_m
        self._lag = math.sqrt(height_m / GRAVITY_MPS2)
        self._deadband, self._tipping = config.deadband_m * scale, config.tipping_m * scale
        self.error = np.zeros(2)  # ahead and to the left, m

    def update(self, tilt: Float[np.ndarray, "2"], rate: Float[np.ndarray, "2"]) -> None:
        """Update by one tick.

        Args:
            tilt, rate: Roll and pitch of the body, without the bend of the hips, rad and rad/s.
        """
        roll, pitch = (tilt + self._lag * rate).tolist()
        measured = self._height * np.array([pitch, -roll])
        self.error = TILT_MEMORY * self.error + (1.0 - TILT_MEMORY) * measured

    @property
    def step_extension_m(self) -> float:
        """Extension of the next footstep, m: proportional to the error beyond the dead band."""
        ahead = float(self.error[0])
        return STEP_GAIN * math.copysign(max(abs(ahead) - self._deadband, 0.0), ahead)

    def is_falling_to(self, side: int) -> bool:
        """Whether the body falls towards that side, +1 left, -1 right."""
        return side * float(self.error[1]) > self._tipping
