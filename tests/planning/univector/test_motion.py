"""Heading and speed: the effect of each switch, and of the covariances."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.robot_model import GaitLimits, RobotModel
from planning.univector.fields import FieldConfig
from planning.univector.motion import advise, relative_covariance

PLAIN = FieldConfig(
    gaze_coupling=False, virtual_obstacles=False, velocity_change=False, uncertainty=False
)
SURE = np.eye(3) * 1e-12
SLOW = RobotModel(gait=GaitLimits(cruise_mps=0.0615))  # seed 000: 0.04 m a step
STEP_S, TURN = 0.65, math.radians(14.0)
GOAL = np.array([4.0, 0.0])


def mover(x, y, vx, vy, sigma=1e-6, moving=1.0):
    P = np.diag([sigma, sigma, sigma / 3, sigma / 3]) ** 2
    return Obstacle(Gaussian(np.array([x, y, vx, vy]), P), 0.10, 0.4, 1, moving)


def walk(config, start, velocity):
    """Walk to the goal past one obstacle: least gap, sum of turns, distance at the first turn."""
    pose, speed = np.zeros(3), SLOW.gait.cruise_mps
    gap, turning, first = math.inf, 0.0, math.nan
    for k in range(140):
        at = start + velocity * k * STEP_S
        said = advise(
            Gaussian(pose.copy(), SURE), speed, [mover(*at, *velocity)], GOAL, None, config, SLOW
        )
        turn = (said.heading_rad - pose[2] + math.pi) % (2 * math.pi) - math.pi
        turn = min(max(turn, -TURN), TURN)
        if math.isnan(first) and abs(turn) > math.radians(3.0):
            first = float(np.hypot(*(at - pose[:2])))
        turning, speed = turning + abs(turn), said.speed_mps
        for part in range(13):
            pose += [
                speed * STEP_S / 13 * math.cos(pose[2]),
                speed * STEP_S / 13 * math.sin(pose[2]),
                turn / 13,
            ]
            there = at + velocity * STEP_S * (part + 1) / 13
            gap = min(gap, float(np.hypot(*(pose[:2] - there))) - 0.25)
        if np.hypot(*(pose[:2] - GOAL)) < 0.1:
            return gap, turning, first
    pytest.fail("never arrived")


@pytest.mark.parametrize("offset", [0.0, 0.02, -0.1])
@pytest.mark.parametrize("speed", [0.03, 0.06, 0.15])
def test_the_virtual_obstacle_turns_earlier_less_and_passes_wider(speed, offset):
    start, velocity = np.array([2.5, offset]), np.array([-speed, 0.0])
    gap, turning, first = walk(PLAIN, start, velocity)
    wider, less, earlier = walk(replace(PLAIN, virtual_obstacles=True), start, velocity)
    assert wider > gap + 0.02
    assert less < turning
    assert earlier > first + 0.2


def test_head_on_it_reaches_the_figures_of_the_specification():
    start, velocity = np.array([2.5, 0.02]), np.array([-0.06, 0.0])
    gap, turning, first = walk(replace(PLAIN, virtual_obstacles=True), start, velocity)
    assert gap > 0.235
    assert math.degrees(turning) < 143.0
    assert first > 1.43 - STEP_S * (0.06 + 0.0615)  # the turn begins with a step


def test_the_virtual_obstacle_begins_without_a_jump():
    config = replace(PLAIN, virtual_obstacles=True)

    def heading(x):
        robot = Gaussian(np.zeros(3), SURE)
        return advise(
            robot, 0.0615, [mover(x, 0.05, -0.06, 0.0)], GOAL, None, config, SLOW
        ).heading_rad

    reach = 12.0 * (0.06 + 0.0615)
    assert heading(reach + 1e-6) == pytest.approx(0.0, abs=1e-9)
    assert abs(heading(reach - 1e-6)) < math.radians(1.0)
    assert abs(heading(reach - 0.2)) > math.radians(20.0)


def test_a_fast_obstacle_from_the_side_is_let_pass():
    velocity = np.array([0.0, -0.15])
    start = np.array([0.0615 * 15.0, 0.0]) - velocity * 15.0
    assert walk(PLAIN, start, velocity)[0] < 0.0
    assert walk(replace(PLAIN, velocity_change=True), start, velocity)[0] > 0.05


def test_without_additions_it_is_the_field_at_cruising_speed():
    said = advise(
        Gaussian(np.zeros(3), np.eye(3)),
        0.0615,
        [mover(1.0, 0.0, -0.06, 0.0)],
        GOAL,
        None,
        PLAIN,
        SLOW,
    )
    assert said.speed_mps == SLOW.gait.cruise_mps
    assert not said.virtual.any()
    np.testing.assert_allclose(said.extended_m, [0.15 + 0.10 + 0.5 * 0.06])
    assert said.psi.tolist() == [0.0]


def test_evaluations_and_covariance_enlarge_the_obstacle_each_by_its_switch():
    robot, vague = Gaussian(np.zeros(3), np.eye(3) * 0.02**2), mover(0.9, 0.3, -0.05, 0.0, 0.06)

    def size(**switches):
        config = replace(PLAIN, **switches)
        return float(advise(robot, 0.0615, [vague], GOAL, None, config).extended_m[0])

    assert size(gaze_coupling=True) > size() + 0.01
    assert size(uncertainty=True) == pytest.approx(size() + math.hypot(0.06, 0.02))
    wide = size(uncertainty=True, gaze_coupling=True)
    assert wide > max(size(uncertainty=True), size(gaze_coupling=True))


def test_uncertainty_slows_down_before_an_obstacle_that_the_mean_misses():
    config = replace(PLAIN, velocity_change=True)
    velocity = np.array([0.0, -0.10])
    place = np.array([0.60, 0.35])  # passes before the robot at 0.33 m; S_oe is 0.30 m
    robot = Gaussian(np.zeros(3), SURE)
    sure = advise(robot, 0.0615, [mover(*place, *velocity, 0.08)], GOAL, None, config, SLOW)
    careful = replace(config, uncertainty=True)
    doubtful = advise(robot, 0.0615, [mover(*place, *velocity, 0.08)], GOAL, None, careful, SLOW)
    assert sure.changes[0].case == "clear"
    assert doubtful.changes[0].case != "clear"


def test_the_relative_covariance_is_that_of_drawn_robots_and_obstacles():
    rng = np.random.default_rng(4)
    A, B = rng.normal(0, 0.02, (3, 3)), rng.normal(0, 0.02, (4, 4))
    robot = Gaussian(np.array([0.3, -0.2, 0.7]), np.zeros((3, 3)))
    P = A @ A.T
    P[:2, 2] = P[2, :2] = 0.0
    robot = Gaussian(robot.mean, P)
    other = Obstacle(Gaussian(np.array([1.1, 0.6, -0.1, 0.08]), B @ B.T), 0.1, moving=1.0)
    poses = rng.multivariate_normal(robot.mean, P, 40000)
    states = rng.multivariate_normal(other.state.mean, other.state.covariance, 40000)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = (states[:, :2] - poses[:, :2]).T
    vx, vy = states[:, 2:].T
    seen = np.column_stack([c * dx + s * dy, c * dy - s * dx, c * vx + s * vy, c * vy - s * vx])
    np.testing.assert_allclose(relative_covariance(robot, other), np.cov(seen.T), atol=4e-5)


def test_without_obstacles_the_path_is_straight_at_cruising_speed():
    said = advise(Gaussian(np.zeros(3), SURE), 0.05, [], GOAL, None, FieldConfig(), SLOW)
    assert said.heading_rad == pytest.approx(0.0)
    assert said.speed_mps == SLOW.gait.cruise_mps
    assert said.changes == ()


def test_a_cell_is_a_static_disc_of_half_its_side():
    here = Gaussian(np.zeros(3), SURE)
    cell = np.array([[0.5, 0.05]])
    by_cell = advise(here, 0.05, [], GOAL, None, PLAIN, cells=cell, cell_m=0.2)
    disc = replace(mover(*cell[0], 0.0, 0.0), radius_m=0.1)
    by_disc = advise(here, 0.05, [disc], GOAL, None, PLAIN)
    assert by_cell.heading_rad == pytest.approx(by_disc.heading_rad)
    assert by_cell.heading_rad < -math.radians(10.0)
    assert not by_cell.virtual.any()


def test_the_published_motion_passes_before_by_the_printed_law():
    config = FieldConfig(mode="seed").as_walked
    velocity, place, speed = np.array([0.0, -0.15]), np.array([0.9, 2.2]), 0.0615
    said = advise(
        Gaussian(np.zeros(3), SURE), speed, [mover(*place, *velocity)], GOAL, None, config, SLOW
    )
    w = speed * np.array([1.0, 0.0]) - velocity  # on collision course at the present speed
    radius = 0.15 + 0.10 + 0.5 * 0.15
    assert abs(place[0] * w[1] - place[1] * w[0]) / np.hypot(*w) < radius
    assert said.changes[0].case == "accelerate"
    fast = brentq(lambda v: _miss(place, velocity, v) - radius, speed, 0.2)  # v_c1
    w = fast * np.array([1.0, 0.0]) - velocity
    t = float(place @ w) / float(w @ w)
    a = said.changes[0].acceleration_mps2
    assert a == pytest.approx(2.0 * (fast * t - speed * t) / t**2, rel=1e-3)  # a_1
    assert said.speed_mps == pytest.approx(min(speed + a * STEP_S, SLOW.gait.max_speed_mps))


def _miss(place, velocity, speed):
    w = speed * np.array([1.0, 0.0]) - velocity
    return abs(place[0] * w[1] - place[1] * w[0]) / np.hypot(*w)


@pytest.mark.parametrize("cruise_mps", [0.05, 0.07, 0.24, 1.5])
def test_every_robot_is_at_its_cruising_speed_after_the_same_number_of_steps(cruise_mps):
    model = RobotModel(gait=GaitLimits(cruise_mps, 1.4 * cruise_mps))
    speed = 0.0
    for _ in range(3):  # 0.05 m/s^2 for a DARwIn-OP: 1.4 s
        said = advise(Gaussian(np.zeros(3), SURE), speed, [], GOAL, None, FieldConfig(), model)
        assert 0.0 < said.speed_mps - speed < 0.5 * cruise_mps
        speed = said.speed_mps
    assert speed == pytest.approx(cruise_mps)
