"""Glances: for near obstacles out of sight beside the robot, at most every other step."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP
from planning.swarm.glances import MOST_DEG, Glances

ROBOT = Pose2(1.0, 2.0, 0.5)


def mover(away, bearing, seen_s=0.0):
    place = ROBOT.apply(away * np.array([math.cos(bearing), math.sin(bearing)]))
    return Obstacle(
        Gaussian(np.array([*place, 0.06, 0.0]), np.eye(4) * 1e-4), 0.04, moving=1.0, seen_s=seen_s
    )


def glancing(enabled=True):
    return Glances(DARWIN_OP, enabled)


def pan(*movers, stamp_s=2.0):
    return glancing().next(ROBOT, movers, stamp_s)


@given(st.floats(0.3, 1.2), st.floats(40.0, 115.0), st.sampled_from([-1.0, 1.0]))
def test_an_obstacle_out_of_sight_comes_into_a_view_of_90_degrees(away, degrees, side):
    bearing = side * math.radians(degrees)
    assert abs(bearing - pan(mover(away, bearing))) < math.radians(45.0 + 1e-6)


@pytest.mark.parametrize(
    "calm",
    [mover(0.8, 0.1), mover(0.8, 3.0), mover(2.0, 1.2), mover(0.8, 1.2, seen_s=1.9)],
    ids=["ahead", "behind", "far", "just seen"],
)
def test_other_obstacles_cause_no_glance(calm):
    assert pan(calm) == 0.0


def test_after_a_glance_the_head_looks_ahead_for_a_step():
    glances = glancing()
    pans = [glances.next(ROBOT, [mover(0.8, 1.2)], 2.0 + 0.65 * k) for k in range(6)]
    assert [value > 0.0 for value in pans] == [True, False] * 3


def test_the_nearest_obstacle_comes_first():
    assert pan(mover(1.0, 1.2), mover(0.5, -1.2)) < 0.0


def test_a_near_obstacle_comes_before_one_unseen_for_longer():
    near, lost = mover(0.35, -1.0, seen_s=1.35), mover(0.75, 1.0, seen_s=0.05)
    assert pan(near, lost) < 0.0


def test_an_obstacle_long_unseen_comes_before_a_slightly_nearer_one():
    near, lost = mover(0.6, -1.0, seen_s=1.35), mover(0.75, 1.0, seen_s=-1.0)
    assert pan(near, lost) > 0.0


def test_glances_can_be_switched_off():
    assert glancing(enabled=False).next(ROBOT, [mover(0.8, 1.2)], 2.0) == 0.0


def test_a_waiting_robot_looks_to_both_sides_alternately():
    looks = glancing()
    pans = [looks.next(ROBOT, [], 0.65 * k, waits=True) for k in range(8)]
    assert all(pan == 0.0 for pan in pans[1::2])
    aside = np.degrees(pans[::2])
    np.testing.assert_allclose(np.abs(aside), MOST_DEG)
    assert (np.sign(aside[1:]) == -np.sign(aside[:-1])).all()


def test_a_waiting_robot_looks_first_for_an_obstacle_out_of_sight():
    found = glancing().next(ROBOT, [mover(0.8, -1.2)], 2.0, waits=True)
    assert -1.2 <= found < -0.6
