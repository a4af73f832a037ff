"""Group axioms of poses, action on points, bits of the quaternion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from perception.primitives.pose import Pose2, Pose3, head_rotation, wrap_angle

metres = st.floats(-20.0, 20.0)
angles = st.floats(-10.0, 10.0)
poses2 = st.builds(Pose2, metres, metres, angles)


@st.composite
def rigid(draw):
    q = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(4)])
    if np.linalg.norm(q) < 0.1:
        q = np.array([0.0, 0.0, 0.0, 1.0])
    q /= np.linalg.norm(q)
    return Pose3(tuple(draw(metres) for _ in range(3)), tuple(float(v) for v in q))


def same2(a: Pose2, b: Pose2) -> bool:
    near = np.allclose([a.x, a.y], [b.x, b.y], rtol=0.0, atol=1e-9)  # 20 m times rounding
    return near and abs(wrap_angle(a.yaw - b.yaw)) < 1e-9


def same3(a: Pose3, b: Pose3) -> bool:
    return np.allclose(a.matrix, b.matrix, rtol=0.0, atol=1e-9)


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap_angle(angle)
    assert abs(wrapped) <= math.pi
    assert abs(math.remainder(wrapped - angle, 2 * math.pi)) < 1e-9


@given(poses2, poses2, poses2)
def test_composition_on_the_floor_is_associative(a, b, c):
    assert same2((a @ b) @ c, a @ (b @ c))


@given(poses2)
def test_on_the_floor_the_inverse_is_two_sided(a):
    assert same2(a @ a.inverse(), Pose2())
    assert same2(a.inverse() @ a, Pose2())
    assert same2(a @ Pose2(), a)


@given(poses2, poses2, metres, metres)
def test_composed_floor_poses_map_a_point_one_after_the_other(a, b, x, y):
    point = np.array([[x, y]])
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-9)


@given(poses2, poses2)
def test_lifted_floor_poses_compose_as_on_the_floor(a, b):
    assert same3((a @ b).lifted(), a.lifted() @ b.lifted())
    assert same2((a.lifted() @ b.lifted()).flattened(), a @ b)


@given(rigid(), rigid(), rigid())
def test_composition_in_space_is_associative(a, b, c):
    assert same3((a @ b) @ c, a @ (b @ c))


@given(rigid())
def test_in_space_the_inverse_is_two_sided(a):
    assert same3(a @ a.inverse(), Pose3())
    assert same3(a.inverse() @ a, Pose3())


@given(rigid(), rigid())
def test_composition_in_space_equals_matrix_multiplication(a, b):
    np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-9)


@given(rigid(), metres, metres, metres)
def test_a_rigid_motion_keeps_distances_and_agrees_with_its_matrix(a, x, y, z):
    points = np.array([[x, y, z], [0.0, 0.0, 0.0]])
    moved = a.apply(points)
    assert math.isclose(
        np.linalg.norm(moved[0] - moved[1]), np.linalg.norm(points[0]), abs_tol=1e-9
    )
    np.testing.assert_allclose(moved[0], (a.matrix @ [x, y, z, 1.0])[:3], atol=1e-9)


@given(rigid())
def test_a_rotation_agrees_with_scipy(a):
    np.testing.assert_allclose(a.rotation, Rotation.from_quat(a.quat_xyzw).as_matrix(), atol=1e-12)


@given(rigid())
def test_a_matrix_gives_back_its_pose_up_to_the_sign_of_the_quaternion(a):
    again = Pose3.from_matrix(a.matrix)
    assert again.translation == a.translation
    assert abs(abs(np.dot(again.quat_xyzw, a.quat_xyzw)) - 1.0) < 1e-12


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("turn_rad", [math.pi, math.pi - 1e-9, -math.pi + 1e-9])
def test_half_a_turn_about_any_axis_survives_conversion_to_a_matrix(axis, turn_rad):
    rotation = Rotation.from_rotvec(turn_rad * np.eye(3)[axis]).as_matrix()
    again = Pose3.from_rotation(rotation, np.zeros(3))
    np.testing.assert_allclose(again.rotation, rotation, atol=1e-12)


@given(rigid())
def test_a_quaternion_keeps_its_bits_and_is_not_normalised(a):
    scaled = tuple(3.0 * q for q in a.quat_xyzw)
    pose = Pose3(a.translation, scaled)
    assert pose.quat_xyzw == scaled
    np.testing.assert_allclose(pose.rotation, a.rotation, atol=1e-12)
    written = [repr(v) for v in (*pose.translation, *pose.quat_xyzw)]
    read = [float(v) for v in written]
    assert Pose3(tuple(read[:3]), tuple(read[3:])) == pose


def test_a_level_head_looks_along_the_body():
    R = head_rotation(0.0, 0.0)
    np.testing.assert_allclose(R @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(R @ [1, 0, 0], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(R @ [0, 1, 0], [0, 0, -1], atol=1e-15)


@given(st.floats(-1.5, 1.5), st.floats(-0.5, 1.5))
def test_pan_turns_the_view_left_and_tilt_turns_it_down(pan, tilt):
    axis = head_rotation(pan, tilt) @ [0.0, 0.0, 1.0]
    expected = [math.cos(pan) * math.cos(tilt), math.sin(pan) * math.cos(tilt), -math.sin(tilt)]
    np.testing.assert_allclose(axis, expected, atol=1e-12)
