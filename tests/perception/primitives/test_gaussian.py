"""Distance, projection and ellipse of a Gaussian."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.gaussian import Gaussian

seeds = st.integers(0, 2**32 - 1)


def some(rng: np.random.Generator, n: int) -> Gaussian:
    root = rng.normal(size=(n, n))
    return Gaussian(rng.normal(size=n), root @ root.T + 0.1 * np.eye(n))


def test_one_sigma_along_an_axis_is_distance_one():
    belief = Gaussian(np.array([1.0, 2.0]), np.diag([4.0, 0.25]))
    assert math.isclose(belief.mahalanobis_squared(np.array([3.0, 2.0])), 1.0)
    assert math.isclose(belief.mahalanobis_squared(np.array([1.0, 1.0])), 4.0)


@given(seeds)
def test_the_distance_does_not_depend_on_the_axes(seed):
    rng = np.random.default_rng(seed)
    belief, point = some(rng, 3), rng.normal(size=3)
    axes = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    there = belief.linear(axes)
    assert math.isclose(
        there.mahalanobis_squared(axes @ point), belief.mahalanobis_squared(point), rel_tol=1e-6
    )


@given(seeds)
def test_a_marginal_is_the_linear_map_that_picks_entries(seed):
    belief = some(np.random.default_rng(seed), 4)
    picked = belief.marginal(2, 0)
    mapped = belief.linear(np.eye(4)[[2, 0]])
    np.testing.assert_allclose(picked.mean, mapped.mean)
    np.testing.assert_allclose(picked.covariance, mapped.covariance)


def test_the_ellipse_of_a_rotated_covariance_points_along_its_long_axis():
    c, s = math.cos(0.4), math.sin(0.4)
    R = np.array([[c, -s], [s, c]])
    belief = Gaussian(np.zeros(2), R @ np.diag([9.0, 1.0]) @ R.T)
    long, short, direction = belief.ellipse(1.0 - math.exp(-0.5))  # one sigma
    assert math.isclose(long, 3.0)
    assert math.isclose(short, 1.0)
    assert math.isclose(math.remainder(direction - 0.4, math.pi), 0.0, abs_tol=1e-12)


def test_the_ellipse_contains_its_share_of_samples():
    rng = np.random.default_rng(0)
    belief = some(rng, 2)
    long, short, direction = belief.ellipse(0.9)
    samples = rng.multivariate_normal(belief.mean, belief.covariance, size=20000) - belief.mean
    c, s = math.cos(direction), math.sin(direction)
    along, across = samples @ [c, s], samples @ [-s, c]
    share = np.mean((along / long) ** 2 + (across / short) ** 2 <= 1.0)
    assert abs(share - 0.9) < 0.01  # deviation of the share: 0.002
