"""Heights and slopes of all surfaces together, with the errors that the views share.

The state holds three numbers per surface (height, two slopes), then the error of the camera's pose in the view at hand,
then two kinds of errors that stay from view to view: those of the camera's pose (joint offsets) and the coefficients of the
sensor's distortion. The latter two are never estimated, only their correlation with the surfaces is kept (Schmidt 1966):
however many like views are fused, the variance does not fall below what they share. The error of the view is estimated,
so that a surface that is known tells where the camera is, and the camera the height of the next surface.

The gain takes the distortion of each region as its own, as in `perception.terrain.staircase`: trust in the exact shape of
the distortion would make differences of heights too sure. The covariance is that of this gain, with all correlations (Joseph).

Source: Schmidt 1966, Application of state-space methods to navigation problems; the rest ours.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from .measured import Level

POSE = 6  # translation and rotation of the camera
HEIGHT = 3  # z, dz/dx, dz/dy
LEAST_VARIANCE = 1e-12  # m^2 or rad^2, against division by zero


class HeightFilter:
    """Gaussian of (height, slopes) of every surface, about its origin."""

    def __init__(self, coefficients: int | None) -> None:
        """No surface; the number of coefficients of the sensor's distortion, None if it is not known yet."""
        self.mean = np.zeros(0)
        self.coefficients = coefficients
        self.camera = np.zeros(POSE)  # error of the pose of this view
        last = POSE + (coefficients or 0)
        self._P = np.diag(np.concatenate([np.zeros(POSE), np.ones(last)]))
        self._lasting = np.zeros((POSE, POSE))

    def takes(self, coefficients: int) -> bool:
        """Whether regions with so many coefficients are of the sensor; the first ones always are."""
        if self.coefficients is None:
            size = len(self._P)
            P = np.eye(size + coefficients)
            P[:size, :size] = self._P
            self.coefficients, self._P = coefficients, P
        return self.coefficients == coefficients

    def __len__(self) -> int:
        return len(self.mean) // HEIGHT

    def covariance(self, index: int) -> Float[np.ndarray, "3 3"]:
        """Of one surface."""
        here = self._rows(index)
        return self._P[here, here].copy()

    def camera_error(
        self,
    ) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 m"], Float[np.ndarray, "k m"]]:
        """Error of the pose of the view at hand, as the surfaces that it showed have corrected it.

        What lasts is corrected with it, as far as the surfaces show it, and what they err by comes in.

        Returns:
            Covariance of what is new in this view; changes of the pose by independent unit errors that stay from view to
            view; and the changes of the coefficients of the distortion by the same errors.

        Source: ours; what is new is the covariance given all that stays (Schur complement).
        """
        n = len(self.mean)
        here = slice(n, n + POSE)
        stays = np.r_[0:n, n + POSE : len(self._P)]
        values, vectors = np.linalg.eigh(self._P[np.ix_(stays, stays)])
        sigma = np.sqrt(np.maximum(values, LEAST_VARIANCE))
        units = vectors * sigma
        shared = self._P[here, stays] @ vectors / sigma
        new = self._P[here, here] - shared @ shared.T
        return new, shared + self._lasting @ units[n : n + POSE], units[n + POSE :]

    def begin_view(
        self, single: Float[np.ndarray, "6 6"], lasting: Float[np.ndarray, "6 6"]
    ) -> None:
        """Forget the camera error of the last view.

        Args:
            single: Covariance of the error of this view alone.
            lasting: Root (columns of one standard deviation) of the part that is the same in every view.
        """
        n = len(self.mean)
        here = slice(n, n + POSE)
        self._P[here], self._P[:, here] = 0.0, 0.0
        self._P[here, here] = single
        self.camera[:] = 0.0
        self._lasting = lasting

    def distance(self, index: int, level: Level) -> tuple[float, float]:
        """Squared Mahalanobis distance of a measurement to a surface (3 degrees of freedom), and its log volume."""
        H = self._design(index, level)
        S = H @ self._P @ H.T + level.noise
        e = self._innovation(index, level)
        return float(e @ np.linalg.solve(S, e)), float(np.linalg.slogdet(S)[1])

    def update(self, index: int, level: Level) -> None:
        """Fuse a measurement of a surface."""
        H = self._design(index, level)
        S = H @ self._P @ H.T + level.noise
        weighing = S + level.shared @ level.shared.T
        self._apply(H, self._innovation(index, level), S, weighing)

    def add(self, level: Level) -> None:
        """A new surface, as measured; the last one."""
        n, size = len(self.mean), len(self._P)
        G = np.zeros((HEIGHT, size))
        G[:, n : n + POSE] = level.by_camera
        G[:, n + POSE : n + 2 * POSE] = level.by_camera @ self._lasting
        G[:, n + 2 * POSE :] = level.shared
        self._insert(level.value + level.by_camera @ self.camera, G @ self._P, G, level.noise)

    def add_known(
        self, value: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"]
    ) -> None:
        """A new surface that no camera measured; the last one."""
        zero = np.zeros((HEIGHT, len(self._P)))
        self._insert(value, zero, zero, covariance)

    def pin(
        self, index: int, away: Float[np.ndarray, "2"], height_m: float, sigma_m: float
    ) -> bool:
        """Fuse the height of one point of a surface; False if it contradicts beyond 3 sigma.

        Args:
            index: Of the surface.
            away: Of the point, from its origin, m.
            height_m, sigma_m: Of the point.
        """
        H = np.zeros((1, len(self._P)))
        H[0, self._rows(index)] = 1.0, *away
        S = H @ self._P @ H.T + sigma_m**2
        e = np.array([height_m - float(H[0, : len(self.mean)] @ self.mean)])
        if e[0] ** 2 > 9.0 * S[0, 0]:
            return False
        self._apply(H, e, S, S)
        return True

    def equal(
        self, one: int, two: int, apart: Float[np.ndarray, "2"]
    ) -> tuple[float, Float[np.ndarray, "3 n"]]:
        """Squared Mahalanobis distance of two surfaces, and the design of their difference.

        Args:
            one, two: Surfaces.
            apart: Origin of the first less that of the second, m.
        """
        H = np.zeros((HEIGHT, len(self._P)))
        H[:, self._rows(one)] = np.eye(HEIGHT)
        shift = np.eye(HEIGHT)
        shift[0, 1:] = apart
        H[:, self._rows(two)] = -shift
        e = -H[:, : len(self.mean)] @ self.mean
        S = H @ self._P @ H.T + 1e-8 * np.eye(HEIGHT)
        return float(e @ np.linalg.solve(S, e)), H

    def join(self, one: int, two: int, apart: Float[np.ndarray, "2"]) -> None:
        """Make two surfaces one plane and forget the second; arguments as for `equal`."""
        _, H = self.equal(one, two, apart)
        e = -H[:, : len(self.mean)] @ self.mean
        S = H @ self._P @ H.T + 1e-8 * np.eye(HEIGHT)
        self._apply(H, e, S, S)
        self.remove(two)

    def moved(self, effect: Float[np.ndarray, "n 4"], covariance: Float[np.ndarray, "4 4"]) -> None:
        """Add the error of a motion, given its effect on every height and slope."""
        n = len(self.mean)
        self._P[:n, :n] += effect @ covariance @ effect.T

    def remove(self, index: int) -> None:
        """Forget a surface; those behind it move up."""
        kept = np.ones(len(self._P), np.bool_)
        kept[self._rows(index)] = False
        self.mean = self.mean[kept[: len(self.mean)]]
        self._P = self._P[np.ix_(kept, kept)]

    def _rows(self, index: int) -> slice:
        return slice(HEIGHT * index, HEIGHT * (index + 1))

    def _innovation(self, index: int, level: Level) -> Float[np.ndarray, "3"]:
        """What a measurement, with the camera error so far, says more than the surface."""
        return level.value + level.by_camera @ self.camera - self.mean[self._rows(index)]

    def _design(self, index: int, level: Level) -> Float[np.ndarray, "3 m"]:
        """Derivative of a measurement by the state."""
        n = len(self.mean)
        H = np.zeros((HEIGHT, len(self._P)))
        H[:, self._rows(index)] = np.eye(HEIGHT)
        H[:, n : n + POSE] = -level.by_camera
        H[:, n + POSE : n + 2 * POSE] = -level.by_camera @ self._lasting
        H[:, n + 2 * POSE :] = -level.shared
        return H

    def _apply(
        self,
        H: Float[np.ndarray, "k m"],
        innovation: Float[np.ndarray, "k"],
        S: Float[np.ndarray, "k k"],
        weighing: Float[np.ndarray, "k k"],
    ) -> None:
        """Update of the surfaces and of the camera; what lasts keeps its variance."""
        n = len(self.mean)
        PH = self._P @ H.T
        K = PH @ np.linalg.inv(weighing)
        K[n + POSE :] = 0.0
        step = K @ innovation
        self.mean = self.mean + step[:n]
        self.camera = self.camera + step[n : n + POSE]
        change = K @ PH.T
        P = self._P - change - change.T + K @ S @ K.T
        self._P = (P + P.T) / 2.0

    def _insert(
        self,
        value: Float[np.ndarray, "3"],
        cross: Float[np.ndarray, "3 m"],
        G: Float[np.ndarray, "3 m"],
        noise: Float[np.ndarray, "3 3"],
    ) -> None:
        """Put a surface behind the others, with its covariance with the whole state."""
        n, size = len(self.mean), len(self._P)
        P = np.zeros((size + HEIGHT, size + HEIGHT))
        old = np.r_[0:n, n + HEIGHT : size + HEIGHT]
        new = slice(n, n + HEIGHT)
        P[np.ix_(old, old)] = self._P
        P[new, new] = cross @ G.T + noise
        P[new, old], P[old, new] = cross, cross.T
        self._P = P
        self.mean = np.concatenate([self.mean, value])
