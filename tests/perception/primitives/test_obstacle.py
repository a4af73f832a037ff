"""Prediction of an obstacle at constant velocity with growing covariance."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle

seconds = st.floats(0.0, 20.0)


def some(seed: int) -> Obstacle:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4)) * 0.05
    state = Gaussian(rng.normal(size=4), root @ root.T + 1e-6 * np.eye(4))
    return Obstacle(state, 0.1, 0.4, 7, 0.8, 12.5, 3.25)


@given(st.integers(0, 2**32 - 1), seconds)
def test_prediction_keeps_the_velocity(seed, t):
    now = some(seed)
    then = now.after(t)
    np.testing.assert_allclose(then.position, now.position + t * now.velocity, atol=1e-12)
    np.testing.assert_array_equal(then.velocity, now.velocity)


@given(st.integers(0, 2**32 - 1), seconds, seconds)
def test_without_acceleration_two_predictions_equal_one(seed, a, b):
    now = some(seed)
    twice, once = now.after(a).after(b), now.after(a + b)
    np.testing.assert_allclose(twice.state.mean, once.state.mean, atol=1e-9)
    np.testing.assert_allclose(twice.state.covariance, once.state.covariance, atol=1e-9)


def test_prediction_keeps_the_other_fields():
    now = some(1)
    then = now.after(2.0, 0.1)
    for name in ("radius_m", "height_m", "track", "moving", "seen_s", "since_s"):
        assert getattr(then, name) == getattr(now, name)


def test_the_predicted_covariance_equals_that_of_samples():
    rng = np.random.default_rng(5)
    now, t, sigma = some(2), 1.5, 0.2
    starts = rng.multivariate_normal(now.state.mean, now.state.covariance, size=40000)
    push = rng.normal(size=(40000, 2)) * sigma
    ends = np.hstack(
        [starts[:, :2] + starts[:, 2:] * t + push * t * t / 2, starts[:, 2:] + push * t]
    )
    claimed = now.after(t, sigma).state.covariance
    size = np.sqrt(np.outer(np.diag(claimed), np.diag(claimed)))
    np.testing.assert_allclose(np.cov(ends.T) / size, claimed / size, atol=0.03)  # 4 deviations
