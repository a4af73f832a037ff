"""GOSPA by hand and as a metric; highest-density regions against chi-square and by sampling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from surefoot.evaluation.metrics.gospa import CUTOFF_M, gospa
from surefoot.evaluation.metrics.regions import in_region

NONE = np.zeros((0, 2))
places = st.integers(0, 4).flatmap(
    lambda n: arrays(float, (n, 2), elements=st.floats(-1.0, 1.0, allow_subnormal=False))
)


def test_gospa_of_one_pair_is_their_distance():
    assert gospa(np.array([[0.3, 0.0]]), np.array([[0.0, 0.0]])) == pytest.approx(0.3)


def test_a_missed_object_and_a_false_track_cost_half_the_cutoff_squared_each():
    one = np.zeros((1, 2))
    assert gospa(NONE, one) == pytest.approx(CUTOFF_M / math.sqrt(2.0))
    assert gospa(one, NONE) == pytest.approx(CUTOFF_M / math.sqrt(2.0))
    assert gospa(one, one + 9.0) == pytest.approx(CUTOFF_M)  # both
    assert gospa(NONE, NONE) == 0.0


@given(places, places, places)
def test_gospa_is_symmetric_and_obeys_the_triangle_inequality(a, b, c):
    assert gospa(a, b) == pytest.approx(gospa(b, a))
    assert gospa(a, c) <= gospa(a, b) + gospa(b, c) + 1e-9


def test_the_region_of_one_gaussian_is_its_ellipse():
    mean, covariance = np.array([1.0, 2.0]), np.array([[0.04, 0.01], [0.01, 0.02]])
    one = (np.ones(1), mean[None], covariance[None])
    factor = np.linalg.cholesky(covariance)
    radius = math.sqrt(-2.0 * math.log(0.1))  # chi-square with two degrees of freedom, 90 %
    rng = np.random.default_rng(0)
    for angle in np.linspace(0.0, 6.0, 7):
        way = factor @ np.array([math.cos(angle), math.sin(angle)])
        assert in_region(mean + 0.9 * radius * way, *one, 0.9, rng)
        assert not in_region(mean + 1.15 * radius * way, *one, 0.9, rng)


def test_a_region_holds_its_share_of_a_mixture_with_gaps():
    means = np.array([[0.0, 0.0], [2.0, 0.0], [9.0, 9.0]])
    parts = (
        np.array([3.0, 1.0, 0.0]),
        means,
        np.array([0.01, 0.09, 0.0])[:, None, None] * np.eye(2),
    )
    rng = np.random.default_rng(1)
    inside = []
    for _ in range(1500):
        k = 0 if rng.uniform() < 0.75 else 1
        inside.append(in_region(rng.multivariate_normal(means[k], parts[2][k]), *parts, 0.9, rng))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.025)
    assert not in_region(np.array([1.0, 0.0]), *parts, 0.9, rng)  # between both
