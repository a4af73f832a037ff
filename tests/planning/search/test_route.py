"""The route: a via point each step, loyalty to the path, and detours without progress."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP, GaitLimits
from planning.footsteps import footstep
from planning.search import route as route_module
from planning.search.astar import prepare
from planning.search.potential import SearchConfig
from planning.search.route import Route, RouteConfig

CELL_M = 0.05
SIDE = 71
ORIGIN = np.array([-1.775, -1.775])
GOAL = np.array([1.5, 0.0])
START = Pose2(-1.5, 0.0, 0.0)
KNOWN = np.zeros((SIDE, SIDE), bool)


def empty():
    return np.full((SIDE, SIDE), 0.02)


def fill(probability, x0, y0, x1, y1):
    c0, r0, c1, r1 = (round((v + 1.775) / CELL_M) for v in (x0, y0, x1, y1))
    probability[r0:r1, c0:c1] = 0.97
    return probability


def towards(robot, via, step_m):
    heading = math.atan2(via[1] - robot.y, via[0] - robot.x)
    return Pose2(
        robot.x + step_m * math.cos(heading), robot.y + step_m * math.sin(heading), heading
    )


def test_over_free_ground_the_goal_is_the_via_point():
    via = Route(SearchConfig()).update(empty(), KNOWN, ORIGIN, CELL_M, START, GOAL)
    np.testing.assert_allclose(via, GOAL, atol=1e-12)


def test_following_the_via_points_leads_round_a_wall_to_the_goal():
    probability = fill(empty(), -0.2, -1.2, 0.0, 1.775)
    route, robot = Route(SearchConfig()), START
    solid = (np.argwhere(probability > 0.5)[:, ::-1] + 0.5) * CELL_M + ORIGIN
    nearest = math.inf
    for _ in range(200):
        via = route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        robot = towards(robot, via, 0.045)
        nearest = min(nearest, float(np.hypot(*(solid - (robot.x, robot.y)).T).min()))
        if math.hypot(robot.x - GOAL[0], robot.y - GOAL[1]) < 0.05:
            break
    else:
        pytest.fail("never arrived")
    assert nearest > 0.12


def test_the_points_ahead_begin_with_the_via_point_and_end_at_the_goal():
    route = Route(SearchConfig())
    here = np.array([START.x, START.y])
    np.testing.assert_array_equal(route.ahead(here), here[None])
    wall = fill(empty(), -0.2, -1.2, 0.0, 1.775)
    via = route.update(wall, KNOWN, ORIGIN, CELL_M, START, GOAL)
    ahead = route.ahead(here)
    assert len(ahead) > 2
    np.testing.assert_array_equal(ahead[0], via)
    np.testing.assert_allclose(ahead[-1], GOAL, atol=1e-12)


def test_two_equal_paths_cause_no_oscillation():
    """An obstacle in the middle; the map favours one side or the other at random."""
    rng = np.random.default_rng(2)
    route, robot, sides = Route(SearchConfig()), START, []
    for _ in range(30):
        probability = fill(empty(), -0.3, -0.3, 0.3, 0.3)
        probability += rng.uniform(0.0, 0.02, probability.shape)
        side = rng.choice([-1, 1])
        fill(probability, -0.3, 0.3 if side > 0 else -0.35, 0.3, 0.35 if side > 0 else -0.3)
        via = route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        robot = towards(robot, via, 0.03)
        y = route.path.waypoints[:, 1]
        sides.append(np.sign(y[np.argmax(np.abs(y))]))
    assert len(set(sides)) == 1


def test_a_blocked_path_is_replaced():
    route = Route(SearchConfig())
    probability = fill(fill(empty(), -0.1, -1.775, 0.1, -0.9), -0.1, -0.3, 0.1, 1.2)
    first = route.update(probability, KNOWN, ORIGIN, CELL_M, START, GOAL)
    assert first[1] < 0.0
    fill(probability, -0.1, -0.9, 0.1, -0.3)
    second = route.update(probability, KNOWN, ORIGIN, CELL_M, START, GOAL)
    assert second[1] > 0.0
    assert route.path.clearance_m > 0.12


def test_without_progress_for_ten_seconds_it_takes_the_longer_path():
    """Two gaps; an unmapped obstacle stops the robot before the nearer one."""
    probability = fill(fill(empty(), -0.1, -0.9, 0.1, 0.9), -0.1, 1.6, 0.1, 1.775)
    robot, route, crossings = Pose2(-0.5, 0.8, 0.0), Route(SearchConfig()), []
    for _ in range(60):
        route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        x, y = route.path.waypoints.T
        after = int(np.argmax(x > 0.0))
        crossings.append(np.interp(0.0, x[after - 1 : after + 1], y[after - 1 : after + 1]))
    assert all(0.9 < y < 1.6 for y in crossings[:15])
    assert not all(0.9 < y < 1.6 for y in crossings[15:])


@pytest.mark.parametrize("yaw_deg", [-100.0, -60.0, 60.0, 100.0])
def test_of_two_equal_ways_it_takes_the_one_that_the_robot_faces(yaw_deg):
    probability = fill(empty(), -0.9, -0.4, -0.6, 0.4)
    route, robot = Route(SearchConfig()), Pose2(-1.5, 0.0, math.radians(yaw_deg))
    for _ in range(3):
        route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        assert route.path.waypoints[1, 1] * yaw_deg > 0.0


def test_a_turn_costs_as_much_as_the_way_walked_in_its_time():
    """Two gaps, the one behind nearer by less or by more than the walk of half a turn, 0.5 m."""
    for beyond_m, behind in ((0.2, False), (0.8, True)):
        ahead_y = 0.5 + beyond_m / 2
        wall = fill(empty(), 0.0, -1.775, 0.1, 1.775)
        for y in (-0.5, ahead_y):
            wall = np.where(fill(np.zeros_like(wall), 0.0, y - 0.25, 0.1, y + 0.25) > 0, 0.02, wall)
        robot, goal = Pose2(-0.3, 0.0, math.pi / 2), np.array([0.4, 0.0])
        route = Route(SearchConfig())
        route.update(wall, KNOWN, ORIGIN, CELL_M, robot, goal)
        assert (route.path.waypoints[1, 1] < 0.0) == behind


@pytest.mark.parametrize(("other", "taken"), [(True, 0.9), (False, 0.0)])
def test_a_gap_in_which_the_guard_would_stop_it_is_the_last_choice(other, taken):
    """A gap of 0.35 m on the straight line; 0.6 m wide beside it, or none."""
    wall = fill(empty(), 0.0, -1.775, 0.1, 1.775)
    wall = np.where(fill(np.zeros_like(wall), 0.0, -0.175, 0.1, 0.175) > 0, 0.02, wall)
    if other:
        wall = np.where(fill(np.zeros_like(wall), 0.0, 0.6, 0.1, 1.2) > 0, 0.02, wall)
    framed = wall.copy()
    framed[[0, -1]] = 0.97
    route = Route(SearchConfig())
    route.update(framed, KNOWN, ORIGIN, CELL_M, START, GOAL)
    x, y = route.path.waypoints.T
    after = int(np.argmax(x > 0.05))
    assert np.interp(0.05, x[after - 1 : after + 1], y[after - 1 : after + 1]) == pytest.approx(
        taken, abs=0.3
    )


def test_after_a_minute_of_oscillation_it_takes_the_longer_path():
    """The robot walks and turns, but obstacles keep coming through the gap."""
    probability = fill(fill(empty(), -0.1, -0.9, 0.1, 0.9), -0.1, 1.6, 0.1, 1.775)
    route, detours = Route(SearchConfig()), []
    for step in range(270):
        swing = 2.0 * math.pi * step / 40.0
        robot = Pose2(-0.6 + 0.4 * math.sin(swing), 0.9, math.pi * math.sin(swing / 2.0))
        route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        detours.append(route.detours)
    assert not any(detours[:80])
    assert detours[-1] > 0
    x, y = route.path.waypoints.T
    after = int(np.argmax(x > 0.0))
    assert not 0.9 < np.interp(0.0, x[after - 1 : after + 1], y[after - 1 : after + 1]) < 1.6


def test_a_robot_on_a_path_that_proves_longer_is_not_stuck():
    # walls appear one after the other, each makes the remaining path longer than before
    route, robot = Route(SearchConfig()), START
    for step in range(60):
        probability = empty()
        for n in range(1 + step // 20):
            low, high = ((-1.775, 1.2), (-1.2, 1.775))[n % 2]
            probability = fill(probability, -0.9 + 0.6 * n, low, -0.8 + 0.6 * n, high)
        robot = towards(robot, route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL), 0.045)
        assert route.detours == 0


def test_a_robot_that_turns_to_the_goal_is_not_stuck():
    route = Route(SearchConfig())
    for step in range(25):
        robot = Pose2(START.x, START.y, math.radians(170.0 - 7.0 * step))
        route.update(empty(), KNOWN, ORIGIN, CELL_M, robot, GOAL)
    assert route.detours == 0


def test_a_detour_ends_after_some_time():
    config = RouteConfig(memory_steps=5)
    route, robot = Route(SearchConfig(), config), START
    for _ in range(config.patience_steps + 2):
        route.update(empty(), KNOWN, ORIGIN, CELL_M, robot, GOAL)
    assert route.detours == 1
    for _ in range(6):
        robot = towards(robot, GOAL, 0.12)
        route.update(empty(), KNOWN, ORIGIN, CELL_M, robot, GOAL)
    assert route.detours == 0


def test_an_enclosed_robot_stays():
    probability = empty()
    probability[30:41, [2, 12]] = probability[[30, 40], 2:13] = 0.97
    route = Route(SearchConfig())
    via = route.update(probability, KNOWN, ORIGIN, CELL_M, START, GOAL)
    np.testing.assert_array_equal(via, [START.x, START.y])
    assert route.path is None


def test_a_goal_at_the_edge_of_a_scrolling_map_keeps_the_path():
    """The goal is alternately on the map and outside, behind a wall."""
    probability = fill(empty(), 0.4, -1.775, 0.6, 1.0)
    route, robot = Route(SearchConfig()), Pose2(-0.2, 0.0, 0.0)
    goal, sides = np.array([1.74, -0.5]), []
    for k in range(10):
        part = probability[:, : SIDE - 3 * (k % 2)]
        via = route.update(part, KNOWN[:, : SIDE - 3 * (k % 2)], ORIGIN, CELL_M, robot, goal)
        sides.append(via[1] > 0.5)
    assert all(sides)


def walls():
    """A wall with a gap at one end."""
    return fill(empty(), -0.2, -1.2, 0.0, 1.775)


@pytest.mark.parametrize("goal", [(1.5, 0.0), (21.0, 3.0), (-4.0, -21.7), (9.0, 21.7)])
def test_within_the_horizon_the_path_is_the_one_without_a_horizon(goal, monkeypatch):
    paths = []
    for horizon_m in (route_module.HORIZON_M, 1e9):
        monkeypatch.setattr(route_module, "HORIZON_M", horizon_m)
        route = Route(SearchConfig())
        for x in (-1.5, -1.45):
            route.update(walls(), KNOWN, ORIGIN, CELL_M, Pose2(x, 0.0, 0.0), np.array(goal))
        paths.append(route.path.waypoints)
    np.testing.assert_array_equal(*paths)
    np.testing.assert_allclose(paths[0][-1], goal, atol=1e-12)


@pytest.mark.parametrize("away_m", [60.0, 1e4])
def test_a_goal_beyond_the_horizon_costs_no_more_and_is_headed_for(away_m, monkeypatch):
    shapes = []

    def noted(probability, *rest):
        shapes.append(probability.shape)
        return prepare(probability, *rest)

    monkeypatch.setattr(route_module, "prepare", noted)
    goal = away_m * np.array([0.8, 0.6])
    route = Route(SearchConfig())
    via = route.update(empty(), KNOWN, ORIGIN, CELL_M, Pose2(-0.4, -0.3), goal)
    assert via / np.hypot(*via) == pytest.approx([0.8, 0.6], abs=1e-6)
    assert np.hypot(*via) > 20.0
    route.update(walls(), KNOWN, ORIGIN, CELL_M, Pose2(-1.2, -0.9), goal)
    x, y = route.path.waypoints.T
    assert -1.7 < np.interp(-0.1, x, y) < -1.35  # round the end of the wall
    assert max(max(shape) for shape in shapes) < SIDE + 22.0 / CELL_M


def test_a_robot_reaches_a_goal_beyond_the_horizon_by_the_straight_way():
    goal, robot, route, walked = np.array([45.0, 12.0]), START, Route(SearchConfig()), 0.0
    direct = math.hypot(goal[0] - robot.x, goal[1] - robot.y)
    while math.hypot(robot.x - goal[0], robot.y - goal[1]) > 1e-6:
        corner = np.floor(np.array([robot.x, robot.y]) / CELL_M) * CELL_M + ORIGIN
        via = route.update(empty(), KNOWN, corner, CELL_M, robot, goal)
        step_m = min(1.0, math.hypot(via[0] - robot.x, via[1] - robot.y))
        robot, walked = towards(robot, via, step_m), walked + step_m
        assert walked < 1.01 * direct


def test_a_new_goal_takes_effect_at_once():
    route = Route(SearchConfig())
    route.update(empty(), KNOWN, ORIGIN, CELL_M, START, GOAL)
    other = np.array([-1.0, 1.0])
    via = route.update(empty(), KNOWN, ORIGIN, CELL_M, START, other)
    np.testing.assert_allclose(via, other)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("patience_steps", 0),
        ("memory_steps", 0),
    ],
)
def test_impossible_settings_are_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=name):
        RouteConfig(**{name: value})


SLOW = GaitLimits(0.05, 0.07, 0.02, 0.02, 14.0, 0.1, 0.1)
"""Steps of 1 cm: 0.9 m in 90 of them."""


def walked(gait, robot, goal, most):
    """A robot that follows the via points of its route over free ground: the most detours, and where it is at the end."""
    route = Route(SearchConfig(), robot=replace(DARWIN_OP, gait=gait))
    detours = 0
    for _ in range(most):
        via = route.update(empty(), KNOWN, ORIGIN, CELL_M, robot, goal)
        detours = max(detours, route.detours)
        away_m = math.dist((robot.x, robot.y), goal)
        heading = math.atan2(via[1] - robot.y, via[0] - robot.x)
        step = footstep(heading, gait.cruise_mps, robot, gait, away_m)
        robot = robot @ Pose2(step.forward_m, 0.0, step.turn_rad)
        if away_m < 0.1:
            break
    return detours, robot


def test_a_robot_of_short_steps_that_walks_straight_to_its_goal_is_not_stuck():
    detours, robot = walked(SLOW, START, GOAL, 320)
    assert detours == 0
    assert math.dist((robot.x, robot.y), GOAL) < 0.11


def test_a_robot_that_turns_slowly_towards_its_goal_is_not_stuck():
    gait = replace(DARWIN_OP.gait, max_turn_deg=3.0)
    detours, robot = walked(gait, Pose2(0.0, 0.0, math.pi), np.array([1.0, 0.0]), 60)
    assert detours == 0
    assert math.cos(robot.yaw) > 0.0
