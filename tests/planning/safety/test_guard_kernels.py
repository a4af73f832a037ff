"""The kernels of the guard: leaving out and sharing change no result, distances follow the covariances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.robot_model import DARWIN_OP
from planning.commands import WalkCommand
from planning.safety import _guard_arguments, _guard_kernels
from planning.safety.guard import Guard, GuardConfig, _desired_plans, _fixed_plans, _Scene
from planning.safety.guard_settings import CONTACT_COST_M, EXPECTED_CONTACT_M, PASS_M
from planning.safety.prediction import MotionPatterns

CONFIG = GuardConfig()
WITHOUT_MEMORY = replace(CONFIG, keep_m=0.0, keep_share=0.0)
GAIT = DARWIN_OP.gait


def scene_of(robot, obstacles, occupied, target):
    return _Scene(
        robot, obstacles, occupied, target, WITHOUT_MEMORY, DARWIN_OP, 0.0, MotionPatterns(),
        Guard(CONFIG).cell_distance_m,
    )  # fmt: skip


def judged_plans(desired, robot, obstacles, occupied, target):
    """(first step, harm) of every plan, all rolled out to the end, the best first."""
    plans = np.concatenate([_desired_plans(desired, GAIT), _fixed_plans(CONFIG.steps, GAIT)])
    scene = scene_of(robot, obstacles, occupied, target)
    harm, cost = scene.judge(plans)
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
    plans = _fixed_plans(CONFIG.steps, GAIT)
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


def test_plans_with_a_shared_first_part_have_the_same_cost_as_alone():
    rng = np.random.default_rng(3)
    many, samples = 6, 2 * CONFIG.steps
    begins = np.repeat(rng.uniform(-0.05, 0.05, (12, 3)), 4, axis=0)
    times = np.repeat(rng.integers(0, CONFIG.steps + 1, 12), 4)[:, None]
    plans = np.hstack(
        [begins, times, rng.uniform(-0.05, 0.05, (48, 3)), rng.integers(0, 2, (48, 1))]
    )
    discs = _guard_arguments.Discs(
        rng.uniform(-0.6, 0.6, (many, samples, 2)),
        rng.uniform(-0.1, 0.1, (many, samples, 2)),
        np.full((many, samples), 0.3),
        np.tile([2e-3, 1e-3, 5e-4], (many, samples, 1)),
        rng.uniform(0.1, 1.0, many),
        np.full((many, samples), 0.25),
    )
    cells = np.column_stack([np.linspace(-0.5, 0.5, 20), np.full(20, 0.4)])
    cells = cells[np.argsort(np.hypot(*cells.T))]
    needed = np.tile([0.185, 0.15], (20, 1))
    costs = _guard_arguments.Costs(0.1, 0.15, 40.0, 0.05, 4.0, 8.0, 1.3, 1.0, 0.15)
    gait = _guard_arguments.Gait(0.1, 0.65, 0.1, 0.05)
    fixed = (gait, discs, _guard_arguments.Cells(cells, needed), costs)

    def judged(some):
        results = np.empty((len(some), 4))
        robot, target = np.array([0.0, 0.0, 0.4]), np.array([1.5, 0.2])
        _guard_kernels.roll_out(robot, some, target, *fixed, results)
        return results

    alone = np.vstack([judged(plan[None].copy()) for plan in plans])
    assert np.ptp(alone[:, 0]) > 0.1
    np.testing.assert_array_equal(judged(plans.copy()), alone)


def test_relative_covariances_are_those_of_the_linear_motion_model():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(4, 4)), rng.normal(size=(3, 3))
    mover, robot, times = a @ a.T, b @ b.T, np.linspace(0.1, 6.0, 24)
    found = np.empty((24, 3))
    _guard_kernels.relative_covariances(mover, robot, times, 3.0, 0.2, found)
    for k, t in enumerate(np.minimum(times, 3.0)):
        step = np.hstack([np.eye(2), t * np.eye(2)])
        P = step @ mover @ step.T + robot[:2, :2] + (0.1 * t * t) ** 2 * np.eye(2)
        np.testing.assert_allclose(found[k], [P[0, 0], P[1, 1], P[0, 1]])


@pytest.mark.parametrize("turned", [0.0, 0.7, -1.2])
def test_the_distance_grows_only_in_the_direction_of_the_uncertainty(turned):
    """An obstacle ahead or beside, uncertain along or across its line."""
    c, s = np.cos(turned), np.sin(turned)
    ahead, left = np.array([c, s]), np.array([-s, c])

    def harm(place: np.ndarray, along_m: float, across_m: float) -> float:
        P = along_m**2 * np.outer(ahead, ahead) + across_m**2 * np.outer(left, left)
        cov = np.zeros((4, 4))
        cov[:2, :2], cov[2:, 2:] = P + 1e-6 * np.eye(2), 1e-8 * np.eye(2)
        state = np.concatenate([place, -1e-3 * ahead])
        mover = Obstacle(Gaussian(state, cov), 0.1, 0.4, 0, 1.0, 0.0)
        robot = Gaussian(np.array([0.0, 0.0, turned]), 1e-8 * np.eye(3))
        stand = WalkCommand()
        plans = judged_plans(stand, robot, [mover], np.zeros((0, 2)), 3.0 * ahead)
        return next(harm for command, harm in plans if command == stand)

    near = 0.15 + 0.1 + CONFIG.margin_m + 0.03  # clear by 3 cm, within the uneasy band
    for towards, across in ((ahead, (0.0, 0.12)), (left, (0.12, 0.0))):
        sure = harm(near * towards, 0.0, 0.0)
        assert harm(near * towards, *across) == pytest.approx(sure, abs=0.05)
        assert harm(near * towards, *reversed(across)) > sure + 1.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("off_m", "away_m", "speed"),
    [(0.05, 0.6, 0.1), (0.05, 0.82, 0.14), (0.12, 0.74, 0.1), (0.15, 0.69, 0.08)],
)
def test_a_robot_that_walks_through_the_path_of_a_reversed_obstacle_is_late_by_what_it_lacks(
    side, off_m, away_m, speed
):
    """It heads straight for the far edge: turning round or stepping aside would take longer."""
    beside, lead, react_s, top = 0.3, 0.35, 0.5, 0.1
    gait = _guard_arguments.Gait(0.1, 0.65, top, 0.02)
    start = np.array([-away_m, side * off_m])  # the obstacle at the origin went along +x
    times = np.arange(0.0, 20.0, 1e-4)
    y = start[1] - side * 0.9 * top * np.maximum(times - react_s, 0.0)
    leaves_s = times[np.argmax(side * y <= -beside)]
    front = -speed * times - lead * math.sqrt(1.0 - (off_m / beside) ** 2)
    arrives_s = times[np.argmax(front <= start[0])]
    lacks_m = (leaves_s - arrives_s) * top
    assert 0.0 < lacks_m < beside - off_m
    found = _guard_kernels._too_late(
        *start, -side * math.pi / 2, speed, 0.0, beside, lead, react_s, gait
    )
    assert found == pytest.approx(lacks_m, abs=1e-4)
