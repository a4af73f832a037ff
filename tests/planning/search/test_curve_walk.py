"""The gait walks the arcs of the smoothed path: footsteps stay on the curve, at full speed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import DARWIN_OP
from planning import footsteps
from planning.search.curve_walk import CurveWalk
from planning.search.potential import Reach, SearchConfig
from planning.search.route import Route, RouteConfig

CELL_M = 0.05
SIDE = 71
ORIGIN = np.array([-1.775, -1.775])
KNOWN = np.zeros((SIDE, SIDE), bool)
START, GOAL = Pose2(-1.5, 0.0, -0.9), np.array([1.5, 0.0])
GAIT = DARWIN_OP.gait


def wall(top_m=1.775):
    """A wall across the straight way, with a passage below it."""
    probability = np.full((SIDE, SIDE), 0.02)
    c0, r0, c1, r1 = (round((v + 1.775) / CELL_M) for v in (-0.2, -1.2, 0.0, top_m))
    probability[r0:r1, c0:c1] = 0.97
    return probability


def stepped(robot, command):
    """The pose after a footstep: half of the turn before the body moves, half after."""
    half = Pose2(0.0, 0.0, command.turn_rad / 2)
    return robot @ half @ Pose2(command.forward_m, command.lateral_m, 0.0) @ half


def walk(aims, change=None):
    """Poses, commands and the first curve of a walk to the goal; `change` maps the step to another map."""
    route, robot, first = Route(SearchConfig()), START, None
    poses, commands = [], []
    for number in range(200):
        probability = wall() if change is None else change(number)
        via = route.update(probability, KNOWN, ORIGIN, CELL_M, robot, GOAL)
        first = route.path.curve if first is None else first
        here = np.array([robot.x, robot.y])
        aim = via if aims is None else aims.aim(route.path, here)
        heading = math.atan2(aim[1] - robot.y, aim[0] - robot.x)
        commands.append(footsteps.footstep(heading, GAIT.cruise_mps, robot, GAIT))
        robot = stepped(robot, commands[-1])
        poses.append((robot.x, robot.y))
        if math.hypot(robot.x - GOAL[0], robot.y - GOAL[1]) < 0.06:
            return np.array(poses), commands, first
    pytest.fail("never arrived")


def off(poses, curve):
    """Distance of poses to a polyline."""
    begin, way = curve[:-1], np.diff(curve, axis=0)
    share = np.einsum("nij,ij->ni", poses[:, None] - begin, way) / np.sum(way**2, axis=1)
    feet = begin + np.clip(share, 0.0, 1.0)[..., None] * way
    return np.linalg.norm(poses[:, None] - feet, axis=2).min(axis=1)


def test_footsteps_follow_the_arcs_where_way_points_leave_them():
    poses, commands, curve = walk(CurveWalk(GAIT))
    assert off(poses, curve).max() < 0.01
    by_points, _, curve = walk(None)
    assert off(by_points, curve).max() > 0.03
    turns = np.array([abs(one.turn_rad) for one in commands])
    assert turns.max() <= GAIT.max_turn_rad + 1e-12
    assert np.degrees(turns.sum()) < 110.0  # the curve itself turns by 94 deg


def test_the_robot_does_not_slow_down_on_an_arc():
    _, commands, _ = walk(CurveWalk(GAIT))
    cruise = GAIT.cruise_mps * GAIT.step_s
    assert (
        cruise / GAIT.max_turn_rad <= Reach.of(SearchConfig(), DARWIN_OP).turn_m + 1e-9
    )  # one step on an arc needs no sharper turn
    assert min(one.forward_m for one in commands[1:]) > 0.95 * cruise


@pytest.mark.parametrize(("cruise_mps", "max_turn_deg"), [(0.07, 14.0), (0.07, 7.0), (0.21, 14.0)])
def test_no_arc_turns_more_sharply_than_the_gait_can(cruise_mps, max_turn_deg):
    gait = replace(GAIT, cruise_mps=cruise_mps, max_speed_mps=0.3, max_turn_deg=max_turn_deg)
    route = Route(SearchConfig(), robot=replace(DARWIN_OP, gait=gait))
    route.update(wall(), KNOWN, ORIGIN, CELL_M, START, GOAL)
    way = np.diff(route.path.curve, axis=0)
    length, heading = np.hypot(*way.T), np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    turns = np.abs(np.diff(heading))
    on_arc = (turns > 1e-6) & (length[:-1] < 0.3) & (length[1:] < 0.3)
    radius = (length[:-1] + length[1:])[on_arc] / 2 / turns[on_arc]
    least_m = cruise_mps * gait.step_s / gait.max_turn_rad
    assert on_arc.any() or route.path.corners == len(turns)
    assert radius.min(initial=np.inf) > 0.99 * least_m


def test_a_curve_that_becomes_blocked_is_given_up():
    full = wall()
    full[:20, 34:36] = 0.97  # the passage below closes
    full[60:, 31:36] = 0.02  # another opens above

    def change(number):
        return wall() if number < 5 else full

    poses, _, curve = walk(CurveWalk(GAIT), change)
    assert off(poses, curve).max() > 0.5
    assert poses[:, 1].max() > 1.0


def test_an_unknown_way_of_walking_is_refused():
    with pytest.raises(ConfigError, match="follow='splines' is unknown; choose points, curve"):
        RouteConfig(follow="splines")
