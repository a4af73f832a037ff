"""The sweep: survey first, then the path often enough, and moving obstacles kept in sight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import HeadLimits
from planning.gaze.sweep import SURVEY_PANS_DEG, VIEW_DEG, Sweep

STEP_S = 0.65
VIA = np.array([2.0, 0.0])


def mover(x, y, seen_s, vx=0.0, vy=0.0, moving=1.0):
    state = Gaussian(np.array([x, y, vx, vy]), np.eye(4) * 1e-4)
    return Obstacle(state, 0.1, 0.4, 7, moving, seen_s, 0.0)


def surveyed():
    """A sweep after its survey, and the time."""
    sweep, now = Sweep(), 0.0
    while sweep.surveying:
        sweep.next(now, Pose2(), VIA, [])
        now += STEP_S
    return sweep, now


def test_the_survey_covers_the_range_of_the_neck_without_gaps():
    sweep, pans = Sweep(), []
    assert sweep.surveying
    for k in range(len(SURVEY_PANS_DEG)):
        pans.append(math.degrees(sweep.next(k * STEP_S, Pose2(), VIA, []).pan_rad))
        assert sweep.surveying
    sweep.next(10.0, Pose2(), VIA, [])
    assert not sweep.surveying
    order = np.unique(np.round(pans, 6))
    assert order[0] - 22 <= -100
    assert order[-1] + 22 >= 100
    assert np.diff(order).max() < 44.0  # narrower than the narrowest view


@pytest.mark.parametrize("with_mover", [False, True])
@pytest.mark.parametrize("bearing", np.radians([-60, 0, 35]))
def test_the_path_is_looked_at_every_two_seconds(bearing, with_mover):
    sweep, now = surveyed()
    via = 2.0 * np.array([math.cos(bearing), math.sin(bearing)])
    seen = now
    for _ in range(60):
        others = [mover(0.0, -0.8, seen_s=now - 5.0)] if with_mover else []
        gaze = sweep.next(now, Pose2(), via, others)
        now += STEP_S
        if abs(gaze.pan_rad - bearing) <= math.radians(VIEW_DEG / 2):
            seen = now
        assert now - seen <= 2.0 + 1e-9


def test_the_other_gazes_go_to_both_sides():
    sweep, now = surveyed()
    pans = [sweep.next(now + k * STEP_S, Pose2(), VIA, []).pan_rad for k in range(16)]
    assert max(pans) >= math.radians(60)
    assert min(pans) <= -math.radians(60)
    np.testing.assert_allclose(np.sort(pans), -np.sort(pans)[::-1], atol=1e-9)  # both alike


def test_an_obstacle_out_of_sight_for_a_second_is_looked_for_within_two_gazes():
    sweep, now = surveyed()
    lost = mover(0.8, 0.9, seen_s=now - 1.2)
    wanted = math.atan2(0.9, 0.8)
    pans = [sweep.next(now + k * STEP_S, Pose2(), VIA, [lost]).pan_rad for k in range(2)]
    assert min(abs(pan - wanted) for pan in pans) < math.radians(10)


@pytest.mark.parametrize(
    "other",
    [mover(0.1, 3.0, -10.0), mover(-1.0, 0.0, -10.0), mover(0.1, 1.0, -10.0, moving=0.0)],
    ids=["far", "behind", "standing"],
)
def test_distant_unreachable_and_static_obstacles_change_nothing(other):
    one, now = surveyed()
    two, _ = surveyed()
    for k in range(12):
        stamp = now + k * STEP_S
        assert one.next(stamp, Pose2(), VIA, [other]) == two.next(stamp, Pose2(), VIA, [])


def test_two_obstacles_out_of_sight_are_looked_for_in_turn():
    sweep, now = surveyed()
    left, right = mover(0.5, 1.2, -30.0), mover(0.5, -1.0, 5.0)
    right = Obstacle(right.state, 0.1, 0.4, 8, 1.0, 5.0, 0.0)
    pans = np.array(
        [sweep.next(now + k * STEP_S, Pose2(), VIA, [left, right]).pan_rad for k in range(12)]
    )
    assert np.any(pans > 1.0)
    assert np.any(pans < -0.8)


def test_every_gaze_is_within_the_neck_and_shows_the_floor_near_the_feet():
    sweep, now = surveyed()
    rng = np.random.default_rng(4)
    for k in range(100):
        robot = Pose2(0.0, 0.0, rng.uniform(-3, 3))
        gaze = sweep.next(now + k * STEP_S, robot, rng.uniform(-2, 2, 2), [mover(0.5, 0.5, -9.0)])
        assert abs(gaze.pan_rad) <= math.radians(90) + 1e-12
        lower, upper = gaze.tilt_rad + math.radians(17.5), gaze.tilt_rad - math.radians(17.5)
        assert 0.38 / math.tan(lower) <= 0.42
        assert upper > 0.0
        assert 0.38 / math.tan(upper) >= 0.9


def test_a_narrow_neck_limits_every_pan():
    sweep = Sweep(HeadLimits(pan_deg=30.0))
    for k in range(20):
        pan = sweep.next(k * STEP_S, Pose2(), VIA, []).pan_rad
        assert abs(pan) <= math.radians(30.0) + 1e-12
