"""The gaze joints of a robot that walks: they start and stop without jerks, and the walk knows before where they will be.

A waist that turns the cameras moves half of the mass; a jerk of it is a push.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..jointed import JointedHead

LAG_S = 0.15  # ours: half the lag behind the setpoints; without any, a robot whose waist carries half its mass falls


class Waist:
    """Follows setpoints, critically damped."""

    def __init__(self, angles: Float[np.ndarray, "2"], tick_s: float) -> None:
        self._angles, self._rate = angles.copy(), np.zeros(2)
        self._tick_s = tick_s

    def advance(self, setpoints: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Angles after one more tick, rad."""
        pull = (setpoints - self._angles) / LAG_S**2 - 2.0 * self._rate / LAG_S
        self._rate = self._rate + self._tick_s * pull
        self._angles = self._angles + self._tick_s * self._rate
        return self._angles

    def ahead(self, head: JointedHead, count: int) -> Float[np.ndarray, "k 2"]:
        """Angles in that many ticks to come, unless the gaze is changed."""
        ghost = Waist(self._angles, self._tick_s)
        ghost._rate = self._rate
        return np.array([ghost.advance(row) for row in head.ahead(self._tick_s, count)])
