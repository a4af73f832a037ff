"""How an obstacle moves: modes of motion with their probabilities, and how it changes between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .gaussian import Gaussian

MODES = ("still", "pausing", "straight", "curving", "turned")
"""Names of the modes; `perception.obstacles.track` describes them."""


GOING = 2
"""The first of the modes that go."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Modes of one obstacle at the present time.

    Args:
        probabilities: Of the modes, in the order of `MODES`.
        means: Over (x, y, vx, vy), world frame, m and m/s.
        covariances: Of those.
        rates: Of every change, from row to column, 1/s.
        fresh: Covariance of a velocity taken anew, m^2/s^2.
        straight: Over (x, y, vx, vy) if it moves and has gone straight on since it was seen.
    """

    probabilities: Float[np.ndarray, "5"]
    means: Float[np.ndarray, "5 4"]
    covariances: Float[np.ndarray, "5 4 4"]
    rates: Float[np.ndarray, "5 5"]
    fresh: Float[np.ndarray, "2 2"]
    straight: Gaussian

    @property
    def named(self) -> dict[str, float]:
        """Probabilities by the name of the mode."""
        return dict(zip(MODES, self.probabilities.tolist(), strict=True))
