"""The legs of a passage: they end where they should under a lagging pose, and know what is in their way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits
from planning.avoidance.choice import AvoidanceConfig, ObstacleTable, choose
from planning.avoidance.pivot import Pivot
from planning.avoidance.primitives import Leg, Trim, in_the_way, passage, reached, retreat, step
from planning.footsteps import limited_step
from sim.body import gait as walk

GAIT = GaitLimits()
START = Pose2(0.4, -0.2, 0.3)


def _walk(legs: list[Leg], start: Pose2, lag: int = 1, most: int = 400) -> list[Pose2]:
    """Poses of an exact body whose planner knows where it was some steps ago."""
    poses, last = [start] * (lag + 1), None
    legs = list(legs)
    for _ in range(most):
        known = poses[-1 - lag]
        while legs and reached(legs[0], known):
            legs.pop(0)
        if not legs:
            return poses
        last = command = step(legs[0], known, GAIT, last=last)
        poses.append(poses[-1] @ Pose2(command.forward_m, command.lateral_m, command.turn_rad))
    pytest.fail("the legs never end")


@pytest.mark.parametrize("motion", ["SS", "SF", "RS", "RF", "TS", "TF"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_passage_ends_abreast_of_its_pivot_beyond_the_obstacle_heading_on(motion, side):
    x = 0.7 if motion[0] == "R" else 0.0
    found = Pivot(x, 0.4 * side, 0.0, 0.0)
    end = START.inverse() @ _walk(passage(motion, found, START, 1.6), START)[-1]
    assert end.x == pytest.approx(1.6, abs=0.06)
    assert end.y == pytest.approx(0.4 * side, abs=0.04)
    assert abs(end.yaw) < math.radians(8.0)


@settings(deadline=None, max_examples=30)
@given(st.floats(-0.03, 0.03), st.floats(-0.08, 0.08), st.integers(0, 2))
def test_drift_off_the_line_of_a_slip_dies_out_although_the_pose_lags(off, turned, lag):
    leg = Leg("S", Pose2(0.0, 0.0, 0.0))
    poses = _walk([leg], Pose2(off, -1.2, turned), lag)
    late = poses[len(poses) // 2 :]
    assert max(abs(p.x) for p in late) < 0.008
    assert (
        max(abs(p.x) for p in poses) < abs(off) + 0.012
    )  # a few steps askew before the pose tells of them


@pytest.mark.parametrize("lag", [0, 1])
@pytest.mark.parametrize(("primitive", "begin"), [("S", (0.0, -2.0)), ("F", (-2.0, 0.0))])
def test_feet_that_slip_alike_with_every_step_are_made_up_for(primitive, begin, lag):
    """1.2 mm and 0.3 deg a step, as measured on walkers: without learning 2 mm off the line, 0.7 deg askew."""
    leg, slip = Leg(primitive, Pose2()), Pose2(-0.0012, 0.0012, math.radians(0.3))

    def late(trim: Trim | None) -> tuple[float, float]:
        poses, last = [Pose2(*begin)] * (lag + 1), None
        while not reached(leg, poses[-1 - lag]):
            last = command = step(leg, poses[-1 - lag], GAIT, trim, last)
            made = Pose2(command.forward_m, command.lateral_m, command.turn_rad)
            poses.append(poses[-1] @ made @ slip)
        off = [pose.x if primitive == "S" else pose.y for pose in poses[-20:]]
        return max(map(abs, off)), max(abs(pose.yaw) for pose in poses[-20:])

    off_m, off_rad = late(Trim())
    assert off_m < 0.0015
    assert off_rad < math.radians(0.3)
    off_m, off_rad = late(None)
    assert off_m > 0.002
    assert off_rad > math.radians(0.6)


def test_what_led_far_astray_once_teaches_nothing():
    trim = Trim()
    for off, turn in ((0.03, 0.0), (0.0, 0.1), (-0.011, 0.0)):
        trim.learn(off, turn, sideways=True)
    assert trim == Trim()


def test_through_a_gap_the_body_goes_as_fast_as_ever_and_sways_less():
    command = step(Leg("F", Pose2(2.0, 0.0, 0.0)), Pose2(), GAIT)
    usual = limited_step(GAIT, GAIT.cruise_mps, 0.0, 0.0)
    assert command.forward_m / command.duration_s == pytest.approx(GAIT.cruise_mps)

    def sway(one) -> float:
        gait = walk.Gait(walk.GaitConfig())
        return max(float(np.abs(gait.step(one).com[:, 1]).max()) for _ in range(12))

    assert sway(command) < 0.7 * sway(usual)


def test_a_cell_beside_the_line_closes_no_passage_and_one_on_it_does():
    leg = Leg("S", START)
    robot = START @ Pose2(0.0, -0.5, 0.0)
    beside = START.apply(np.array([[0.06, -0.4], [-0.06, -0.35], [0.0, -0.65], [0.0, 0.3]]))
    on = START.apply(np.array([[0.01, -0.36]]))
    assert not in_the_way(leg, robot, beside, 0.05).any()
    assert in_the_way(leg, robot, on, 0.05).all()


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.sampled_from(["S", "F"]))
def test_what_closes_a_passage_would_be_touched_by_the_body(x, y, primitive):
    leg = Leg(primitive, Pose2(0.0, 0.0, 0.0))
    robot = Pose2(-0.5, 0.0, 0.0) if primitive == "F" else Pose2(0.0, -0.5, 0.0)
    cell = np.array([[robot.x + x, robot.y + y]])
    if in_the_way(leg, robot, cell, 0.05)[0]:
        across = y if primitive == "F" else x
        half = 0.082 if primitive == "F" else 0.055
        assert abs(across) + 0.025 < half + 1e-12  # the whole cell within the body's breadth


@pytest.mark.parametrize("primitive", ["S", "F"])
def test_a_retreat_leads_back_on_the_line_of_the_leg(primitive):
    end = START @ (Pose2(1.0, 0.0, 0.0) if primitive == "F" else Pose2(0.0, 1.0, 0.0))
    robot = START @ (Pose2(0.6, 0.0, 0.0) if primitive == "F" else Pose2(0.0, 0.6, 0.0))
    back = _walk(retreat(Leg(primitive, end), robot, 0.45), robot)[-1]
    there = START.inverse() @ back
    along, across = (there.x, there.y) if primitive == "F" else (there.y, there.x)
    assert along == pytest.approx(0.15, abs=0.04)
    assert across == pytest.approx(0.0, abs=0.01)


def test_turns_have_nothing_to_retreat_from():
    assert retreat(Leg("R", START), START, 0.4) == []


def _one_thing(open_m: tuple[float, float]) -> ObstacleTable:
    edges = np.array([[0.25, -0.25]])
    return ObstacleTable(
        np.arctan2(edges, 1.0),
        edges,
        np.array([1.0]),
        np.array([0.5]),
        np.array([0.3]),
        np.array([0.004]),
        open_m,
    )


def test_ground_that_was_not_seen_is_no_gap():
    seen = choose(_one_thing((2.0, -2.0)))
    blind = choose(_one_thing((0.3, -0.3)))
    assert seen is not None
    assert blind is not None
    assert seen.motion[1] == "F"
    assert blind.motion == "ST"
    assert blind.gap_m == pytest.approx(0.05)


def test_unseen_ground_before_a_neighbour_bounds_the_gap():
    edges = np.array([[0.25, -0.25], [1.2, 1.0]])
    both = ObstacleTable(
        np.arctan2(edges, 1.0),
        edges,
        np.array([1.0, 1.0]),
        np.array([0.5, 0.2]),
        np.array([0.3, 0.3]),
        np.array([0.004, 0.004]),
        (0.5, -0.3),
    )
    found = choose(both)
    assert found is not None
    assert found.side == 1
    assert found.gap_m == pytest.approx(0.25)


def test_the_complexity_of_the_specification_is_the_default():
    assert AvoidanceConfig().complexity == "frontal"
