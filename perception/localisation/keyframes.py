"""Poses of keyframes, correlated with the state of a filter that does not estimate them.

If a map drawn from the robot's own estimates corrected these estimates, information would be counted twice.
So the poses of the keyframes stay part of the joint estimate: each is a copy of the pose at its time, and
every correction reaches all of them through their correlation (stochastic cloning, delayed states).

The filter itself runs unchanged. Its state x and the keyframe poses m are modelled as m = G x + d, with d
independent of x and of covariance D. An update of x moves m by G and changes neither G nor D; only prediction,
which adds noise to x, and registration, which measures m, change them. So the filter need not know of the
keyframes, and the joint covariance stays positive.

Source: Roumeliotis, Burdick, "Stochastic cloning" (ICRA 2002); Eustice, Singh, Leonard, "Exactly sparse
delayed-state filters" (T-RO 2006); the form m = G x + d is ours (it is the smoother gain of Rauch, Tung,
Striebel 1965).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..filtering.models import YAW, positive, symmetric
from ..primitives.gaussian import Gaussian
from ..primitives.pose import wrap_angle

POSE_SIZE = 3
"""Entries of a keyframe pose: x, y, yaw; m, m, rad, world frame."""

RESET_LENGTH = 40.0
"""Squared Mahalanobis length of three entries that an update exceeds with a probability of 1e-8."""


class KeyframePoses:
    """Joint estimate of k keyframe poses and a state x of n entries that another filter estimates."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.mean: Float[np.ndarray, "m"] = np.zeros(0)
        self._G: Float[np.ndarray, "m n"] = np.zeros((0, size))
        self._D: Float[np.ndarray, "m m"] = np.zeros((0, 0))

    def __len__(self) -> int:
        return len(self.mean) // POSE_SIZE

    def pose(self, index: int) -> Float[np.ndarray, "3"]:
        """Mean of one of them; negative indices count from the end."""
        return self.mean.reshape(-1, POSE_SIZE)[index]

    def predict(
        self,
        before: Gaussian,
        F: Float[np.ndarray, "n n"],
        predicted: Gaussian,
        after: Gaussian,
    ) -> None:
        """Follow a prediction of the filter, and an update with the gyro in the same call.

        Args:
            before: x.
            F: Jacobian of the motion.
            predicted: x after the motion alone, with covariance F P F^T + Q.
            after: x as the filter has it now.
        """
        if len(self.mean) == 0:
            return
        J = _solve(predicted.covariance, F @ before.covariance).T
        rest = before.covariance - J @ predicted.covariance @ J.T
        self._D = symmetric(self._D + self._G @ symmetric(rest) @ self._G.T)
        self._G = self._G @ J
        self.correct(predicted, after)

    def correct(self, before: Gaussian, after: Gaussian) -> None:
        """Follow an update of the filter, or a reset of its pose.

        An update never increases a covariance, nor moves a mean further than the covariance before allows. Where this
        happens the filter has been reset: the keyframes stay and are no longer correlated with x.
        """
        if len(self.mean) == 0:
            return
        step = after.mean - before.mean
        step[YAW] = wrap_angle(float(step[YAW]))
        if _was_reset(before.covariance, after.covariance, step):
            self.decorrelate(before)
            return
        self.mean = self.mean + self._G @ step

    def decorrelate(self, x: Gaussian) -> None:
        """The robot was displaced: x is no longer correlated with the keyframes."""
        self._D = self._joint(x)[0]
        self._G = np.zeros_like(self._G)

    def clone(
        self, x: Gaussian, B: Float[np.ndarray, "3 n"], noise: Float[np.ndarray, "3 3"]
    ) -> None:
        """Append the keyframe pose B x with noise of its own."""
        m = len(self.mean)
        self.mean = np.concatenate([self.mean, B @ x.mean])
        self._G = np.concatenate([self._G, B])
        D = np.zeros((m + POSE_SIZE, m + POSE_SIZE))
        D[:m, :m], D[m:, m:] = self._D, noise
        self._D = D

    def drop(self, index: int) -> None:
        """Remove a keyframe."""
        rows = np.arange(POSE_SIZE) + POSE_SIZE * (index % len(self))
        self.mean = np.delete(self.mean, rows)
        self._G = np.delete(self._G, rows, axis=0)
        self._D = np.delete(np.delete(self._D, rows, axis=0), rows, axis=1)

    def covariance(self, x: Gaussian, indices: list[int]) -> Float[np.ndarray, "r r"]:
        """Joint covariance of some of the keyframes."""
        rows = _rows(indices)
        G = self._G[rows]
        return symmetric(G @ x.covariance @ G.T + self._D[np.ix_(rows, rows)])

    def innovation_covariance(
        self, x: Gaussian, indices: list[int], H: Float[np.ndarray, "z r"]
    ) -> Float[np.ndarray, "z z"]:
        """Innovation covariance of a measurement H m of some keyframes with unit noise."""
        return np.asarray(H @ self.covariance(x, indices) @ H.T + np.eye(len(H)))

    def update(
        self,
        x: Gaussian,
        indices: list[int],
        H: Float[np.ndarray, "z r"],
        innovation: Float[np.ndarray, "z"],
    ) -> Gaussian:
        """Update all keyframes and x with a measurement of some keyframes with unit noise.

        Returns:
            x afterwards, for the filter.
        """
        rows = _rows(indices)
        M, C = self._joint(x)
        S = H @ M[np.ix_(rows, rows)] @ H.T + np.eye(len(H))
        gain_m = np.linalg.solve(S, H @ M[rows]).T
        gain_x = np.linalg.solve(S, H @ C[:, rows].T).T
        P = positive(x.covariance - gain_x @ S @ gain_x.T)
        C = C - gain_x @ S @ gain_m.T
        M = symmetric(M - gain_m @ S @ gain_m.T)
        self._G = _solve(P, C).T
        self._D = symmetric(M - self._G @ P @ self._G.T)
        self.mean = self.mean + gain_m @ innovation
        mean = x.mean + gain_x @ innovation
        mean[YAW] = wrap_angle(float(mean[YAW]))
        return Gaussian(mean, P)

    def _joint(self, x: Gaussian) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "n m"]]:
        """Covariance of the keyframes, and of x with them."""
        PG = x.covariance @ self._G.T
        return symmetric(self._G @ PG + self._D), PG


def _rows(indices: list[int]) -> np.ndarray:
    return (np.array(indices)[:, None] * POSE_SIZE + np.arange(POSE_SIZE)).ravel()


def _solve(P: Float[np.ndarray, "n n"], right: np.ndarray) -> np.ndarray:
    """P^-1 right for a covariance whose entries have very different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(P), 1e-30))
    even = P * scale[:, None] * scale + 1e-10 * np.eye(len(P))
    if right.ndim == 1:
        return np.asarray(scale * np.linalg.solve(even, scale * right))
    return np.asarray(scale[:, None] * np.linalg.solve(even, scale[:, None] * right))


def _was_reset(
    before: Float[np.ndarray, "n n"], after: Float[np.ndarray, "n n"], step: Float[np.ndarray, "n"]
) -> bool:
    """Whether the pose has become clearly less certain, or has jumped."""
    was, now = before[:POSE_SIZE, :POSE_SIZE], after[:POSE_SIZE, :POSE_SIZE]
    widened = np.any(np.diag(now) > 1.05 * np.diag(was) + 1e-9)
    jump = float(step[:POSE_SIZE] @ _solve(was, step[:POSE_SIZE]))
    return bool(widened or jump > RESET_LENGTH)
