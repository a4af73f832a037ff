"""Engines of the walking robot's unscented Kalman filter: compiled, and filterpy.

Both hold a Gaussian over the state of `filtering.models` and give the same estimates. `filterpy` serves as a
readable reference; `compiled` is several times faster and its covariance cannot lose its positivity.

Source: seed 001, section 3 (sigma-point filter).
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..filtering import models
from ..filtering.models import (
    DRIFT,
    GYRO_BIAS,
    LATERAL_SLIP,
    PAN,
    RANGE,
    SLIP,
    TURN,
    WALKER_SIZE,
    YAW,
    X,
    Y,
)
from ..filtering.square_root import SquareRootFilter
from ..primitives.errors import ConfigError
from ..primitives.gaussian import Gaussian
from ..primitives.pose import Pose2

ENGINES = ("compiled", "filterpy")


@runtime_checkable
class UkfEngine(Protocol):
    """A Gaussian over the robot's state, with prediction and update."""

    @property
    def state(self) -> Gaussian:
        """Mean and covariance, (10,) and (10, 10)."""

    def reset(self, state: Gaussian) -> None:
        """Replace mean and covariance."""

    def predict(self, motion: Pose2, steps: float, noise: Float[np.ndarray, "10 10"]) -> None:
        """Advance by the motion of step odometry."""

    def update_turn(self, turn_rad: float, sigma_rad: float, dt: float) -> None:
        """Update with the gyro's integral over dt seconds."""

    def expected(
        self, places: Float[np.ndarray, "k 2"], sigmas: Float[np.ndarray, "k"]
    ) -> Gaussian:
        """Expected (range, bearing, ...) of positions, without noise; sigmas are those of the ranges, m."""

    def update(
        self,
        measured: Float[np.ndarray, "m"],
        noise: Float[np.ndarray, "m m"],
        places: Float[np.ndarray, "k 2"],
        sigmas: Float[np.ndarray, "k"],
    ) -> None:
        """Update with (range, bearing, ...) of landmarks at these positions."""


def ukf_engine(name: str, start: Gaussian) -> UkfEngine:
    """The engine of that name, in this state.

    Raises:
        ConfigError: The name is unknown.
    """
    if name == "compiled":
        return CompiledUkf(start)
    if name == "filterpy":
        return FilterpyUkf(start)
    raise ConfigError(f"localiser: engine={name!r} is unknown; choose {', '.join(ENGINES)}")


class CompiledUkf:
    """Engine by `SquareRootFilter`; methods as in `UkfEngine`."""

    def __init__(self, start: Gaussian) -> None:
        self._filter = SquareRootFilter(start, angles=(YAW,))

    @property
    def state(self) -> Gaussian:
        return self._filter.belief

    def reset(self, state: Gaussian) -> None:
        self._filter.reset(state)

    def predict(self, motion: Pose2, steps: float, noise: Float[np.ndarray, "10 10"]) -> None:
        self._filter.predict(lambda points: predict_all(points, motion, steps), noise)

    def update_turn(self, turn_rad: float, sigma_rad: float, dt: float) -> None:
        self._filter.update(
            lambda points: points[:, TURN : TURN + 1] + points[:, GYRO_BIAS : GYRO_BIAS + 1] * dt,
            np.array([turn_rad]),
            np.array([[sigma_rad**2]]),
        )

    def expected(
        self, places: Float[np.ndarray, "k 2"], sigmas: Float[np.ndarray, "k"]
    ) -> Gaussian:
        points, weights = self._filter.sigma_points(), self._filter.points
        seen = measure_all(points, places, sigmas)
        return _transformed(seen, weights.mean, weights.covariance)

    def update(
        self,
        measured: Float[np.ndarray, "m"],
        noise: Float[np.ndarray, "m m"],
        places: Float[np.ndarray, "k 2"],
        sigmas: Float[np.ndarray, "k"],
    ) -> None:
        bearings = range(1, len(measured), 2)
        self._filter.update(
            lambda points: measure_all(points, places, sigmas), measured, noise, bearings
        )


class FilterpyUkf:
    """Engine by filterpy, which only this class imports; methods as in `UkfEngine`."""

    def __init__(self, start: Gaussian) -> None:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # slow to import

        points = MerweScaledSigmaPoints(
            WALKER_SIZE,
            models.spread(WALKER_SIZE),
            2.0,
            0.0,
            sqrt_method=models.square_root,
            subtract=np.subtract,
        )
        self._filter: Any = UnscentedKalmanFilter(
            dim_x=WALKER_SIZE,
            dim_z=2,
            dt=0.325,
            hx=models.sighted,
            fx=models.walk,
            points=points,
            x_mean_fn=models.walker_mean,
            z_mean_fn=models.sighting_mean,
            residual_x=models.walker_difference,
            residual_z=models.sighting_difference,
            state_add=models.walker_sum,
        )
        self.reset(start)

    def __getstate__(self) -> dict[str, np.ndarray]:
        return {"x": self._filter.x, "P": self._filter.P, "sigmas_f": self._filter.sigmas_f}

    def __setstate__(self, state: dict[str, np.ndarray]) -> None:
        self.__init__(Gaussian(state["x"], state["P"]))  # type: ignore[misc]
        vars(self._filter).update(state)

    @property
    def state(self) -> Gaussian:
        return Gaussian(self._filter.x.copy(), self._filter.P.copy())

    def reset(self, state: Gaussian) -> None:
        self._filter.x, self._filter.P = np.array(state.mean), np.array(state.covariance)
        self._condition()

    def predict(self, motion: Pose2, steps: float, noise: Float[np.ndarray, "10 10"]) -> None:
        self._filter.Q = noise
        self._filter.predict(0.0, motion=motion, steps=steps)
        self._condition()

    def update_turn(self, turn_rad: float, sigma_rad: float, dt: float) -> None:
        self._filter.update(
            np.array([turn_rad]),
            R=np.array([[sigma_rad**2]]),
            UT=_linear_transform,
            hx=models.gyro_turn,
            dt=dt,
        )
        self._condition()

    def expected(
        self, places: Float[np.ndarray, "k 2"], sigmas: Float[np.ndarray, "k"]
    ) -> Gaussian:
        seen = [models.sighted(point, places, sigmas) for point in self._filter.sigmas_f]
        return _transformed(np.array(seen), self._filter.Wm, self._filter.Wc)

    def update(
        self,
        measured: Float[np.ndarray, "m"],
        noise: Float[np.ndarray, "m m"],
        places: Float[np.ndarray, "k 2"],
        sigmas: Float[np.ndarray, "k"],
    ) -> None:
        self._filter.update(measured, R=noise, places=places, sigmas=sigmas)
        self._condition()

    def _condition(self) -> None:
        """Keep the covariance symmetric and positive, and draw the sigma points for the next update."""
        self._filter.P = models.positive(self._filter.P)
        self._filter.sigmas_f = self._filter.points_fn.sigma_points(self._filter.x, self._filter.P)


def predict_all(points: np.ndarray, motion: Pose2, steps: float) -> np.ndarray:
    """`models.walk` for all states (k, 10) at once."""
    ahead = motion.x + points[:, SLIP] * steps
    left = motion.y + points[:, LATERAL_SLIP] * steps
    turn = motion.yaw + points[:, DRIFT] * steps
    c, s = np.cos(points[:, YAW]), np.sin(points[:, YAW])
    after = points.copy()
    after[:, X] += c * ahead - s * left
    after[:, Y] += s * ahead + c * left
    after[:, YAW] += turn  # circular mean, wrapped by the filter
    after[:, TURN] = turn
    return after


def measure_all(points: np.ndarray, places: np.ndarray, sigmas: np.ndarray) -> np.ndarray:
    """`models.sighted` for all states (k, 10) at once: (k, 2 m)."""
    x = places[:, 0] - points[:, X : X + 1]
    y = places[:, 1] - points[:, Y : Y + 1]
    seen = np.empty((len(points), 2 * len(places)))
    seen[:, 0::2] = np.hypot(x, y) + points[:, RANGE : RANGE + 1] * sigmas
    bearing = np.arctan2(y, x) - points[:, YAW : YAW + 1]
    seen[:, 1::2] = models.wrap_angles(bearing) + points[:, PAN : PAN + 1]
    return seen


def _transformed(seen: np.ndarray, weights_mean: np.ndarray, weights: np.ndarray) -> Gaussian:
    """Unscented transform of (range, bearing, ...) of all points."""
    mean = models.sighting_mean(seen, weights_mean)
    spread = np.array([models.sighting_difference(row, mean) for row in seen])
    return Gaussian(mean, spread.T @ (weights[:, None] * spread))


def _linear_transform(
    points: np.ndarray,
    mean_weights: np.ndarray,
    weights: np.ndarray,
    noise: np.ndarray,
    *_: object,
) -> tuple[np.ndarray, np.ndarray]:
    """Unscented transform of quantities that are not angles."""
    mean = mean_weights @ points
    spread = points - mean
    return mean, spread.T @ (weights[:, None] * spread) + noise
