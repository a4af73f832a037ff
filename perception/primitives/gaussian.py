"""A Gaussian: mean and covariance of a vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Gaussian:
    """Mean (n,) and covariance (n, n); the owner states the units."""

    mean: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]

    def mahalanobis_squared(self, point: Float[np.ndarray, "n"]) -> float:
        """Squared Mahalanobis distance of a point; chi-square with n degrees of freedom."""
        difference = point - self.mean
        return float(difference @ np.linalg.solve(self.covariance, difference))

    def marginal(self, *indices: int) -> Gaussian:
        """The Gaussian of some of the entries."""
        chosen = list(indices)
        return Gaussian(self.mean[chosen], self.covariance[np.ix_(chosen, chosen)])

    def linear(self, matrix: Float[np.ndarray, "m n"]) -> Gaussian:
        """The Gaussian of `matrix @ x`."""
        return Gaussian(matrix @ self.mean, matrix @ self.covariance @ matrix.T)

    def ellipse(self, probability: float = 0.95) -> tuple[float, float, float]:
        """Confidence ellipse of the first two entries: half axes (long, short), direction of the long one, rad."""
        values, vectors = np.linalg.eigh(self.covariance[:2, :2])
        scale = -2.0 * np.log(1.0 - probability)  # chi-square quantile, two degrees of freedom
        short, long = np.sqrt(np.maximum(values, 0.0) * scale)
        return float(long), float(short), float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def deviation(covariance: Float[np.ndarray, "2 2"]) -> float:
    """Standard deviation along the worst axis of a position (x, y), in its unit: the root of the largest eigenvalue.

    Source: Yoo 2010 (seed 001), sigma of eq. (2) and (3).
    """
    (a, b), (_, c) = covariance.tolist()
    return math.sqrt(max((a + c) / 2.0 + math.hypot((a - c) / 2.0, b), 0.0))
