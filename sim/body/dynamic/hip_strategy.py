"""What the hips do about a push: the trunk turns the way the body falls, and the fall is slowed by it.

How hard the floor can push back is bounded by the edge of the sole. A trunk that bends at the hips in the
direction in which the body tips takes up the angular momentum of the fall. It gives it back when it
straightens up: slowly, once the weight has come to rest or a foot stands further out. The pelvis goes the
other way meanwhile, so that the weight stays where it is planned.

Source: Stephens 2007 (hip strategy). Gains: of 600 pushes of 1 N s half as many end in a fall with it; with
the trunk turned against the fall, one in four does.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from .balance import BalanceConfig


class Hips:
    """How far the trunk is bent at the hips, every tick anew.

    Args:
        config: Gains.
        tick_s: Length of a tick.
        scale: Of the body, against a DARwIn-OP.
    """

    def __init__(self, config: BalanceConfig, tick_s: float, scale: float = 1.0) -> None:
        self._config = config
        self._tick_s = tick_s
        self._change = config.bend_radps2 * tick_s  # of the rate, at most, rad/s
        self._gain = config.bend_rad_per_m / scale
        self._astray = config.astray_m * scale
        self.bend = np.zeros(2)  # roll and pitch of the trunk against legs that stand upright, rad
        self.rate = np.zeros(2)  # rad/s

    def advance(self, error: Float[np.ndarray, "2"]) -> None:
        """One tick.

        Args:
            error: How far ahead and to the left of the plan the capture point is, m.
        """
        config = self._config
        for k, off in enumerate((-float(error[1]), float(error[0]))):
            bent = float(self.bend[k])
            wanted = min(self._gain * max(abs(off) - self._astray, 0.0), config.bend_most_rad[k])
            wanted = math.copysign(wanted, off)
            further = abs(wanted) > abs(bent) or wanted * bent < 0.0
            fastest = config.bend_radps if further else config.unbend_radps
            pace = min(max((wanted - bent) / config.blend_s, -fastest), fastest)
            change = pace - float(self.rate[k])
            self.rate[k] += min(max(change, -self._change), self._change)
        self.bend += self.rate * self._tick_s
