"""The kernels of the guard: leaving out and sharing change no result, distances follow the covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.robot_model import DARWIN_OP
from planning.commands import WalkCommand
from planning.safety.guard import Guard, GuardConfig, _desired_plans, _fixed_plans, _Scene
from planning.safety.guard_settings import CONTACT_COST_M, EXPECTED_CONTACT_M, PASS_M
from planning.safety.prediction import MotionPatterns

CONFIG = GuardConfig()
GAIT = DARWIN_OP.gait


def scene_of(robot, obstacles, occupied, target):
    return _Scene(
        robot, obstacles, occupied, target, CONFIG, DARWIN_OP, 0.0, MotionPatterns(),
        Guard(CONFIG).cell_distance_m,
    )  # fmt: skip


def judged_plans(desired, robot, obstacles, occupied, target):
    """(first step, harm) of every plan, all rolled out to the end, the best first."""
    plans = np.concatenate([_desired_plans(desired, GAIT), _fixed_plans(CONFIG.steps, GAIT)])
    scene = scene_of(robot, obstacles, occupied, target)
    harm, cost = scene.judge(scene.walked(plans))
    order = np.argsort(cost, kind="stable")
    if harm[0] <= PASS_M:
        order = np.concatenate([[0], order[order != 0]])
    return [(desired if i == 0 else scene.step(plans[i]), float(harm[i])) for i in order]


def crowd(seed):
    """Five obstacles that may move, too uncertain to be learnt from, and a wall round a robot."""
    rng = np.random.default_rng(seed)
    robot = Gaussian(np.array([0.0, 0.0, rng.uniform(-3, 3)]), np.eye(3) * 1e-4)
    movers = []
    for k in range(5):
        state = np.concatenate([rng.uniform(-1.0, 1.0, 2), rng.uniform(-0.1, 0.1, 2)])
        movers.append(
            Obstacle(Gaussian(state, np.eye(4) * 1e-3), 0.1, 0.4, k, 0.45, -rng.uniform(0, 5))
        )
    wall = np.column_stack([np.linspace(-1, 1, 40), np.full(40, rng.uniform(0.3, 0.8))])
    return robot, movers, wall, rng.uniform(-2, 2, 2)


@pytest.mark.parametrize("forbidden", [0.0, 0.9])
@pytest.mark.parametrize("seed", range(20))
def test_risks_left_out_in_the_search_change_no_choice(seed, forbidden):
    robot, movers, wall, target = crowd(seed)
    scene = scene_of(robot, movers, wall, target)
    plans = scene.walked(_fixed_plans(CONFIG.steps, GAIT))
    _, cost = scene.judge(plans)
    cost[np.random.default_rng(seed).random(len(plans)) < forbidden] = math.inf
    every = cost + EXPECTED_CONTACT_M * scene.risks(plans, to_the_end=True)
    assert scene.cheapest(plans, cost) == np.argmin(every)


@pytest.mark.parametrize("seed", range(20))
def test_a_plan_with_contact_is_not_the_best_where_a_clear_one_exists(seed):
    plans = judged_plans(WalkCommand(0.0455, 0.0, 0.0), *crowd(seed))
    harms = [harm for _, harm in plans]
    assert harms[0] < CONTACT_COST_M or min(harms) > 0.0


def test_the_first_step_of_every_plan_respects_the_limits():
    plans = judged_plans(WalkCommand(0.0455, 0.0, 0.0), *crowd(1))
    for command, _ in plans:
        assert -0.0196 <= command.forward_m <= 0.0651
        assert abs(command.lateral_m) <= 0.0196
        assert abs(command.turn_rad) <= math.radians(14) + 1e-12


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_every_plan_is_walked_step_by_step_within_the_limits_of_the_gait(turned):
    """A pose after each step is the one before it moved by a step that the gait allows; all of it, not the first only."""
    robot, target = Gaussian(np.array([0.3, -0.2, turned]), np.eye(3) * 1e-6), np.array([0.4, 0.5])
    plans = np.concatenate(
        [_desired_plans(WalkCommand(0.05, 0.01, 0.1), GAIT), _fixed_plans(CONFIG.steps, GAIT)]
    )
    places = scene_of(robot, [], np.zeros((0, 2)), target).walked(plans)
    assert places.shape == (len(plans), 2 * CONFIG.steps, 3)
    ends = np.concatenate([np.tile(robot.mean, (len(plans), 1, 1)), places[:, 1::2]], axis=1)
    moved, yaw = np.diff(ends[..., :2], axis=1), ends[:, :-1, 2]
    forward = np.cos(yaw) * moved[..., 0] + np.sin(yaw) * moved[..., 1]
    left = np.cos(yaw) * moved[..., 1] - np.sin(yaw) * moved[..., 0]
    turn = np.angle(np.exp(1j * np.diff(ends[..., 2], axis=1)))
    step = GAIT.step_s
    assert -GAIT.max_back_mps * step - 1e-9 <= forward.min()
    assert forward.max() <= GAIT.max_speed_mps * step + 1e-9
    assert np.abs(left).max() <= GAIT.max_side_mps * step + 1e-9
    assert np.abs(turn).max() <= GAIT.max_turn_rad + 1e-9
    np.testing.assert_allclose(places[:, ::2, :2], ends[:, :-1, :2] + moved / 2.0, atol=1e-12)
    np.testing.assert_allclose(places[:, ::2, 2], places[:, 1::2, 2])
    steps = np.stack([forward, left, turn], axis=-1)
    np.testing.assert_allclose(steps[:3, 0], 3 * [[0.05, 0.01, 0.1]], atol=1e-12)
    np.testing.assert_allclose(
        steps[2, 1], steps[2, 0], atol=1e-12
    )  # the third plan makes it twice
    assert np.abs(steps[1, 1:]).max() == np.abs(steps[2, 2:]).max() == 0.0  # then these two stand
    bearing = np.arctan2(*(target - ends[0, 1, :2])[::-1])  # and the first one turns to the target
    error = np.angle(np.exp(1j * (bearing - ends[0, 1, 2])))
    assert turn[0, 1] == pytest.approx(np.clip(error, -GAIT.max_turn_rad, GAIT.max_turn_rad))
    pursues, stays = np.hypot(*(ends[:2, -1, :2] - target).T)
    assert pursues < stays - 0.1
