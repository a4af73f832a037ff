"""Heights of a map against the true ground: errors that were put in come out."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.ground.surface import Border, Surface
from perception.primitives.pose import Pose2
from surefoot.evaluation.metrics import levels

PIECES = [
    {"name": "upper floor", "top_m": 0.5, "outline_m": [[4, 0], [8, 0], [8, 4], [4, 4]]},
    {"name": "table", "top_m": 1.2, "outline_m": [[6, 1], [7, 1], [7, 2], [6, 2]]},
]


def surface(x0, x1, z, pose: Pose2, sigma_m=0.01) -> Surface:
    """A level one in the world, as the map has it in the frame of a foot upstairs."""
    corners = pose.inverse().apply(np.array([[x0, 0.3], [x1, 0.3], [x1, 3.7], [x0, 3.7]], float))
    borders = np.full(4, int(Border.UNSEEN))
    P = np.diag([sigma_m, 1e-6, 1e-6]) ** 2
    return Surface(
        corners.mean(axis=0), np.array([z, 0.0, 0.0]), P, corners, borders, np.full(4, 0.02)
    )


def test_the_error_is_that_of_the_difference_of_the_floors():
    pose = Pose2(5.0, 2.0, 0.3)
    lower, upper = surface(-0.4, 3.9, -0.53, pose), surface(4.1, 7.9, 0.004, pose)
    found = levels._floors((upper, lower), pose, PIECES)
    assert found["floors"] == found["floors_true"] == 2.0
    assert found["floor_error_max_m"] == pytest.approx(0.034)
    assert found["floor_nees"] == pytest.approx((3.0**2 + 0.4**2) / 2, rel=1e-3)


@pytest.mark.parametrize("x", [-2.0, 10.0])
def test_a_robot_beyond_all_floors_stands_on_the_ground(x):
    pose = Pose2(x, 2.0, 0.0)
    upper = surface(4.1, 7.9, 0.5, pose)
    lower = surface(min(x, 8.5), max(x, 3.9), 0.0, pose)  # the ground as far as the robot
    found = levels._floors((upper, lower), pose, PIECES)
    assert found["floors"] == 2.0
    assert found["floor_error_max_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["floor_nees"] == pytest.approx(0.0, abs=1e-9)


def test_a_floor_that_is_not_in_the_map_is_no_success():
    pose = Pose2(5.0, 2.0, 0.0)
    found = levels._floors((surface(4.1, 7.9, 0.0, pose),), pose, PIECES)
    assert found["floors"] == 1.0
    assert np.isnan(found["floor_error_max_m"])
