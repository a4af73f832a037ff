"""Footsteps stay within the limits of the gait and turn towards the heading."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle
from perception.primitives.robot_model import GaitLimits
from planning.footsteps import footstep, limited_step

GAIT = GaitLimits()
angles = st.floats(-10.0, 10.0)


@given(angles, angles, st.floats(-1.0, 1.0))
def test_no_step_exceeds_the_gait(heading, yaw, speed):
    step = footstep(heading, speed, Pose2(1.0, -2.0, yaw), GAIT)
    assert -0.03 * 0.65 - 1e-12 <= step.forward_m <= 0.10 * 0.65 + 1e-12
    assert abs(step.turn_rad) <= math.radians(14.0) + 1e-12
    assert step.lateral_m == 0.0
    assert step.duration_s == pytest.approx(0.65)


@given(angles, angles)
def test_a_step_never_turns_away_from_the_heading(heading, yaw):
    step = footstep(heading, 0.07, Pose2(0.0, 0.0, yaw), GAIT)
    before = abs(wrap_angle(heading - yaw))
    after = abs(wrap_angle(heading - yaw - step.turn_rad))
    assert after <= before + 1e-9
    if before <= GAIT.max_turn_rad:
        assert after == pytest.approx(0.0, abs=1e-9)


def test_ahead_the_step_is_a_cruising_step_and_sideways_a_turn_on_the_spot():
    assert footstep(0.1, 0.07, Pose2(0.0, 0.0, 0.1), GAIT).forward_m == pytest.approx(0.0455)
    assert footstep(math.radians(110), 0.07, Pose2(), GAIT).forward_m == 0.0


@pytest.mark.parametrize("gait", [GAIT, GaitLimits(0.22, 0.29, 0.10, 0.10, 14.0, 0.5, 0.2)])
def test_a_robot_does_not_go_round_a_target_beside_it(gait):
    robot, nearest_m = Pose2(), 0.24
    for _ in range(40):
        dx, dy = -robot.x, 0.24 - robot.y
        nearest_m = min(nearest_m, math.hypot(dx, dy))
        step = footstep(math.atan2(dy, dx), gait.cruise_mps, robot, gait, math.hypot(dx, dy))
        half = Pose2(step.forward_m / 2, 0.0, 0.0)
        robot = robot @ half @ Pose2(0.0, 0.0, step.turn_rad) @ half
    assert nearest_m < 0.05


@pytest.mark.parametrize("goal", [(3.0, 0.3), (-2.0, 0.2), (5.0, 5.0)])
def test_a_robot_with_steps_longer_than_the_tolerance_does_not_pass_its_goal_for_ever(goal):
    """Steps of 0.5 m; a goal counts as reached within 0.1 m."""
    gait = GaitLimits(1.0, 1.4, 0.4, 0.4, 14.0, 0.25, 0.25)
    robot, nearest_m = Pose2(), math.inf
    for _ in range(100):
        dx, dy = goal[0] - robot.x, goal[1] - robot.y
        nearest_m = min(nearest_m, math.hypot(dx, dy))
        step = footstep(math.atan2(dy, dx), gait.cruise_mps, robot, gait, math.hypot(dx, dy))
        robot = robot @ Pose2(step.forward_m, 0.0, step.turn_rad)
    assert nearest_m <= 0.1


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4))
def test_a_step_within_the_limits_is_not_changed(forward, left, turn):
    step = limited_step(GAIT, forward, left, turn)
    if -0.03 <= forward <= 0.10:
        assert step.forward_m == pytest.approx(0.65 * forward)
    if abs(left) <= 0.03:
        assert step.lateral_m == pytest.approx(0.65 * left)
    assert abs(step.lateral_m) <= 0.03 * 0.65 + 1e-12


def test_a_cruising_speed_above_the_top_speed_is_refused():
    with pytest.raises(ConfigError, match="cruise_mps"):
        GaitLimits(cruise_mps=0.2)
