"""Levelling: the camera pose is corrected by the measured floor."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from perception.floor.levelling import UP, camera_above_floor, level, rotation_between
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

angles = st.floats(-1.0, 1.0)


def seen_from(T_body_camera: Pose3) -> Plane:
    """The floor z = 0 in the frame of a camera."""
    return Plane(UP, 0.0).moved(T_body_camera.inverse())


@given(angles, st.floats(0.0, 1.2), st.floats(-0.03, 0.03), st.floats(-0.03, 0.03))
def test_a_wrong_tilt_is_corrected_by_the_measured_floor(pan, tilt, pitch_error, roll_error):
    true = Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.03, 0.01, 0.40]))
    c, s = math.cos(pitch_error), math.sin(pitch_error)
    pitch = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = math.cos(roll_error), math.sin(roll_error)
    roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    by_joints = Pose3.from_rotation(pitch @ roll @ true.rotation, np.array([0.03, 0.01, 0.38]))
    levelled = level(by_joints, seen_from(true))
    floor_point = true.inverse().apply(np.array([0.8, 0.2, 0.0]))
    assert abs(levelled.apply(floor_point)[2]) < 1e-9
    np.testing.assert_allclose(levelled.translation, true.translation, atol=1e-9)


@given(angles, st.floats(0.05, 1.5))
def test_a_handheld_camera_is_straight_above_its_body_frame(pan, tilt):
    true = Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.0, 0.0, 1.3]))
    own = camera_above_floor(seen_from(true))
    axis = own.rotation @ np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(own.translation, (0.0, 0.0, 1.3), atol=1e-9)
    assert axis[0] > 0  # it looks along its own x axis
    assert abs(axis[1]) < 1e-9
    assert math.isclose(-axis[2], math.sin(tilt), abs_tol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_the_smallest_rotation_turns_one_direction_into_the_other(seed):
    rng = np.random.default_rng(seed)
    source, target = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    rotation = rotation_between(source, target)
    np.testing.assert_allclose(rotation @ source, target, atol=1e-7)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-7)


def test_opposite_directions_are_half_a_turn_apart():
    rotation = rotation_between(UP, -UP)
    np.testing.assert_allclose(rotation @ UP, -UP, atol=1e-12)
    assert math.isclose(np.linalg.det(rotation), 1.0)
