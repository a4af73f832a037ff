"""The middle of a gap, measured repeatedly on the approach.

A gap may leave a centimetre on either side, and the pose drifts by half of that between the measurement of the gap and its
entrance. The sides of the gap relative to the line of the robot are therefore measured again on the approach, to some
millimetres and independently of the pose error.

Source: ours, for the passages of Kang 2013 (seed 004), section 2.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

# all ours
AHEAD_M = (0.1, 0.7)  # range ahead of the robot in which a gap is measured
BESIDE_M = 0.06  # lateral extent of both sides that is used
INNERMOST = 0.05  # share of the points that lie nearer, by noise and mixed pixels
LEAST = 40  # points of each side
WIDER_M = 0.025  # a gap that differs by more is another one
EDGE_M = 0.002  # standard deviation of the edges ...
TURNED_RAD = math.radians(0.4)  # ... of the line of sight, by heading and neck ...
AWAY_M = 0.007  # ... and of the pose between the first measurement and the approach
DRIFT_M = 0.0015  # standard deviation of the pose from one look to the next


@dataclass
class GapCentre:
    """Lateral offset of the middle of a gap from the planned line through it.

    Args:
        gap_m: Measured width.
        offset_m: To the left of the line; zero until the first look.
        sigma_m: Standard deviation of the offset.
    """

    gap_m: float
    offset_m: float = 0.0
    sigma_m: float = AWAY_M

    def look(self, points: Float[np.ndarray, "n 2"]) -> bool:
        """Update from one view; whether it showed both sides.

        Args:
            points: Of obstacles: ahead of the robot along the line, and to the left of the line, m.
        """
        self.sigma_m = math.hypot(self.sigma_m, DRIFT_M)
        ahead, lateral = points[:, 0], points[:, 1] - self.offset_m
        near = (ahead > AHEAD_M[0]) & (ahead < AHEAD_M[1])
        near &= np.abs(lateral) < self.gap_m / 2 + BESIDE_M
        left, right = near & (lateral > 0.0), near & (lateral < 0.0)
        if min(np.count_nonzero(left), np.count_nonzero(right)) < LEAST:
            return False
        ends = np.quantile(lateral[left], INNERMOST), np.quantile(lateral[right], 1.0 - INNERMOST)
        if abs(ends[0] - ends[1] - self.gap_m) > WIDER_M:
            return False
        sigma = math.hypot(EDGE_M, TURNED_RAD * float(np.mean(ahead[left | right])))
        gain = self.sigma_m**2 / (self.sigma_m**2 + sigma**2)
        self.offset_m += gain * float(ends[0] + ends[1]) / 2
        self.sigma_m *= math.sqrt(1.0 - gain)
        return True
