"""The square-root filter: agreement with filterpy, and a covariance that stays positive definite."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.filtering import _square_root_kernels as kernels
from perception.filtering.models import circular_mean, spread
from perception.filtering.square_root import SigmaPoints, SquareRootFilter
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian

seeds = st.integers(0, 2**32 - 1)
powers = st.floats(-12.0, 12.0)


def wrap_angles(angles):
    return (angles + math.pi) % (2.0 * math.pi) - math.pi


def round_mean(entry):
    """Mean of rows, one entry averaged on the circle."""

    def of(points, weights):
        found = weights @ points
        found[entry] = circular_mean(points[:, entry], weights)
        return found

    return of


def round_difference(entry):
    """Difference of rows, one entry wrapped."""

    def of(a, b):
        found = a - b
        found[entry] = wrap_angles(found[entry])
        return found

    return of


def covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    A = rng.normal(size=(size, size))
    return A @ A.T / size + 0.05 * np.eye(size)


def is_covariance(P: np.ndarray) -> bool:
    """Symmetric, and positive definite after scaling each entry by its standard deviation."""
    sigma = np.sqrt(np.diag(P))
    if not (np.all(np.isfinite(P)) and np.array_equal(P, P.T) and np.all(sigma > 0.0)):
        return False
    return bool(np.linalg.eigvalsh(P / np.outer(sigma, sigma)).min() > -1e-15 * len(P))


def closest(robot: SquareRootFilter, peer: UnscentedKalmanFilter) -> float:
    return max(
        float(np.abs(robot.mean - peer.x).max()), float(np.abs(robot.covariance - peer.P).max())
    )


@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(1, 6), st.integers(1, 4), st.sampled_from([None, 0.1, 0.5, 1.0]))
def test_random_systems_agree_with_filterpy(seed, n, m, alpha):
    """Nonlinear motion and measurement; small alphas have a negative weight of the centre."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, n)) / n, rng.normal(size=(m, n))
    P, Q, R, x = covariance(rng, n), covariance(rng, n), covariance(rng, m), rng.normal(size=n)

    def move(points):
        return points @ A.T + 0.1 * np.sin(points)

    def see(points):
        return points @ B.T + 0.1 * np.cos(points @ B.T)

    points = MerweScaledSigmaPoints(n, spread(n) if alpha is None else alpha, 2.0, 0.0)
    peer = UnscentedKalmanFilter(n, m, 1.0, hx=see, fx=lambda s, dt: move(s), points=points)
    peer.x, peer.P, peer.Q, peer.R = x.copy(), P.copy(), Q, R
    ours = SquareRootFilter(Gaussian(x, P), points=SigmaPoints.scaled(n, alpha))
    for _ in range(6):
        z = rng.normal(size=m)
        peer.predict()
        peer.update(z)
        assert ours.predict(move, Q)
        used, innovation = ours.update(see, z, R)
        assert used
        assert innovation is not None
        assert innovation.nis == pytest.approx(peer.y @ np.linalg.solve(peer.S, peer.y), rel=1e-6)
        assert ours.log_density == pytest.approx(peer.log_likelihood, rel=1e-6, abs=1e-6)
        assert closest(ours, peer) < 1e-9


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_angles_agree_with_filterpy_with_circular_means(seed):
    rng = np.random.default_rng(seed)
    x = np.append(rng.normal(size=2), rng.uniform(-math.pi, math.pi))
    P = covariance(rng, 3) * 0.05

    def move(points):
        moved = points + np.array([0.1, 0.0, 0.4])
        moved[..., 2] = wrap_angles(moved[..., 2])
        return moved

    def see(points):
        x, y = 4.0 - points[..., 0], -points[..., 1]
        return np.stack([np.hypot(x, y), wrap_angles(np.arctan2(y, x) - points[..., 2])], axis=-1)

    def total(a, b):
        found = a + b
        found[2] = wrap_angles(found[2])
        return found

    peer = UnscentedKalmanFilter(
        3, 2, 1.0, hx=see, fx=lambda s, dt: move(s),
        points=MerweScaledSigmaPoints(3, spread(3), 2.0, 0.0, subtract=np.subtract),
        x_mean_fn=round_mean(2), z_mean_fn=round_mean(1),
        residual_x=round_difference(2), residual_z=round_difference(1),
        state_add=total,
    )  # fmt: skip
    peer.x, peer.P, peer.Q, peer.R = x.copy(), P.copy(), 0.01 * np.eye(3), 0.02 * np.eye(2)
    ours = SquareRootFilter(Gaussian(x, P), angles=(2,))
    for _ in range(5):
        z = np.array([rng.uniform(1.0, 5.0), rng.uniform(-math.pi, math.pi)])
        peer.predict()
        peer.update(z)
        ours.predict(move, peer.Q)
        ours.update(see, z, peer.R, angles=(1,))
        apart = ours.mean - peer.x
        apart[2] = wrap_angles(apart[2])
        assert np.abs(apart).max() < 1e-9
        assert np.abs(ours.covariance - peer.P).max() < 1e-9
        assert -math.pi <= ours.mean[2] < math.pi


@settings(max_examples=80, deadline=None)
@given(
    seeds,
    st.integers(1, 5),
    st.integers(1, 3),
    st.lists(st.tuples(powers, powers, powers), min_size=1, max_size=8),
    st.booleans(),
)
def test_the_covariance_stays_positive_definite_for_any_noise(seed, n, m, steps, exact):
    """Noise from 1e-12 to 1e12 in random order; with `exact`, some of it zero."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(m, n))
    B[-1] = B[0] * (1.0 + 1e-13)  # nearly the same measurement twice
    robot = SquareRootFilter(Gaussian(np.zeros(n), covariance(rng, n) * 10.0 ** steps[0][2]))
    for process, measured, jump in steps:
        off = exact and rng.random() < 0.5
        robot.predict(lambda p: p + 0.1 * np.sin(p), (0.0 if off else 10.0**process) * np.eye(n))
        assert is_covariance(robot.covariance)
        R = 0.0 * np.eye(m) if off else 10.0**measured * np.eye(m)
        robot.update(lambda p: p @ B.T, 10.0**jump * rng.normal(size=m), R)
        assert is_covariance(robot.covariance)
        assert np.all(np.diag(robot.root) > 0.0)
        assert np.all(np.isfinite(robot.mean))


def test_an_exact_measurement_repeated_a_thousand_times_leaves_it_positive_definite():
    robot = SquareRootFilter(Gaussian(np.zeros(3), np.eye(3)))
    for _ in range(1000):
        used, _ = robot.update(lambda p: p[:, :1], np.array([1.0]), np.zeros((1, 1)))
        assert used
    assert robot.mean[0] == pytest.approx(1.0)
    assert is_covariance(robot.covariance)
    robot.predict(lambda p: p, np.eye(3))  # and it can still be surprised
    robot.update(lambda p: p[:, :1], np.array([5.0]), 0.01 * np.eye(1))
    assert robot.mean[0] == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e308])
def test_a_measurement_that_is_not_finite_changes_nothing(bad):
    robot = SquareRootFilter(Gaussian(np.ones(2), np.eye(2)))
    before = robot.belief
    used, innovation = robot.update(lambda p: p * 1e10, np.array([0.0, bad]), 1e-20 * np.eye(2))
    assert not used
    assert innovation is None
    np.testing.assert_array_equal(robot.mean, before.mean)
    np.testing.assert_array_equal(robot.covariance, before.covariance)


@pytest.mark.parametrize(
    "noise", [np.diag([1.0, -1.0]), np.full((2, 2), np.nan), np.array([[1.0, 2.0], [2.0, 1.0]])]
)
def test_noise_that_is_not_a_covariance_changes_nothing(noise):
    robot = SquareRootFilter(Gaussian(np.ones(2), np.eye(2)))
    assert not robot.predict(lambda p: p, noise)
    assert robot.update(lambda p: p, np.zeros(2), noise) == (False, None)
    np.testing.assert_array_equal(robot.covariance, np.eye(2))
    np.testing.assert_array_equal(robot.mean, np.ones(2))


def test_a_model_that_returns_nan_is_refused():
    robot = SquareRootFilter(Gaussian(np.ones(2), np.eye(2)))
    assert not robot.predict(lambda p: p * np.nan, np.eye(2))
    assert robot.update(lambda p: p * np.inf, np.zeros(2), np.eye(2)) == (False, None)
    np.testing.assert_array_equal(robot.mean, np.ones(2))


def test_a_measurement_outside_the_gate_is_reported_and_not_used():
    robot = SquareRootFilter(Gaussian(np.zeros(1), np.eye(1)))
    used, innovation = robot.update(lambda p: p, np.array([5.0]), 3.0 * np.eye(1), gate=6.0)
    assert not used
    assert innovation is not None
    assert innovation.nis == pytest.approx(25.0 / 4.0)
    assert robot.mean[0] == 0.0


@pytest.mark.parametrize("alpha", [0.0, math.nan])
def test_invalid_sigma_point_parameters_are_refused(alpha):
    with pytest.raises(ConfigError, match="are invalid"):
        SigmaPoints.scaled(3, alpha)
    with pytest.raises(ConfigError, match="must be finite"):
        SquareRootFilter(Gaussian(np.array([np.nan]), np.eye(1)))


@given(seeds, st.integers(1, 6), st.integers(0, 8), st.integers(0, 4), st.integers(0, 8))
def test_a_matrix_and_its_lower_form_have_the_same_square(seed, pivots, more, below, zeros):
    rows, columns = pivots + below, pivots + more
    filled = max(columns - zeros, 1)
    wide = np.random.default_rng(seed).normal(size=(rows, columns))
    wide *= np.arange(columns) < filled + np.minimum(np.arange(rows), pivots - 1)[:, None]
    wide[pivots:] *= np.arange(columns) < filled + pivots - 1
    square = wide @ wide.T
    kernels.lower(wide, pivots, rows, columns, filled)
    assert np.all(np.diag(wide)[:pivots] > 0.0)
    assert np.all(np.triu(wide, 1)[:pivots] == 0.0)
    np.testing.assert_allclose(wide @ wide.T, square, atol=1e-12)


@given(seeds, st.integers(1, 5), st.floats(0.0, 0.999))
def test_a_downdate_subtracts_and_refuses_too_much(seed, size, share):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(covariance(rng, size))
    direction = rng.normal(size=size)
    away = root @ direction / np.linalg.norm(direction)  # the most that can be taken
    work, taken = np.empty((size, size)), root.copy()
    assert kernels.take_away(taken, size, share * away, work)
    expected = root @ root.T - share**2 * np.outer(away, away)
    np.testing.assert_allclose(taken @ taken.T, expected, atol=1e-9)
    kept = root.copy()
    assert not kernels.take_away(kept, size, 1.001 * away, work)
    np.testing.assert_array_equal(kept, root)
