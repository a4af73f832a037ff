"""An obstacle for planning: a disc on the floor that may move."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from .gaussian import Gaussian
from .motion import Motion

MOVING = 0.3
"""Probability of moving from which planning treats an obstacle as a moving one; ours."""


@dataclass(frozen=True)
class Obstacle:
    """A tracked obstacle, world frame.

    Args:
        state: Gaussian over (x, y, vx, vy), m and m/s, world frame.
        radius_m: Radius of its covering disc.
        height_m: Height of its top above the floor.
        track: Number of its track.
        moving: Probability that it moves, in [0, 1].
        seen_s: Time of the last detection.
        since_s: Time of the first detection.
        motion: Modes of its motion; None if its state is all that is known.
    """

    state: Gaussian
    radius_m: float
    height_m: float = 0.0
    track: int = 0
    moving: float = 0.0
    seen_s: float = 0.0
    since_s: float = 0.0
    motion: Motion | None = None

    @property
    def position(self) -> Float[np.ndarray, "2"]:
        """(x, y), m, world frame."""
        return self.state.mean[:2]

    @property
    def velocity(self) -> Float[np.ndarray, "2"]:
        """(vx, vy), m/s, world frame."""
        return self.state.mean[2:]

    def after(self, seconds: float, acceleration_mps2: float = 0.0) -> Obstacle:
        """The obstacle predicted at constant velocity.

        Args:
            seconds: Prediction time, s.
            acceleration_mps2: Standard deviation of its random acceleration.
        """
        step = np.eye(4)
        step[0, 2] = step[1, 3] = seconds
        state = self.state.linear(step)
        gain = np.array([[seconds**2 / 2, 0], [0, seconds**2 / 2], [seconds, 0], [0, seconds]])
        covariance = state.covariance + gain @ gain.T * acceleration_mps2**2
        return replace(self, state=Gaussian(state.mean, covariance), motion=None)

    def gone_straight(self) -> Obstacle:
        """The obstacle as if it had gone straight on, for planners that have their own hypotheses of turns."""
        return self if self.motion is None else replace(self, state=self.motion.straight)
