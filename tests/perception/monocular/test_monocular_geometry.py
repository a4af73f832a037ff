"""Projection between pixels and floor, and the horizon, against closed forms."""

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
def test_projection_and_back_projection_of_a_floor_point_are_inverse(ahead, side, yaw, roll):
    pose = camera_pose(np.array([0.5, 1.2, 0.42]), yaw, PITCH, roll)
    c, s = math.cos(yaw), math.sin(yaw)
    local = np.array([ahead, side * ahead])
    point = np.array([0.5 + c * local[0] - s * local[1], 1.2 + s * local[0] + c * local[1]])
    back = floor_points(project(point, CAMERA, pose), CAMERA, pose)
    np.testing.assert_allclose(back, point, atol=1e-6)


def test_the_position_of_the_camera_does_not_depend_on_its_angles():
    pose = camera_pose(np.array([0.5, 1.2, 0.42]), 0.7, PITCH, 0.1)
    np.testing.assert_allclose(pose.position, [0.5, 1.2, 0.42])


def test_the_horizon_of_seed_000_is_row_151_7_and_pixels_above_have_no_floor_point():
    left, right = horizon_rows(CAMERA, POSE)
    assert left == pytest.approx(151.65, abs=0.01)
    assert right == pytest.approx(left)
    above = np.array([[359.5, left - 0.5], [10.0, left - 40.0]])
    assert np.isnan(floor_points(above, CAMERA, POSE)).all()


def test_the_nearest_visible_floor_follows_from_height_and_angles():
    down = PITCH + math.atan((719.0 - CAMERA.cy) / CAMERA.fy)
    assert nearest_distance_m(CAMERA, POSE) == pytest.approx(0.42 / math.tan(down), abs=1e-9)


def test_points_beyond_the_maximum_distance_are_nan():
    pixel = project(np.array([5.0, 0.0]), CAMERA, POSE)
    assert np.isnan(floor_points(pixel, CAMERA, POSE, 4.0)).all()
    assert np.isfinite(floor_points(pixel, CAMERA, POSE, 6.0)).all()
