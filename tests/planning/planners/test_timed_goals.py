"""Timed goals, and the schedule that lengthens steps to make up a delay within the limits of the gait."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.estimate import Estimate
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits
from planning.footsteps import limited_step
from planning.planners.mission import MissionConfig
from planning.planners.timed_goals import Schedule, TimedGoals
from planning.world_model import WorldModel

GAIT = GaitLimits()
GOAL = np.array([4.0, 0.0])
CRUISING = limited_step(GAIT, GAIT.cruise_mps, 0.0, 0.0)


def arrival_s(held_up_steps, make_up=True):
    """Straight to the goal; the first steps are lost."""
    schedule, x, stamp_s = Schedule(GAIT), 0.0, 0.0
    while GOAL[0] - x > 0.1:
        walk = schedule.make_up(CRUISING, GOAL, Pose2(x, 0.0, 0.0), stamp_s)
        forward = walk.forward_m if make_up else CRUISING.forward_m
        x += 0.0 if stamp_s < held_up_steps * GAIT.step_s else forward
        stamp_s += GAIT.step_s
    return stamp_s


def test_a_robot_on_time_walks_at_cruising_speed():
    schedule = Schedule(GAIT)
    for k in range(50):
        robot = Pose2(k * CRUISING.forward_m, 0.0, 0.0)
        assert schedule.make_up(CRUISING, GOAL, robot, k * GAIT.step_s) == CRUISING


def test_a_delay_is_made_up_and_no_more():
    on_time = (GOAL[0] - 0.1) / GAIT.cruise_mps
    assert arrival_s(20, make_up=False) > on_time + 12.0
    assert on_time - GAIT.step_s <= arrival_s(20) < on_time + 5.0


@given(st.floats(0.0, 300.0), st.floats(0.0, 3.8))
def test_no_step_exceeds_the_limit_of_the_gait(stamp_s, x):
    schedule = Schedule(GAIT)
    schedule.make_up(CRUISING, GOAL, Pose2(), 0.0)
    walk = schedule.make_up(CRUISING, GOAL, Pose2(x, 0.0, 0.0), stamp_s)
    assert CRUISING.forward_m <= walk.forward_m <= GAIT.max_speed_mps * GAIT.step_s + 1e-12


def test_turning_steps_are_not_lengthened():
    schedule = Schedule(GAIT)
    schedule.make_up(CRUISING, GOAL, Pose2(), 0.0)
    turn = limited_step(GAIT, 0.02, 0.0, math.radians(14.0))
    assert schedule.make_up(turn, GOAL, Pose2(), 60.0) == turn


def test_a_new_goal_starts_a_new_schedule():
    schedule = Schedule(GAIT)
    schedule.make_up(CRUISING, GOAL, Pose2(), 0.0)
    late = schedule.make_up(CRUISING, GOAL, Pose2(), 30.0)
    fresh = schedule.make_up(CRUISING, -GOAL, Pose2(0.0, 0.0, math.pi), 30.0)
    assert late.forward_m == pytest.approx(GAIT.max_speed_mps * GAIT.step_s)
    assert fresh == CRUISING


def at(stamp_s, x, y):
    pose = Gaussian(np.array([x, y, 0.0]), np.eye(3) * 1e-6)
    return WorldModel(Estimate(stamp_s, pose))


def test_each_goal_is_valid_in_its_time_and_only_the_last_one_ends_the_mission():
    goals = TimedGoals([(1.0, 0.0), (0.0, 2.0), (5.0, 5.0)], (0.0, 70.0), MissionConfig())
    assert not goals.finished(at(10.0, 1.0, 0.05))
    assert goals.present is not None
    assert goals.present.tolist() == [1.0, 0.0]
    assert not goals.finished(at(69.9, 0.0, 2.0))
    assert not goals.finished(at(70.0, 0.0, 1.0))
    assert goals.present.tolist() == [0.0, 2.0]
    assert goals.finished(at(80.0, 0.0, 1.95))
    assert goals.reached == 2
