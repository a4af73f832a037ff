"""Pixels to the floor and back, and the horizon, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.monocular.back_projection import (
    camera_pose,
    floor_points,
    nearest_distance_m,
    project,
)
from perception.monocular.ground import horizon_rows
from perception.primitives.camera import Camera

CAMERA = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)  # seed 000: f = 360 px
PITCH = math.radians(30.0)
POSE = camera_pose(np.array([0.0, 0.0, 0.42]), 0.0, PITCH, 0.0)


@given(st.floats(0.2, 4.0), st.floats(-0.4, 0.4), st.floats(-3.0, 3.0), st.floats(-0.2, 0.2))
def test_a_floor_point_seen_in_the_picture_comes_back_to_itself(ahead, side, yaw, roll):
    pose = camera_pose(np.array([0.5, 1.2, 0.42]), yaw, PITCH, roll)
    c, s = math.cos(yaw), math.sin(yaw)
    local = np.array([ahead, side * ahead])
    point = np.array([0.5 + c * local[0] - s * local[1], 1.2 + s * local[0] + c * local[1]])
    back = floor_points(project(point, CAMERA, pose), CAMERA, pose)
    np.testing.assert_allclose(back, point, atol=1e-6)


def test_the_camera_stays_where_it_is_put_whatever_its_angles():
    pose = camera_pose(np.array([0.5, 1.2, 0.42]), 0.7, PITCH, 0.1)
    np.testing.assert_allclose(pose.position, [0.5, 1.2, 0.42])


def test_the_horizon_of_the_seed_lies_at_row_151_7_and_nothing_above_it_is_floor():
    left, right = horizon_rows(CAMERA, POSE)
    assert left == pytest.approx(151.65, abs=0.01)
    assert right == pytest.approx(left)
    above = np.array([[359.5, left - 0.5], [10.0, left - 40.0]])
    assert np.isnan(floor_points(above, CAMERA, POSE)).all()


def test_the_nearest_floor_follows_from_height_and_angles():
    down = PITCH + math.atan((719.0 - CAMERA.cy) / CAMERA.fy)
    assert nearest_distance_m(CAMERA, POSE) == pytest.approx(0.42 / math.tan(down), abs=1e-9)


def test_what_is_farther_than_asked_is_not_told():
    pixel = project(np.array([5.0, 0.0]), CAMERA, POSE)
    assert np.isnan(floor_points(pixel, CAMERA, POSE, 4.0)).all()
    assert np.isfinite(floor_points(pixel, CAMERA, POSE, 6.0)).all()


def test_the_printed_order_turns_the_place_of_the_camera_too():
    place, angles = np.array([0.5, 1.2, 0.42]), (0.3, 0.5, -0.1)
    right, printed = camera_pose(place, *angles), camera_pose(place, *angles, literal=True)
    np.testing.assert_allclose(right.translation, place)
    assert np.linalg.norm(printed.translation) == pytest.approx(np.linalg.norm(place))
    assert np.linalg.norm(printed.translation - place) > 0.3
    ahead = right.rotation @ np.array([0.0, 0.0, 1.0])  # along the optical axis
    np.testing.assert_allclose(printed.rotation @ np.array([1.0, 0.0, 0.0]), ahead, atol=1e-12)
