"""Keyframe poses beside a filter: equal to one large Kalman filter over both."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from perception.localisation.keyframes import KeyframePoses
from perception.primitives.gaussian import Gaussian

N = 5  # entries of the state; the third is the yaw
B = np.eye(3, N)


def covariance(rng: np.random.Generator, n: int, scale: float = 1e-3) -> np.ndarray:
    root = rng.standard_normal((n, n)) * scale
    return root @ root.T + np.eye(n) * (0.3 * scale) ** 2


class Whole:
    """Reference: one Kalman filter over the state and all keyframes."""

    def __init__(self, x: Gaussian) -> None:
        self.mean, self.P = x.mean.copy(), x.covariance.copy()

    def move(self, F: np.ndarray, step: np.ndarray, Q: np.ndarray) -> None:
        n = len(self.mean)
        whole, noise = np.eye(n), np.zeros((n, n))
        whole[:N, :N], noise[:N, :N] = F, Q
        self.P = whole @ self.P @ whole.T + noise
        self.mean = whole @ self.mean
        self.mean[:N] += step

    def clone(self, noise: np.ndarray) -> None:
        n = len(self.mean)
        copy = np.zeros((n + 3, n))
        copy[:n], copy[n:, :N] = np.eye(n), B
        self.mean, self.P = copy @ self.mean, copy @ self.P @ copy.T
        self.P[n:, n:] += noise

    def learn(self, H: np.ndarray, innovation: np.ndarray) -> None:
        S = H @ self.P @ H.T + np.eye(len(H))
        gain = np.linalg.solve(S, H @ self.P).T
        self.mean = self.mean + gain @ innovation
        self.P = self.P - gain @ S @ gain.T

    @property
    def x(self) -> Gaussian:
        return Gaussian(self.mean[:N].copy(), self.P[:N, :N].copy())


def walked(seed: int) -> tuple[KeyframePoses, Whole, Gaussian, np.random.Generator]:
    """Predict, update x alone, clone, six times; the same for both."""
    rng = np.random.default_rng(seed)
    x = Gaussian(rng.standard_normal(N) * 0.1, covariance(rng, N))
    views, whole = KeyframePoses(N), Whole(x)
    for _ in range(6):
        F = np.eye(N) + 0.2 * rng.standard_normal((N, N))
        step, Q = 0.05 * rng.standard_normal(N), covariance(rng, N, 3e-4)
        whole.move(F, step, Q)
        moved = whole.x
        H = np.zeros((2, len(whole.mean)))
        H[:, :N] = 500.0 * rng.standard_normal((2, N))
        whole.learn(H, 0.3 * rng.standard_normal(2))
        views.predict(x, F, moved, whole.x)
        x = whole.x
        noise = covariance(rng, 3, 2e-4)
        views.clone(x, B, noise)
        whole.clone(noise)
    return views, whole, x, rng


def test_updates_of_the_filter_correct_the_keyframes_as_in_one_filter() -> None:
    views, whole, x, _ = walked(0)
    assert_allclose(views.mean, whole.mean[N:], atol=1e-9)
    assert_allclose(views.covariance(x, list(range(6))), whole.P[N:, N:], rtol=1e-5, atol=1e-11)


def test_a_measurement_of_keyframes_corrects_the_state_as_in_one_filter() -> None:
    views, whole, x, rng = walked(1)
    chosen = [5, 1, 3]
    H = 300.0 * rng.standard_normal((4, 9))
    innovation = 0.5 * rng.standard_normal(4)
    wide = np.zeros((4, len(whole.mean)))
    for k, index in enumerate(chosen):
        wide[:, N + 3 * index : N + 3 * index + 3] = H[:, 3 * k : 3 * k + 3]
    after = views.update(x, chosen, H, innovation)
    whole.learn(wide, innovation)
    assert_allclose(after.mean, whole.mean[:N], atol=1e-8)
    assert_allclose(after.covariance, whole.P[:N, :N], rtol=1e-5, atol=1e-10)
    assert_allclose(views.mean, whole.mean[N:], atol=1e-8)
    assert_allclose(views.covariance(after, list(range(6))), whole.P[N:, N:], rtol=1e-4, atol=1e-10)


def test_dropping_a_keyframe_leaves_the_others_unchanged() -> None:
    views, whole, x, _ = walked(2)
    views.drop(2)
    kept = [k for k in range(len(whole.mean)) if not N + 6 <= k < N + 9]
    assert len(views) == 5
    assert_allclose(views.mean, whole.mean[kept][N:], atol=1e-9)
    left = whole.P[np.ix_(kept, kept)][N:, N:]
    assert_allclose(views.covariance(x, list(range(5))), left, rtol=1e-5, atol=1e-11)


def test_the_joint_covariance_stays_positive_over_a_long_run() -> None:
    views, _, x, rng = walked(3)
    for _ in range(200):
        F = np.eye(N) + 0.01 * rng.standard_normal((N, N))
        moved = Gaussian(F @ x.mean, F @ x.covariance @ F.T + covariance(rng, N, 1e-4))
        views.predict(x, F, moved, moved)
        x = views.update(moved, [0, 5], 1e3 * rng.standard_normal((3, 6)), np.zeros(3))
        assert np.linalg.eigvalsh(x.covariance).min() > 0.0
        assert np.linalg.eigvalsh(views.covariance(x, list(range(6)))).min() > 0.0


def test_a_reset_of_the_filter_does_not_move_the_keyframes() -> None:
    views, _, x, _ = walked(4)
    before, certain = views.mean.copy(), views.covariance(x, list(range(6)))
    there = x.mean.copy()
    there[0] += 0.5
    views.correct(x, Gaussian(there, x.covariance))
    assert_allclose(views.mean, before)
    assert_allclose(views.covariance(x, list(range(6))), certain, rtol=1e-9)
    widened = Gaussian(there, 100.0 * x.covariance)
    views.correct(Gaussian(there, x.covariance), widened)
    assert_allclose(views.covariance(widened, list(range(6))), certain, rtol=1e-9)
