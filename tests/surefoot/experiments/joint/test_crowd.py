"""The crowd of the corridor: pedestrians as printed, runs that repeat, and a check that beats none."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from surefoot.experiments.joint.crowd import PLANNERS
from surefoot.experiments.support.crowd_world import (
    GOAL_M,
    MOST,
    PERSON_M,
    SPEEDS_MPS,
    UNICYCLE,
    WIDTH_M,
    Crowd,
    passage,
)

FAR = np.array([-100.0, 0.0])


def test_pedestrians_walk_at_their_speeds_inside_the_corridor_without_touching():
    crowd, nearest, speeds = Crowd(12, True, np.random.default_rng(0)), [], []
    for _ in range(400):
        crowd.advance(0.05, FAR)
        apart = np.hypot(*(crowd.state[:, None, :2] - crowd.state[None, :, :2]).transpose(2, 0, 1))
        nearest.append(np.min(apart + 9.0 * np.eye(12)))
        speeds.append(np.hypot(*crowd.state[:, 2:].T))
        assert np.all(np.abs(crowd.state[:, 1]) <= WIDTH_M / 2.0 - PERSON_M + 1e-9)
    assert np.quantile(nearest, 0.05) > 1.6 * PERSON_M
    assert SPEEDS_MPS[0] - 0.2 < np.mean(speeds) < SPEEDS_MPS[1]
    assert np.max(speeds) <= MOST * SPEEDS_MPS[1] + 1e-9


def test_pedestrians_evade_a_robot_that_they_see_and_not_one_that_they_do_not():
    gaps = []
    for reacting in (True, False):
        crowd = Crowd(1, reacting, np.random.default_rng(4))
        robot = crowd.state[0, :2] + [6.0, 0.05]
        least = np.inf
        for _ in range(200):
            crowd.advance(0.05, robot)
            least = min(least, float(np.hypot(*(crowd.state[0, :2] - robot))))
        gaps.append(least)
    assert gaps[0] > gaps[1] + 0.1


def test_a_run_without_a_check_takes_the_time_of_the_straight_way_or_ends_in_contact():
    runs = [passage(PLANNERS["straight_on"], 4, True, seed) for seed in range(6)]
    for one in runs:
        assert one.safe == one.arrived
        if one.arrived:
            assert one.seconds == pytest.approx(GOAL_M / UNICYCLE.gait.max_speed_mps, abs=0.3)
    assert any(one.safe for one in runs)
    assert not all(one.safe for one in runs)


def test_ours_is_safe_where_going_straight_on_is_not_and_repeats_to_the_bit():
    blind = [passage(PLANNERS["straight_on"], 12, True, seed) for seed in range(4)]
    seeing = [passage(PLANNERS["ours"], 12, True, seed) for seed in range(4)]
    assert sum(one.safe for one in seeing) > sum(one.safe for one in blind)
    again = passage(PLANNERS["ours"], 12, True, 0)
    assert (again.safe, again.seconds) == (seeing[0].safe, seeing[0].seconds)


@pytest.mark.parametrize("name", PLANNERS)
def test_every_planner_asks_for_steps_that_a_unicycle_can_do(name):
    steps = PLANNERS[name](UNICYCLE)
    crowd = Crowd(8, True, np.random.default_rng(1))
    pose = Gaussian(Pose2().vector, np.eye(3) * 1e-4)
    wish = WalkCommand(forward_m=0.4)
    found = steps.choose(
        wish, pose, crowd.tracks(0.0), np.zeros((0, 2)), np.array([12.0, 0.0]), 0.0
    )
    gait = UNICYCLE.gait
    assert found.lateral_m == 0.0
    assert -gait.max_back_mps * gait.step_s - 1e-9 <= found.forward_m <= 0.4 + 1e-9
    assert abs(found.turn_rad) <= gait.max_turn_rad + 1e-9
