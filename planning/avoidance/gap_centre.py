"""The middle of a gap, seen again and again on the way into it.

A gap may leave a centimetre on either side, and a pose errs by half of that from the place where the gap was
measured to where it is entered. So its sides are looked at while the robot comes near: what they are beside its
line is known to some millimetres, whatever the pose is wrong by.

Source: ours, for the passages of seed 004, section 2.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AHEAD_M = (0.1, 0.7)  # ours: so far ahead of the robot a gap is looked at
BESIDE_M = 0.06  # ours: how much of both sides is looked at
INNERMOST = 0.05  # ours: this share of their points lies nearer, by noise and mixed pixels
LEAST = 40  # ours: points of either side
WIDER_M = 0.025  # ours: what is so much wider or narrower is another gap
EDGE_M = 0.002  # ours: deviation of what is seen of both sides ...
TURNED_RAD = math.radians(0.4)  # ours: ... and of the line of sight, by heading and neck
AWAY_M = 0.007  # ours: of the pose, from where the gap was measured to here
DRIFT_M = 0.0015  # ours: of the pose from one look to the next


@dataclass
class GapCentre:
    """How far the middle of a gap lies beside the line that leads through it.

    Args:
        gap_m: Its width, as it was measured.
        offset_m: To the left of the line; zero until it was seen.
        sigma_m: Deviation.
    """

    gap_m: float
    offset_m: float = 0.0
    sigma_m: float = AWAY_M

    def look(self, points: Float[np.ndarray, "n 2"]) -> bool:
        """Take in one view; whether it showed both sides.

        Args:
            points: Of what stands: ahead of the robot along the line, and to the left of it, m.
        """
        self.sigma_m = math.hypot(self.sigma_m, DRIFT_M)
        ahead, aside = points[:, 0], points[:, 1] - self.offset_m
        near = (ahead > AHEAD_M[0]) & (ahead < AHEAD_M[1])
        near &= np.abs(aside) < self.gap_m / 2 + BESIDE_M
        left, right = near & (aside > 0.0), near & (aside < 0.0)
        if min(np.count_nonzero(left), np.count_nonzero(right)) < LEAST:
            return False
        ends = np.quantile(aside[left], INNERMOST), np.quantile(aside[right], 1.0 - INNERMOST)
        if abs(ends[0] - ends[1] - self.gap_m) > WIDER_M:
            return False
        sigma = math.hypot(EDGE_M, TURNED_RAD * float(np.mean(ahead[left | right])))
        gain = self.sigma_m**2 / (self.sigma_m**2 + sigma**2)
        self.offset_m += gain * float(ends[0] + ends[1]) / 2
        self.sigma_m *= math.sqrt(1.0 - gain)
        return True
