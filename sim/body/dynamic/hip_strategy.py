"""Hip strategy after a push: the trunk bends in the direction of the fall and absorbs its angular momentum.

The edge of the sole limits the torque of the floor. Bending the trunk at the hips in the direction of the fall takes
up angular momentum; straightening up slowly, once the weight rests or a foot stands further out, returns it. The
pelvis moves the opposite way meanwhile, so that the centre of mass stays where it is planned.

Source: Stephens 2007 (hip strategy). Gains: of 600 pushes of 1 N s it halves the falls; with the trunk bent against
the fall one in four ends in a fall.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from .balance import BLEND_S, BalanceConfig

BEND_RAD_PER_M = 12.0  # ours: beyond the dead band; 10 and 14 do as well
BEND_RADPS = 6.0  # ours: servos of this size
BEND_RADPS2 = 100.0  # ours: 200 does as well; without a limit the trunk shakes and more walks fall
STRAIGHTEN_RADPS = 0.4  # ours: slow, since straightening returns the angular momentum


class HipStrategy:
    """Bend of the trunk at the hips, updated every tick.

    Args:
        config: Dead band and limits.
        tick_s: Length of a tick.
        scale: Size of the body relative to a DARwIn-OP.
    """

    def __init__(self, config: BalanceConfig, tick_s: float, scale: float = 1.0) -> None:
        self._config = config
        self._tick_s = tick_s
        self._change = BEND_RADPS2 * tick_s  # greatest change of the rate, rad/s
        self._gain = BEND_RAD_PER_M / scale
        self._deadband = config.deadband_m * scale
        self.bend = np.zeros(2)  # roll and pitch of the trunk against upright legs, rad
        self.rate = np.zeros(2)  # rad/s

    def update(self, error: Float[np.ndarray, "2"]) -> None:
        """Update by one tick.

        Args:
            error: Capture point error, ahead and to the left, m.
        """
        most = self._config.bend_most_rad
        for k, signed in enumerate((-float(error[1]), float(error[0]))):
            bend = float(self.bend[k])
            target = min(self._gain * max(abs(signed) - self._deadband, 0.0), most[k])
            target = math.copysign(target, signed)
            bending = abs(target) > abs(bend) or target * bend < 0.0
            fastest = BEND_RADPS if bending else STRAIGHTEN_RADPS
            rate = min(max((target - bend) / BLEND_S, -fastest), fastest)
            change = rate - float(self.rate[k])
            self.rate[k] += min(max(change, -self._change), self._change)
        self.bend += self.rate * self._tick_s
