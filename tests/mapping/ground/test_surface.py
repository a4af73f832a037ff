"""Surfaces of the ground: height with its doubt, and what is within the outline."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.ground.surface import Border, Surface


@pytest.fixture
def ramp():
    """An L of two squares on a slope of 1 in 10 along x."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    return Surface(
        np.array([1.0, 0.5]),
        np.array([0.2, 0.1, 0.0]),
        np.diag([0.01, 0.02, 0.03]) ** 2,
        outline,
        np.full(6, Border.DROP),
        np.full(6, 0.004),
    )


def test_height_follows_the_slope_and_doubt_grows_away_from_the_origin(ramp):
    height, sigma = ramp.height_at(np.array([[1.0, 0.5], [2.0, 0.5], [1.0, 2.5]]))
    assert np.allclose(height, [0.2, 0.3, 0.2])
    assert np.allclose(sigma, [0.01, np.hypot(0.01, 0.02), np.hypot(0.01, 0.06)])


def test_the_missing_corner_of_an_l_is_outside(ramp):
    points = np.array([[0.5, 0.5], [0.5, 1.5], [1.5, 0.5], [1.5, 1.5], [-0.1, 0.5], [0.5, 2.1]])
    assert ramp.contains(points).tolist() == [True, True, True, False, False, False]


def test_one_point_has_one_answer(ramp):
    assert bool(ramp.contains(np.array([0.5, 0.5])))
    height, sigma = ramp.height_at(np.array([1.0, 0.5]))
    assert height.shape == sigma.shape == ()
