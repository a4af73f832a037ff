"""The places to walk to, one after the other, and when a mission is over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .config import MissionConfig
from .pipeline import Estimate


class Goals:
    """A list of places that is worked off by the estimated pose."""

    def __init__(self, goals: Sequence[tuple[float, float]], config: MissionConfig) -> None:
        """Set out.

        Args:
            goals: Where to walk, one after the other, map frame, m.
            config: Tolerance and time limit.
        """
        self._goals = [np.array(goal) for goal in goals]
        self._config = config
        self.reached = 0

    @property
    def present(self) -> Float[np.ndarray, "2"] | None:
        """The place to walk to now, map frame, m; None when all are reached."""
        return self._goals[self.reached] if self.reached < len(self._goals) else None

    def distance(self, estimate: Estimate) -> float:
        """From the estimated pose to the present goal, m; 0 when all are reached."""
        if self.present is None or estimate.pose is None:
            return 0.0
        return float(np.linalg.norm(self.present - estimate.pose.mean[:2]))

    def finished(self, estimate: Estimate) -> bool:
        """Count the present goal if it is reached; whether all are, or the time is up."""
        if self.present is not None and self.distance(estimate) <= self._config.tolerance_m:
            self.reached += 1
        return self.present is None or estimate.stamp_s >= self._config.time_limit_s
