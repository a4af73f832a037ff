"""A sigma-point filter that cannot lose its positivity: the unscented filter in square-root form, compiled.

It gives the numbers of the textbook filter (filterpy's, which the tests hold it against) but carries the
root of the covariance instead of the covariance, and never subtracts: prediction and measurement lay
deviations side by side and turn them into the next root by reflections. Zero noise, huge noise and the same
measurement a thousand times leave it positive definite; what is not finite is refused, aloud.

`SquareRootFilter` takes any models, as functions of all sigma points at once. `step_movers` advances many
constant-velocity movers in one call, for which the whole step is compiled.

Source: van der Merwe, Wan, "The square-root unscented Kalman filter for state and parameter-estimation"
(ICASSP 2001); the measurement as one triangularisation after Kailath, Sayed, Hassibi, "Linear Estimation"
(2000), section 12.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int8

from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from . import _mover_kernels
from . import _square_root_kernels as kernels
from .consistency import Innovation
from .models import positive, spread

Model = Callable[[np.ndarray], np.ndarray]
"""What becomes of sigma points (k, n): (k, n) for a motion, (k, m) for a measurement."""


@dataclass(frozen=True)
class SigmaPoints:
    """Where the points of the scaled unscented transform lie, and what each counts.

    Args:
        reach: Distance of the points from the mean, in deviations.
        mean: (2 n + 1,), weights of the mean; the centre comes first.
        covariance: (2 n + 1,), weights of the covariance; only the first may be negative.
    """

    reach: float
    mean: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "k"]

    @cached_property
    def packed(self) -> Float[np.ndarray, "p"]:
        """Reach, weights of the mean, weights of the covariance: one array, which costs a call less."""
        return np.concatenate([[self.reach], self.mean, self.covariance])

    @classmethod
    def scaled(
        cls, size: int, alpha: float | None = None, beta: float = 2.0, kappa: float = 0.0
    ) -> SigmaPoints:
        """By van der Merwe's three numbers.

        Args:
            size: n, of the state.
            alpha: Spread; by default as `models.spread`, points sqrt(3) deviations out.
            beta: 2 for a Gaussian.
            kappa: Second scaling.
        """
        alpha = spread(size) if alpha is None else alpha
        power = alpha**2 * (size + kappa)
        if size < 1 or not (math.isfinite(power) and power > 0.0):
            raise ConfigError(
                f"sigma points: size={size}, alpha={alpha}, kappa={kappa} put them nowhere; "
                "alpha^2 (size + kappa) must be positive"
            )
        mean = np.full(2 * size + 1, 0.5 / power)
        covariance = mean.copy()
        mean[0] = 1.0 - size / power
        covariance[0] = mean[0] + 1.0 - alpha**2 + beta
        return cls(math.sqrt(power), mean, covariance)


class SquareRootFilter:
    """Mean and root of the covariance of a state; `predict` moves it, `update` learns."""

    def __init__(
        self, start: Gaussian, angles: Collection[int] = (), points: SigmaPoints | None = None
    ) -> None:
        """Begin at a belief.

        Args:
            start: Over the state (n,); the covariance symmetric, and positive up to rounding.
            angles: Which entries are angles, rad.
            points: Of the transform; the default of `SigmaPoints.scaled` if None.

        Raises:
            ConfigError: It is not finite.
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
        """Believe this from now on; finite, of the same size."""
        self._mean[:] = belief.mean
        self._root[:] = np.linalg.cholesky(positive(belief.covariance))

    @property
    def mean(self) -> Float[np.ndarray, "n"]:
        """Of the state; a copy."""
        return self._mean.copy()

    @property
    def root(self) -> Float[np.ndarray, "n n"]:
        """L, lower, its diagonal positive, with L L^T the covariance; a copy."""
        return self._root.copy()

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """Symmetric and positive definite."""
        P = self._root @ self._root.T
        return np.asarray((P + P.T) / 2.0)

    @property
    def belief(self) -> Gaussian:
        """Mean and covariance."""
        return Gaussian(self.mean, self.covariance)

    def sigma_points(self) -> Float[np.ndarray, "k n"]:
        """Those of the present belief."""
        points = np.empty((2 * len(self._mean) + 1, len(self._mean)))
        kernels.draw(self._mean, self._root, self.points.reach, points)
        return points

    def predict(self, move: Model, noise: Float[np.ndarray, "n n"]) -> bool:
        """Advance by a motion.

        Args:
            move: Sigma points (k, n) to where they go.
            noise: Covariance that the motion adds; zero is allowed.

        Returns:
            False, and nothing has changed, if the noise is no covariance or anything is not finite.
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
        """Learn from a measurement.

        Args:
            see: Sigma points (k, n) to what each would measure, (k, m).
            measured: What was measured.
            noise: Its covariance; zero is allowed.
            angles: Which of its entries are angles, rad.
            gate: Largest normalised innovation squared that is believed.

        Returns:
            Whether it was used, and its innovation; that is None where measurement, model or noise are not
            finite or the noise is no covariance. Unless it was used nothing has changed.
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


_FOUR = SigmaPoints.scaled(4)


def step_movers(
    means: Float[np.ndarray, "k 4"],
    roots: Float[np.ndarray, "k 4 4"],
    dt: float,
    noise: Float[np.ndarray, "4 4"],
    measured: Float[np.ndarray, "k 2"],
    measured_noise: Float[np.ndarray, "k 2 2"],
    viewpoint: Float[np.ndarray, "3"] | None = None,
    points: SigmaPoints = _FOUR,
) -> tuple[Float[np.ndarray, "k 4"], Float[np.ndarray, "k 4 4"], Int8[np.ndarray, "k"]]:
    """Advance many movers and let each learn from one sighting, in one compiled call.

    Args:
        means: x, y, vx, vy, m and m/s, world frame.
        roots: Lower roots of their covariances.
        dt: Time passed, s.
        noise: Covariance that it adds to every mover.
        measured: (x, y), m, world frame, or, if there is a viewpoint, (range, bearing), m and rad; NaN
            where nothing was seen.
        measured_noise: Covariance of each.
        viewpoint: x, y, yaw of the observer, m and rad, world frame.
        points: Of the transform.

    Returns:
        Means, roots, and of each mover 1 if it has learnt, -1 if there was nothing finite to learn from.
    """
    means, roots = means.copy(), roots.copy()
    status = _mover_kernels.step_movers(
        means,
        roots,
        dt,
        noise,
        measured,
        measured_noise,
        _ORIGIN if viewpoint is None else viewpoint,
        viewpoint is not None,
        points.packed,
    )
    return means, roots, status


_ORIGIN = np.zeros(3)
