"""The baselines of the guard keep clear of obstacles in easy situations, as their papers say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits
from planning.commands import WalkCommand
from planning.footsteps import footstep
from planning.safety.step_filter import StepFilter, Unfiltered
from surefoot.experiments.support.dynamic_window import DynamicWindow
from surefoot.experiments.support.velocity_obstacles import VelocityObstacles

GAIT = GaitLimits()
NOTHING = np.zeros((0, 2))
BASELINES = [DynamicWindow, VelocityObstacles]


def mover(x, y, vx, vy):
    return Obstacle(Gaussian(np.array([x, y, vx, vy]), np.eye(4) * 1e-4), 0.10, 0.4, 1, 1.0)


def play(step_filter, target, mover_at, steps=60, cells=NOTHING):
    pose, gap, wall = Pose2(), math.inf, math.inf
    for k in range(steps):
        now = 0.65 * k
        heading = math.atan2(target[1] - pose.y, target[0] - pose.x)
        wish = footstep(heading, 0.07, pose, GAIT)
        believed = Gaussian(pose.vector, np.eye(3) * 1e-4)
        step = step_filter.choose(wish, believed, [mover(*mover_at(now))], cells, target, now)
        pose = pose @ Pose2(step.forward_m, step.lateral_m, step.turn_rad)
        x, y, _, _ = mover_at(now + 0.65)
        gap = min(gap, math.hypot(x - pose.x, y - pose.y) - 0.25)
        if len(cells):
            wall = min(wall, float(np.hypot(*(cells - (pose.x, pose.y)).T).min()))
        if math.hypot(target[0] - pose.x, target[1] - pose.y) < 0.1:
            break
    return gap, wall, pose


@pytest.mark.parametrize("baseline", [*BASELINES, Unfiltered])
def test_each_implements_the_protocol(baseline):
    assert isinstance(baseline(), StepFilter)


@pytest.mark.parametrize("baseline", BASELINES)
@pytest.mark.parametrize("offset", [0.05, 0.2])
def test_a_slow_head_on_obstacle_is_avoided(baseline, offset):
    gap, _, _ = play(
        baseline(), np.array([2.0, 0.0]), lambda t: (1.8 - 0.04 * t, offset, -0.04, 0.0)
    )
    assert gap > 0.0


@pytest.mark.parametrize("baseline", BASELINES)
def test_without_obstacles_the_target_is_reached(baseline):
    _, _, end = play(baseline(), np.array([0.8, 1.0]), lambda t: (9.0, 9.0, 0.0, 0.0))
    assert math.hypot(end.x - 0.8, end.y - 1.0) < 0.15


@pytest.mark.parametrize("baseline", BASELINES)
def test_a_wall_is_avoided(baseline):
    ys = np.arange(-1.0, 1.0, 0.05)
    cells = np.stack([np.full_like(ys, 0.5), ys], axis=-1)
    _, wall, _ = play(
        baseline(), np.array([2.0, 0.0]), lambda t: (9.0, 9.0, 0.0, 0.0), steps=40, cells=cells
    )
    assert wall > 0.10


@pytest.mark.parametrize("baseline", BASELINES)
def test_a_desired_stop_is_kept(baseline):
    believed = Gaussian(np.zeros(3), np.eye(3) * 1e-4)
    step = baseline().choose(WalkCommand(), believed, [], NOTHING, np.array([1.0, 0.0]), 0.0)
    assert step == WalkCommand()


@pytest.mark.parametrize("baseline", BASELINES)
def test_without_obstacles_the_speed_is_the_cruising_speed(baseline):
    wish = footstep(0.0, 0.07, Pose2(), GAIT)
    believed = Gaussian(np.zeros(3), np.eye(3) * 1e-4)
    step = baseline().choose(wish, believed, [], NOTHING, np.array([3.0, 0.0]), 0.0)
    assert step.forward_m == pytest.approx(GAIT.cruise_mps * GAIT.step_s)
