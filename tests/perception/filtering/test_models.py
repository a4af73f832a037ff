"""Motion and measurement models agree with poses; matrix roots exist for every symmetric matrix."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from perception.filtering import models
from perception.primitives.pose import Pose2, wrap_angle

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_a_step_is_the_composition_of_poses(seed):
    rng = np.random.default_rng(seed)
    state = np.concatenate([rng.normal(size=3), [-0.001, 0.002, 0.003, 0.004, 0.005, 0.6, 9.9]])
    motion, steps = Pose2(*rng.normal(size=3) * [0.04, 0.02, 0.2]), 0.5
    after = models.walk(state, 0.3, motion, steps)
    slipped = Pose2(motion.x - 0.001 * 0.5, motion.y + 0.002 * 0.5, motion.yaw + 0.003 * 0.5)
    true = Pose2(*state[:3]) @ slipped
    np.testing.assert_allclose(after[:2], [true.x, true.y], atol=1e-12)
    assert abs(wrap_angle(after[models.YAW] - true.yaw)) < 1e-12
    assert math.isclose(after[models.TURN], motion.yaw + 0.003 * 0.5)
    np.testing.assert_array_equal(after[3:9], state[3:9])


@given(seeds)
def test_range_and_bearing_are_those_by_the_inverse_pose(seed):
    rng = np.random.default_rng(seed)
    pose = Pose2(*rng.normal(size=3))
    places = rng.uniform(-3, 3, (4, 2))
    seen = models.range_bearing(pose.vector, places)
    there = pose.inverse().apply(places)
    np.testing.assert_allclose(seen[0::2], np.hypot(*there.T), atol=1e-12)
    error = models.wrap_angles(seen[1::2] - np.arctan2(there[:, 1], there[:, 0]))
    np.testing.assert_allclose(error, 0.0, atol=1e-9)


def test_pan_offset_and_range_bias_shift_the_measurement():
    state = np.zeros(models.WALKER_SIZE)
    state[models.PAN], state[models.RANGE] = 0.01, -0.5
    seen = models.sighted(state, np.array([[2.0, 0.0], [0.0, 1.0]]), np.array([0.02, 0.04]))
    np.testing.assert_allclose(seen, [1.99, 0.01, 0.98, math.pi / 2 + 0.01])


@given(st.floats(-math.pi, math.pi), st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=8))
def test_the_circular_mean_rotates_with_its_directions(turn, directions):
    angles = np.array(directions)
    weights = np.full(len(angles), 1.0 / len(angles))
    mean = models.circular_mean(angles, weights)
    turned = models.circular_mean(models.wrap_angles(angles + turn), weights)
    assert abs(wrap_angle(float(turned - mean) - turn)) < 1e-9


def test_the_circular_mean_of_two_directions_across_pi_is_pi():
    mean = models.circular_mean(np.array([math.pi - 0.1, -math.pi + 0.1]), np.array([0.5, 0.5]))
    assert math.isclose(abs(float(mean)), math.pi)


@given(seeds)
def test_a_state_plus_a_difference_is_the_other_state(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-3, 3, (2, models.WALKER_SIZE))
    there = models.walker_sum(b, models.walker_difference(a, b))
    np.testing.assert_allclose(models.walker_difference(there, a), 0.0, atol=1e-12)


@given(arrays(np.float64, (4, 4), elements=st.floats(-1e3, 1e3)))
def test_every_symmetric_matrix_has_a_root_and_a_positive_definite_neighbour(matrix):
    matrix = matrix + matrix.T
    root = models.square_root(matrix)
    assert np.all(np.isfinite(root))
    near = models.positive(matrix)
    np.testing.assert_array_equal(near, near.T)
    np.linalg.cholesky(near)


@given(arrays(np.float64, (5, 3), elements=st.floats(-10.0, 10.0)))
def test_the_root_of_a_singular_covariance_squares_to_it(rows):
    covariance = rows @ np.diag([1.0, 0.5, 0.0]) @ rows.T  # rank two of five
    root = models.square_root(covariance)
    np.testing.assert_allclose(root.T @ root, covariance, atol=1e-6 * (1 + np.trace(covariance)))


@pytest.mark.parametrize("turn", [-7.0, -math.pi, 0.0, 3.0, math.pi, 50.0])
def test_wrapping_an_array_wraps_each_angle(turn):
    angles = np.array([0.1, -0.2, 3.1]) + turn
    np.testing.assert_allclose(models.wrap_angles(angles), [wrap_angle(float(a)) for a in angles])
