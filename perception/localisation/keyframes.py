"""Former viewpoints, believed together with the walker: what was seen from them is the map.

A map drawn from one's own estimates and then used to correct them would be counted twice. So the places
that scans were taken from stay part of the belief: each is a copy of the pose at its time, and what is
learnt of one is learnt of all, by as much as they hang together (stochastic cloning, delayed states).

The walker's own filter goes on by itself. Its state x and the viewpoints m are told as m = G x + d, with d
independent of x and of covariance D. Whatever the filter learns about x moves m by G and changes neither
G nor D; only motion, which adds noise to x, and registration, which speaks of m itself, do. So the filter
need not know of the viewpoints, and the joint covariance cannot lose its positivity.

Source: Roumeliotis, Burdick, "Stochastic cloning" (ICRA 2002); Eustice, Singh, Leonard, "Exactly sparse
delayed-state filters" (T-RO 2006); the form m = G x + d is ours (it is the smoother's gain, Rauch, Tung,
Striebel 1965).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from ..filtering.models import YAW, positive, symmetric
from ..primitives.gaussian import Gaussian
from ..primitives.pose import wrap_angle

POSE = 3
"""Entries of a viewpoint: x, y, yaw; m, m, rad, world frame."""

JUMP = 40.0
"""Squared Mahalanobis length, of three entries, that no learning step has: a chance of 1e-8."""


class Viewpoints:
    """Joint belief of k former viewpoints and a state x of n entries that a filter of its own estimates."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.mean: Float[np.ndarray, "m"] = np.zeros(0)
        self._G: Float[np.ndarray, "m n"] = np.zeros((0, size))
        self._D: Float[np.ndarray, "m m"] = np.zeros((0, 0))

    def __len__(self) -> int:
        return len(self.mean) // POSE

    def pose(self, index: int) -> Float[np.ndarray, "3"]:
        """Mean of one of them; negative indices count from the end."""
        return self.mean.reshape(-1, POSE)[index]

    def moved(
        self,
        before: Gaussian,
        F: Float[np.ndarray, "n n"],
        predicted: Gaussian,
        after: Gaussian,
    ) -> None:
        """The filter has predicted, and perhaps learnt from its gyro in the same call.

        Args:
            before: x.
            F: Jacobian of the motion.
            predicted: x after the motion alone, F P F^T + Q.
            after: x as the filter has it now.
        """
        if len(self.mean) == 0:
            return
        J = _solved(predicted.covariance, F @ before.covariance).T
        rest = before.covariance - J @ predicted.covariance @ J.T
        self._D = symmetric(self._D + self._G @ symmetric(rest) @ self._G.T)
        self._G = self._G @ J
        self.learnt(predicted, after)

    def learnt(self, before: Gaussian, after: Gaussian) -> None:
        """The filter has learnt about x; or it has been carried elsewhere, and what it knew is void.

        An update never widens a covariance, nor moves a mean further than the covariance before allows.
        Where it does the filter has doubted itself: the viewpoints stay where they were and no longer hang
        together with x.
        """
        if len(self.mean) == 0:
            return
        step = after.mean - before.mean
        step[YAW] = wrap_angle(float(step[YAW]))
        if _carried(before.covariance, after.covariance, step):
            self.part(before)
            return
        self.mean = self.mean + self._G @ step

    def part(self, x: Gaussian) -> None:
        """The walker was carried elsewhere: nothing of x says anything of the viewpoints any more."""
        self._D = self._joint(x)[0]
        self._G = np.zeros_like(self._G)

    def add(
        self, x: Gaussian, B: Float[np.ndarray, "3 n"], noise: Float[np.ndarray, "3 3"]
    ) -> None:
        """Remember a viewpoint B x with noise of its own; it becomes the last one."""
        m = len(self.mean)
        self.mean = np.concatenate([self.mean, B @ x.mean])
        self._G = np.concatenate([self._G, B])
        D = np.zeros((m + POSE, m + POSE))
        D[:m, :m], D[m:, m:] = self._D, noise
        self._D = D

    def drop(self, index: int) -> None:
        """Forget a viewpoint."""
        rows = np.arange(POSE) + POSE * (index % len(self))
        self.mean = np.delete(self.mean, rows)
        self._G = np.delete(self._G, rows, axis=0)
        self._D = np.delete(np.delete(self._D, rows, axis=0), rows, axis=1)

    def covariance(self, x: Gaussian, indices: list[int]) -> Float[np.ndarray, "r r"]:
        """Joint covariance of some of the viewpoints."""
        rows = _rows(indices)
        G = self._G[rows]
        return symmetric(G @ x.covariance @ G.T + self._D[np.ix_(rows, rows)])

    def innovation_covariance(
        self, x: Gaussian, indices: list[int], H: Float[np.ndarray, "z r"]
    ) -> Float[np.ndarray, "z z"]:
        """Of a measurement H m of some of the viewpoints with unit noise."""
        return np.asarray(H @ self.covariance(x, indices) @ H.T + np.eye(len(H)))

    def learn(
        self,
        x: Gaussian,
        indices: list[int],
        H: Float[np.ndarray, "z r"],
        innovation: Float[np.ndarray, "z"],
    ) -> Gaussian:
        """A measurement, with unit noise, of some of the viewpoints: what it says of all, and of x.

        Returns:
            x afterwards; the caller hands it to the filter.
        """
        rows = _rows(indices)
        M, C = self._joint(x)
        S = H @ M[np.ix_(rows, rows)] @ H.T + np.eye(len(H))
        gain_m = np.linalg.solve(S, H @ M[rows]).T
        gain_x = np.linalg.solve(S, H @ C[:, rows].T).T
        P = positive(x.covariance - gain_x @ S @ gain_x.T)
        C = C - gain_x @ S @ gain_m.T
        M = symmetric(M - gain_m @ S @ gain_m.T)
        self._G = _solved(P, C).T
        self._D = symmetric(M - self._G @ P @ self._G.T)
        self.mean = self.mean + gain_m @ innovation
        mean = x.mean + gain_x @ innovation
        mean[YAW] = wrap_angle(float(mean[YAW]))
        return Gaussian(mean, P)

    def _joint(self, x: Gaussian) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "n m"]]:
        """Covariance of the viewpoints, and of x with them."""
        PG = x.covariance @ self._G.T
        return symmetric(self._G @ PG + self._D), PG


def _rows(indices: list[int]) -> np.ndarray:
    return (np.array(indices)[:, None] * POSE + np.arange(POSE)).ravel()


def _solved(P: Float[np.ndarray, "n n"], right: np.ndarray) -> np.ndarray:
    """P^-1 right for a covariance whose entries have very different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(P), 1e-30))
    even = P * scale[:, None] * scale + 1e-10 * np.eye(len(P))
    if right.ndim == 1:
        return np.asarray(scale * np.linalg.solve(even, scale * right))
    return np.asarray(scale[:, None] * np.linalg.solve(even, scale[:, None] * right))


def _carried(
    before: Float[np.ndarray, "n n"], after: Float[np.ndarray, "n n"], step: Float[np.ndarray, "n"]
) -> bool:
    """Whether the pose has become clearly less sure, or has jumped."""
    was, now = before[:POSE, :POSE], after[:POSE, :POSE]
    widened = np.any(np.diag(now) > 1.05 * np.diag(was) + 1e-9)
    jump = float(step[:POSE] @ _solved(was, step[:POSE]))
    return bool(widened or jump > JUMP)
