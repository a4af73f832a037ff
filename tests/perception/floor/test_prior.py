"""The prior of the floor by joint angles, by gravity, and for a handheld camera."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.floor.prior import HAND_TILT_RAD, gate, handheld_prior, kinematic_prior
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3, head_rotation


@given(st.floats(-1.0, 1.0), st.floats(-0.3, 1.2), st.floats(0.1, 1.5))
def test_points_of_the_bodys_floor_lie_on_the_kinematic_plane(pan, tilt, height):
    T = Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.03, -0.02, height]))
    prior = kinematic_prior(T, 0.02, 0.01)
    floor = np.array([[1.0, 0.3, 0.0], [2.0, -0.7, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(prior.distance(T.inverse().apply(floor)), 0.0, atol=1e-9)
    assert prior.offset_m == pytest.approx(height)  # the camera is above it
    np.testing.assert_allclose(np.sqrt(np.diag(prior.covariance)), [0.02, 0.02, 0.01])


def test_gravity_narrows_the_prior_of_a_handheld_camera():
    known = handheld_prior(np.array([0.0, -3.0, -3.0]))
    np.testing.assert_allclose(known.normal, [0.0, -math.sqrt(0.5), -math.sqrt(0.5)])
    unknown = handheld_prior(None)
    np.testing.assert_allclose(unknown.normal, [0.0, -1.0, 0.0])
    assert unknown.covariance[0, 0] == pytest.approx(HAND_TILT_RAD**2)
    assert known.covariance[0, 0] < 0.1 * unknown.covariance[0, 0]


def test_the_gate_follows_the_covariance_of_the_prior_and_excludes_walls():
    T = Pose3.from_rotation(head_rotation(0.0, 0.4), np.array([0.0, 0.0, 0.4]))
    narrow = gate(kinematic_prior(T, 0.02, 0.01), 4.0, 1.0, 0.03)
    assert (narrow.tilt_rad, narrow.lowest_m, narrow.highest_m) == pytest.approx((0.08, 0.36, 0.44))
    wide = gate(handheld_prior(None), 4.0, 1.0, 0.03)
    assert (wide.tilt_rad, wide.lowest_m) == pytest.approx((1.0, 0.03))


def test_invalid_priors_are_refused_with_a_message():
    T = Pose3.from_rotation(head_rotation(0.0, 0.4), np.array([0.0, 0.0, 0.4]))
    below = Pose3.from_rotation(head_rotation(0.0, 0.4), np.array([0.0, 0.0, -0.1]))
    with pytest.raises(InputError, match=r"tilt_sigma_rad=0\.0"):
        kinematic_prior(T, 0.0, 0.01)
    with pytest.raises(InputError, match="height_sigma_m=nan"):
        kinematic_prior(T, 0.02, math.nan)
    with pytest.raises(InputError, match=r"-0\.1 m above the floor"):
        kinematic_prior(below, 0.02, 0.01)
    with pytest.raises(InputError, match="must be a direction"):
        handheld_prior(np.zeros(3))
