"""The protocol of the last check on a footstep, which the guard implements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

from ..commands import WalkCommand


@runtime_checkable
class StepFilter(Protocol):
    """Replaces the desired step by one that avoids collisions."""

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
        unseen: Float[np.ndarray, "k 2"] | None = None,
    ) -> WalkCommand:
        """The step to make; called once per footstep, in order.

        Args:
            desired: Step that the planner asks for.
            robot: Gaussian over (x, y, yaw), world frame.
            obstacles: Tracks at the present time, world frame.
            occupied: Middles of occupied cells, world frame, m; may include distant ones.
            target: Via point, world frame, m.
            stamp_s: Present time, in the clock of `Obstacle.seen_s`.
            unseen: Middles of cells that were never seen, world frame, m; may include distant ones. None: all were seen.
        """
        ...


class Unfiltered:
    """Returns every desired step unchanged: the published method alone."""

    def choose(
        self,
        desired: WalkCommand,
        robot: Gaussian,
        obstacles: Sequence[Obstacle],
        occupied: Float[np.ndarray, "n 2"],
        target: Float[np.ndarray, "2"],
        stamp_s: float,
        unseen: Float[np.ndarray, "k 2"] | None = None,
    ) -> WalkCommand:
        """The desired step."""
        return desired
