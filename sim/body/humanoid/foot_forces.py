"""Foot force difference: in double support the foot that bears too little is lowered and the other one raised.

The share that each foot should bear follows the planned shift of the weight, and more of it is wanted where the body falls to.
Without this control a robot on stiff legs rocks from edge to edge of its soles.

Source: Kajita et al. 2010, "Biped walking stabilization based on linear inverted pendulum tracking", section III-C; gains
from walking trials.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..gait import Step

LEAST, MOST = 0.02, 0.98  # ours: limits of the share of a foot
GAIN = 1.5  # ours: share of weight for a capture point that is off by the width of the stance
MOST_M = 0.03  # ours: limit of a foot's height
BEARING = 0.1  # ours: share of the weight below which soles do not bear the body


class FootForces:
    """Heights of both soles against the plan, m."""

    def __init__(self, shift_mps: float, forget_s: float, weight_n: float, tick_s: float) -> None:
        self._lift = shift_mps * tick_s / 2
        self._fade = math.exp(-tick_s / forget_s)
        self._weight_n = weight_n
        self._before = self._after = 0.5  # planned share of the left foot
        self.heights = np.zeros(2)  # left, right

    def begin_step(self, step: Step) -> None:
        """Take the planned shift of the weight."""
        self._before = self._after
        self._after = (1.0 - step.swing) / 2 if step.stepping else 0.5

    def update(
        self, step: Step, tick: int, loads: Float[np.ndarray, "2"], falls_left: float
    ) -> None:
        """Update by one tick.

        Args:
            step: Current step.
            tick: Tick within it.
            loads: Forces on the left and on the right sole, N.
            falls_left: Capture point's error to the left, relative to the width of the stance.
        """
        self.heights *= self._fade
        total = float(loads.sum())
        if (
            step.stepping and tick >= step.double_support_ticks
        ) or total < BEARING * self._weight_n:
            return
        shifted = min(tick / step.double_support_ticks, 1.0)
        planned = self._before + shifted * (self._after - self._before)
        wanted = min(max(planned + GAIN * falls_left, LEAST), MOST)
        lower = self._lift * (wanted - float(loads[0]) / total)
        self.heights += np.array([-lower, lower])
        np.clip(self.heights, -MOST_M, MOST_M, out=self.heights)
