"""Square-root unscented Kalman filter, compiled.

It gives the same results as the textbook filter (the tests compare it with filterpy) but propagates the root of the
covariance, and never subtracts: prediction and update form a matrix of deviations and reduce it to the next root by
reflections. Zero noise, huge noise and a thousand repetitions of one measurement leave the covariance positive
definite; input that is not finite is refused and reported.

`SquareRootFilter` takes any models, as functions of all sigma points at once.

Source: van der Merwe, Wan, "The square-root unscented Kalman filter for state and parameter-estimation"
(ICASSP 2001); the update as one triangularisation after Kailath, Sayed, Hassibi, "Linear Estimation"
(2000), section 12.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from . import _square_root_kernels as kernels
from .consistency import Innovation
from .models import positive, spread

Model = Callable[[np.ndarray], np.ndarray]
"""Maps sigma points (k, n) to (k, n) for a motion, to (k, m) for a measurement."""


class SigmaPoints(NamedTuple):
    """Positions and weights of the points of the scaled unscented transform.

    Args:
        reach: Distance of the points from the mean, in standard deviations.
        mean: (2 n + 1,), weights of the mean; the centre comes first.
        covariance: (2 n + 1,), weights of the covariance; only the first may be negative.
    """

    reach: float
    mean: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "k"]

    @classmethod
    def scaled(
        cls, size: int, alpha: float | None = None, beta: float = 2.0, kappa: float = 0.0
    ) -> SigmaPoints:
        """The transform by van der Merwe's three parameters.

        Args:
            size: n, of the state.
            alpha: Spread; by default that of `models.spread`, points sqrt(3) standard deviations out.
            beta: 2 for a Gaussian.
            kappa: Second scaling.
        """
        alpha = spread(size) if alpha is None else alpha
        power = alpha**2 * (size + kappa)
        if size < 1 or not (math.isfinite(power) and power > 0.0):
            raise ConfigError(
                f"sigma points: size={size}, alpha={alpha}, kappa={kappa} are invalid; "
                "alpha^2 (size + kappa) must be positive"
            )
        mean = np.full(2 * size + 1, 0.5 / power)
        covariance = mean.copy()
        mean[0] = 1.0 - size / power
        covariance[0] = mean[0] + 1.0 - alpha**2 + beta
        return cls(math.sqrt(power), mean, covariance)


class SquareRootFilter:
    """Mean and root of the covariance of a state."""

    def __init__(
        self, start: Gaussian, angles: Collection[int] = (), points: SigmaPoints | None = None
    ) -> None:
        """Start at a prior.

        Args:
            start: Over the state (n,); the covariance symmetric, and positive up to rounding.
            angles: Which entries are angles, rad.
            points: Of the transform; the default of `SigmaPoints.scaled` if None.

        Raises:
            ConfigError: The prior is not finite.
        """
        size = len(start.mean)
        if not (np.all(np.isfinite(start.mean)) and np.all(np.isfinite(start.covariance))):
            raise ConfigError(f"filter: start {start.mean} and its covariance must be finite")
        self.points = points or SigmaPoints.scaled(size)
        self._angles = np.zeros(size, np.bool_)
        self._angles[list(angles)] = True
        self.log_density = -math.inf  # of the last measurement, used or not
        self._mean = np.zeros(size)
        self._root = np.zeros((size, size))
        self.reset(start)

    def reset(self, belief: Gaussian) -> None:
        """Replace mean and covariance; finite, of the same size."""
        self._mean[:] = belief.mean
        self._root[:] = np.linalg.cholesky(positive(belief.covariance))

    @property
    def mean(self) -> Float[np.ndarray, "n"]:
        """Mean of the state; a copy."""
        return self._mean.copy()

    @property
    def root(self) -> Float[np.ndarray, "n n"]:
        """Lower root L with positive diagonal, L L^T the covariance; a copy."""
        return self._root.copy()

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """Covariance, symmetric and positive definite."""
        P = self._root @ self._root.T
        return np.asarray((P + P.T) / 2.0)

    @property
    def belief(self) -> Gaussian:
        """Mean and covariance."""
        return Gaussian(self.mean, self.covariance)

    def sigma_points(self) -> Float[np.ndarray, "k n"]:
        """Sigma points of mean and covariance."""
        points = np.empty((2 * len(self._mean) + 1, len(self._mean)))
        kernels.draw(self._mean, self._root, self.points.reach, points)
        return points

    def predict(self, move: Model, noise: Float[np.ndarray, "n n"]) -> bool:
        """Predict by a motion model.

        Args:
            move: Maps sigma points (k, n) to their next states.
            noise: Covariance added by the motion; zero is allowed.

        Returns:
            False, with the state unchanged, if the noise is not a covariance or a value is not finite.
        """
        n = len(self._mean)
        noise_root = np.zeros((n, n))
        if not kernels.root_of(np.asarray(noise, float), n, noise_root):
            return False
        moved = np.ascontiguousarray(move(self.sigma_points()), float)
        return bool(
            kernels.predicted(
                moved,
                self.points.mean,
                self.points.covariance,
                noise_root,
                self._angles,
                self._mean,
                self._root,
                np.empty((n, 3 * n + 1)),
                np.empty((2, n)),
                np.empty((n, n)),
            )
        )

    def update(
        self,
        see: Model,
        measured: Float[np.ndarray, "m"],
        noise: Float[np.ndarray, "m m"],
        angles: Collection[int] = (),
        gate: float = math.inf,
    ) -> tuple[bool, Innovation | None]:
        """Update with a measurement.

        Args:
            see: Maps sigma points (k, n) to their predicted measurements (k, m).
            measured: The measurement.
            noise: Its covariance; zero is allowed.
            angles: Which of its entries are angles, rad.
            gate: Largest normalised innovation squared that is accepted.

        Returns:
            Whether the measurement was used, and its innovation: None if measurement, model or noise are not
            finite or the noise is not a covariance. Otherwise the state is unchanged.
        """
        n, m = len(self._mean), len(measured)
        noise_root, innovation = np.zeros((m, m)), np.zeros(m)
        if not kernels.root_of(np.asarray(noise, float), m, noise_root):
            return False, None
        points = self.sigma_points()
        seen = np.ascontiguousarray(see(points), float)
        angles_seen = np.zeros(m, np.bool_)
        angles_seen[list(angles)] = True
        status, self.log_density = kernels.corrected(
            points,
            seen,
            self.points.mean,
            self.points.covariance,
            np.asarray(measured, float),
            noise_root,
            self._angles,
            angles_seen,
            float(gate),
            self._mean,
            self._root,
            innovation,
            np.empty((n + m, 2 * n + 1 + m)),
            np.empty((2, n + m)),
            np.empty((n + m, n + m)),
        )
        return status == 1, None if status < 0 else Innovation(None, innovation)
