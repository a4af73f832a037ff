"""Where a push carries the weight, and by how much the feet have to follow.

A body that servos hold stiff turns as one about an edge of its sole when it is pushed, while its joints
go on as planned. So its tilt, and how fast that grows, say how far its capture point has left the plan:
h (tilt + tilt'/w), in the direction in which it tips. Ahead or back of the plan, the coming footstep goes
along; towards a foot that is in the air, this foot is put down at once; the trunk bends (`hip_strategy`).

Source: Pratt et al. 2006 (capture point of a pushed pendulum).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..gait import GRAVITY_MPS2
from .balance import BalanceConfig


class CapturePoint:
    """How far the capture point is from the plan, felt every tick by the inertial sensor.

    Args:
        config: What is believed to be a push.
        height_m: Of the weight.
        scale: Of the body, against a DARwIn-OP.
    """

    def __init__(self, config: BalanceConfig, height_m: float, scale: float = 1.0) -> None:
        self._height = height_m
        self._lag = math.sqrt(height_m / GRAVITY_MPS2)
        self._keep = config.tilt_memory
        self._answer = config.answer
        self._astray, self._tipping = config.astray_m * scale, config.tipping_m * scale
        self.error = np.zeros(2)  # ahead and to the left, m

    def feel(self, tilt: Float[np.ndarray, "2"], rate: Float[np.ndarray, "2"]) -> None:
        """One tick.

        Args:
            tilt, rate: Roll and pitch of the body, but for what its trunk is bent at the hips, rad and rad/s.
        """
        roll, pitch = (tilt + self._lag * rate).tolist()
        found = self._height * np.array([pitch, -roll])
        self.error = self._keep * self.error + (1.0 - self._keep) * found

    @property
    def ahead(self) -> float:
        """How much further the next footstep has to go, m.

        By more than the error exceeds a usual one: it grows until the foot is there.
        """
        ahead = float(self.error[0])
        return self._answer * math.copysign(max(abs(ahead) - self._astray, 0.0), ahead)

    def tips_to(self, side: int) -> bool:
        """Whether the body falls towards that side, +1 left, -1 right."""
        return side * float(self.error[1]) > self._tipping
