"""Planar localisation with landmarks without identity: multiple hypotheses.

Nearest-neighbour association decides too early: one exchange of neighbours displaces the robot, and the next
sightings follow the mistake. So the decision is deferred. A bank of hypotheses, each a planar filter with its
own associations, branches at every sighting into all landmarks inside the gate and into "clutter"; two
sightings of one instant are never the same landmark. Unlikely hypotheses are pruned, those at the same pose are
merged, and the estimate is their mixture.

Source: Reid, "An algorithm for tracking multiple targets" (IEEE Transactions on Automatic Control 24, 1979);
for localisation: Jensfelt, Kristensen, "Active global localization for a mobile robot using multiple hypothesis
tracking" (2001).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from . import _association_kernels as kernels
from ._planar_kernels import scratch_space
from .config import PlanarConfig
from .planar import Journey, PlanarPrior, sigma_weights

_MOST_PLACES = 62  # landmarks seen at one instant are bits of one integer


@dataclass(frozen=True)
class BankConfig:
    """Size of the bank and pruning."""

    capacity: int = 24  # ours: more did not reduce the error of real runs
    depth: float = 12.0  # ours: largest log weight below the heaviest; e^-12 is one in 160 000

    def __post_init__(self) -> None:
        if self.capacity < 1 or not self.depth > 0.0:
            raise ConfigError(
                f"hypothesis bank: capacity={self.capacity} must be at least 1 and "
                f"depth={self.depth} positive"
            )


class HypothesisBank:
    """Planar filters with different data associations."""

    def __init__(
        self,
        start: Gaussian,
        places: Float[np.ndarray, "l 2"],
        config: PlanarConfig | None = None,
        prior: PlanarPrior | None = None,
        bank: BankConfig | None = None,
    ) -> None:
        """Begin at a pose.

        Args:
            start: Over (x, y, yaw), m and rad, world frame.
            places: Positions of the landmarks, m, world frame; one to 62.
            config: Noise; the defaults if None.
            prior: Uncertainty of the other states.
            bank: Size of the bank.
        """
        if not 1 <= len(places) <= _MOST_PLACES:
            raise ConfigError(
                f"hypothesis bank: {len(places)} landmarks; 1 to {_MOST_PLACES} are possible, "
                "give only the nearby ones"
            )
        self.config, self.bank = config or PlanarConfig(), bank or BankConfig()
        prior = prior or PlanarPrior()
        state = prior.state(start, self.config)
        size, capacity = len(state.mean), self.bank.capacity
        self._bank, self._spare = (
            kernels.Bank(
                np.tile(state.mean, (capacity, 1)),
                np.tile(np.linalg.cholesky(state.covariance), (capacity, 1, 1)),
                np.zeros(capacity),
                np.full((capacity, prior.slots), -1),
                np.zeros((capacity, prior.slots)),
                np.zeros(capacity, np.int64),
            )
            for _ in range(2)
        )
        self._count = 1
        self._places = np.ascontiguousarray(places, float)
        self._p, self._weights, self._scratch = (
            self.config.parameters,
            sigma_weights(size),
            scratch_space(size),
        )
        self._time_s = self._rate = 0.0

    @property
    def count(self) -> int:
        """Number of hypotheses."""
        return self._count

    @property
    def share(self) -> float:
        """Weight of the heaviest hypothesis."""
        return float(np.exp(self._bank.log_weights[: self._count].max()))

    @property
    def pose(self) -> Gaussian:
        """Gaussian over (x, y, yaw), m and rad, world frame: mean and covariance of the mixture."""
        return Gaussian(*kernels.mixture(self._bank, self._count))

    def predict(self, dt: float, path: float, turn: float) -> bool:
        """Advance, as `PlanarFilter.predict`."""
        if not (math.isfinite(dt + path + turn) and dt >= 0.0):
            return False
        self._time_s += dt
        self._rate = turn / dt if dt > 1e-3 else 0.0
        kernels.predict(
            self._bank, self._count, dt, path, turn, self._p, self._weights, self._scratch
        )
        return True

    def update(self, seen: Float[np.ndarray, "k 2"]) -> None:
        """Update with all sightings of one instant: depth, m, and bearing, rad; those not finite are ignored."""
        self._count = int(
            kernels.update(
                self._bank,
                self._spare,
                self._places,
                np.ascontiguousarray(seen, float),
                self._count,
                self._rate,
                self._time_s,
                self.bank.depth,
                self._p,
                self._weights,
                self._scratch,
            )
        )


def filter_unknown(
    journey: Journey, config: PlanarConfig | None = None
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Filter a run without using the identities of its landmarks.

    Returns:
        Means and covariances of (x, y, yaw) at each instant.
    """
    robots = HypothesisBank(journey.start, journey.places, config)
    means, covariances = np.empty((len(journey.steps), 3)), np.empty((len(journey.steps), 3, 3))
    for i, (dt, path, turn) in enumerate(journey.steps.tolist()):
        robots.predict(dt, path, turn)
        first, last = journey.first_row[i], journey.first_row[i + 1]
        if last > first:
            robots.update(journey.seen[first:last])
        pose = robots.pose
        means[i], covariances[i] = pose.mean, pose.covariance
    return means, covariances
