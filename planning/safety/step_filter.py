"""Who has the last word on a footstep: the guard, or one of the peers that it is compared with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from ..commands import WalkCommand

BASELINE_CELL_M = 0.17
"""Ours: distance that the baselines keep from the middle of an occupied cell, for a DARwIn-OP."""


@runtime_checkable
class StepFilter(Protocol):
    """From the step that the field wants to the step that is made."""

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
    ) -> WalkCommand:
        """The step to make; to be asked once per footstep, in order.

        Args:
            desired: What the field asks for.
            robot: Gaussian over (x, y, yaw), world frame.
            obstacles: Tracks, world frame, as of now.
            occupied: Middles of occupied cells, world frame, m; far ones may be included.
            target: Via point, world frame, m.
            stamp_s: Now, in the clock of `Obstacle.seen_s`.
        """
        ...


class Unfiltered:
    """Makes every step that the field wants: the published method alone."""

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
    ) -> WalkCommand:
        """The desired step, whatever there is."""
        return desired
