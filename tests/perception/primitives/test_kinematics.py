"""Forward kinematics: closed forms, rotations, and trees that are none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import InputError
from perception.primitives.kinematics import Joint, KinematicTree, link_poses, rotation_about
from perception.primitives.pose import Pose3

ANGLES = st.floats(-math.pi, math.pi)


def arm():
    """Shoulder and elbow about z, links of 2 m and 1 m along x, and a head on the base."""
    return KinematicTree(
        (
            Joint("shoulder", 0, Pose3(), (0.0, 0.0, 1.0), -3.0, 3.0),
            Joint("head", 0, Pose3((0.0, 0.0, 5.0)), (0.0, 1.0, 0.0), -1.0, 1.0),
            Joint("elbow", 1, Pose3((2.0, 0.0, 0.0)), (0.0, 0.0, 1.0), -3.0, 3.0),
        )
    )


@given(ANGLES, ANGLES)
def test_a_planar_arm_is_where_the_closed_form_says(shoulder, elbow):
    poses = link_poses(arm(), np.array([shoulder, 0.3, elbow]))
    hand = poses[3] @ np.array([1.0, 0.0, 0.0, 1.0])
    x = 2.0 * math.cos(shoulder) + math.cos(shoulder + elbow)
    y = 2.0 * math.sin(shoulder) + math.sin(shoulder + elbow)
    np.testing.assert_allclose(hand, [x, y, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(poses[2][:3, 3], [0.0, 0.0, 5.0])


@given(st.tuples(ANGLES, ANGLES, ANGLES).filter(lambda v: np.linalg.norm(v) > 1e-3), ANGLES)
def test_a_rotation_keeps_its_axis_and_has_its_angle(vector, angle):
    axis = np.array(vector) / np.linalg.norm(vector)
    R = rotation_about(tuple(axis), angle)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.trace(R) == pytest.approx(1.0 + 2.0 * math.cos(angle))


def test_the_joints_between_two_links_are_those_of_the_way_between_them():
    tree = arm()
    assert [tree.joints_between(a, b) for a, b in ((0, 0), (3, 1), (3, 2), (2, 0))] == [0, 1, 3, 1]
    assert tree.path(3) == [0, 2]


def test_what_is_no_tree_or_lacks_angles_is_refused():
    with pytest.raises(InputError, match="joint 'a' is carried by link 1; expected one of 0 to 0"):
        KinematicTree((Joint("a", 1, Pose3(), (1.0, 0.0, 0.0), 0.0, 1.0),))
    with pytest.raises(InputError, match="2 joint angles; the tree has 3"):
        link_poses(arm(), np.zeros(2))
    with pytest.raises(InputError, match="joint 'knee' is not in the tree; it has shoulder"):
        arm().index("knee")
