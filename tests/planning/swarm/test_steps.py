"""The best pixel as a footstep, and the memories of the ground."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.pose import Pose2
from perception.primitives.robot_model import GaitLimits, RobotModel
from planning.swarm import command
from planning.swarm.corners import Corners
from planning.swarm.ground_memory import MEMORY_S, GroundMemory
from planning.swarm.settings import SwarmWalkerConfig

GAIT = GaitLimits()
metres = st.floats(-3.0, 3.0)
angles = st.floats(-math.pi, math.pi)


@given(metres, metres, angles)
def test_no_command_turns_farther_than_theta_safety(x, y, yaw):
    robot, place = Pose2(0.1, 0.2, yaw), np.array([x, y])
    for walk in (
        command.towards(place, robot, GAIT),
        command.printed(place, robot, GAIT),
        command.published(place, robot, GAIT),
        command.turning(place, robot, GAIT),
    ):
        assert abs(walk.turn_rad) <= math.radians(14.0) + 1e-12


@given(metres, metres, angles, angles)
def test_turning_world_and_robot_together_changes_no_command(x, y, yaw, turn):
    world = Pose2(0.0, 0.0, turn)
    place, robot = np.array([x, y]), Pose2(0.0, 0.0, yaw)
    if math.hypot(x, y) < 0.01 or abs(abs(command.angle_to(place, robot)) - math.pi) < 1e-3:
        return
    before = command.towards(place, robot, GAIT)
    after = command.towards(world.apply(place), world @ robot, GAIT)
    assert after.turn_rad == pytest.approx(before.turn_rad, abs=1e-9)
    assert after.forward_m == pytest.approx(before.forward_m, abs=1e-9)


def test_no_step_leads_beyond_the_pixel():
    gait = GaitLimits(1.0, 1.4)  # steps of 0.65 m
    walk = command.towards(np.array([0.0, 0.3]), Pose2(yaw=math.pi / 2), gait)
    assert walk.forward_m == pytest.approx(0.3)


def test_straight_ahead_is_a_full_step():
    walk = command.towards(np.array([0.0, 2.0]), Pose2(yaw=math.pi / 2), GAIT)
    assert walk.forward_m == pytest.approx(0.07 * 0.65)
    assert walk.turn_rad == pytest.approx(0.0, abs=1e-12)
    assert command.printed(np.array([2.0, 0.0]), Pose2(), GAIT).forward_m == pytest.approx(0.04)


def test_the_printed_angle_is_correct_only_for_a_heading_along_y():
    place = np.array([0.2, 2.0])
    along_y = command.printed(place, Pose2(yaw=math.pi / 2), GAIT)
    assert along_y.turn_rad == pytest.approx(-math.atan2(0.2, 2.0))
    assert along_y.turn_rad == pytest.approx(
        command.angle_to(place, Pose2(yaw=math.pi / 2)), abs=1e-12
    )
    assert command.printed(place, Pose2(yaw=0.3), GAIT).turn_rad == along_y.turn_rad


def test_the_printed_angle_tells_behind_from_ahead():
    """The arc tangent of the ratio would walk straight on for a goal behind the robot."""
    behind = command.printed(np.array([0.01, -2.0]), Pose2(yaw=math.pi / 2), GAIT)
    assert abs(behind.turn_rad) == pytest.approx(math.radians(14.0))


def test_a_blocked_robot_turns_on_the_spot_towards_the_goal():
    for side in (1.0, -1.0):
        walk = command.turning(np.array([1.0, side]), Pose2(), GAIT)
        assert (walk.forward_m, walk.lateral_m) == (0.0, 0.0)
        assert walk.turn_rad == pytest.approx(side * math.radians(14.0))


def test_an_obstacle_in_a_corner_closes_its_side_until_it_is_passed():
    corners = Corners()
    corners.update((True, False), 0.16, 0.04)
    assert corners.steps == (4, 0)  # S_m of the seed
    assert corners.blocked == (True, False)
    for left in (3, 2, 1, 0):
        corners.update((False, False), 0.16, 0.04)
        assert corners.steps == (left, 0)
    assert corners.blocked == (False, False)


def test_with_both_counters_running_both_halves_are_open():
    corners = Corners()
    corners.update((True, True), 0.16, 0.04)
    assert corners.blocked == (False, False)


def test_the_printed_counter_restarts_for_the_last_side_and_may_close_both():
    corners = Corners("printed")
    corners.update((True, False), 0.16, 0.04)
    corners.update((False, True), 0.16, 0.04)
    assert corners.steps == (0, 4)
    corners.update((True, True), 0.16, 0.04)
    assert corners.blocked == (True, True)


def test_the_published_counters_of_both_sides_close_both_halves():
    corners = Corners("published")
    corners.update((True, True), 0.16, 0.04)
    corners.update((False, False), 0.16, 0.04)
    assert corners.steps == (3, 3)
    assert corners.blocked == (True, True)


@given(metres, metres, angles)
def test_the_published_step_is_always_four_centimetres_and_turns_to_its_place(x, y, yaw):
    place, robot = np.array([x, y]), Pose2(0.1, 0.2, yaw)
    walk = command.published(place, robot, GAIT)
    assert walk.forward_m == pytest.approx(0.04)
    away = command.angle_to(place, robot)
    assert walk.turn_rad == pytest.approx(math.copysign(min(abs(away), math.radians(14.0)), away))


def test_without_visible_floor_the_counters_stay_at_zero():
    corners = Corners()
    corners.update((True, False), math.nan, 0.04)
    assert corners.blocked == (False, False)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_printed_form_always_turns_the_same_way(side):
    goal = np.array([0.5, side])
    turns = [command.turning(goal, Pose2(), GAIT, literal).turn_rad for literal in (False, True)]
    assert turns[0] == pytest.approx(side * math.radians(14.0))
    assert turns[1] == pytest.approx(math.radians(14.0))


@pytest.mark.parametrize("version", ["published", "printed"])
def test_the_published_versions_use_a_swarm_and_flow_without_guard_or_glances(version):
    walked = SwarmWalkerConfig(version=version).as_walked
    assert (walked.prediction, walked.guarded, walked.glances) == ("flow", False, False)
    assert walked.search.mode != "exact"
    assert walked.objective.literal == (version == "printed") == (walked.objective.penalty == 1.0)


@pytest.mark.parametrize("wrong", [{"version": "new"}, {"tilt_deg": 85.0}, {"tilt_deg": math.nan}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        SwarmWalkerConfig(**wrong)


def test_a_step_without_length_is_refused():
    with pytest.raises(InputError, match="step_m=0"):
        Corners().update((True, False), 0.16, 0.0)


def nothing(places):
    return np.zeros(len(places), dtype=bool)


def everything(places):
    return np.ones(len(places), dtype=bool)


HERE = np.zeros(2)


def test_a_contact_is_remembered_until_floor_is_seen_there():
    memory = GroundMemory()
    memory.update(0.0, HERE, np.array([[0.5, 0.1], [np.nan, np.nan], [5.0, 0.0]]), nothing)
    np.testing.assert_allclose(memory.places, [[0.5, 0.1]])
    memory.update(1.0, HERE, np.empty((0, 2)), nothing)
    assert len(memory.places) == 1
    memory.update(2.0, HERE, np.empty((0, 2)), everything)
    assert len(memory.places) == 0


def test_a_contact_point_is_forgotten_after_some_time():
    memory = GroundMemory()
    memory.update(0.0, HERE, np.array([[0.5, 0.1]]), nothing)
    memory.update(MEMORY_S + 1.0, HERE, np.empty((0, 2)), nothing)
    assert len(memory.places) == 0


def test_points_within_moving_obstacles_are_left_out():
    memory = GroundMemory()
    memory.update(0.0, HERE, np.array([[0.5, 0.0], [0.8, 0.4]]), nothing)
    left = memory.apart_from(np.array([[0.55, 0.0]]), np.array([0.1]))
    np.testing.assert_allclose(left, [[0.8, 0.4]])


def test_seen_floor_is_known_and_other_cells_are_not():
    memory = GroundMemory()
    memory.update(0.0, HERE, np.empty((0, 2)), lambda places: places[:, 0] > 0.0)
    unknown = memory.never_seen(0.0, HERE)
    assert len(unknown) > 50
    assert (unknown[:, 0] < 0.05).all()
    away = np.hypot(*unknown.T)
    assert away.min() > 0.22
    assert away.max() < 0.5
    assert len(memory.never_seen(1000.0, HERE)) > len(unknown)  # seen too long ago


def test_the_floor_memory_moves_with_the_robot():
    """Slots are reused after 3.2 m; old contents are not taken for the new cells."""
    memory = GroundMemory()
    memory.update(0.0, HERE, np.empty((0, 2)), everything)
    assert len(memory.never_seen(0.0, HERE)) == 0
    far = np.array([3.2, 0.0])
    assert len(memory.never_seen(0.0, far)) > 100


@pytest.mark.parametrize("radius_m", [0.10, 0.15, 0.30, 0.50])
def test_no_cell_under_the_body_of_a_robot_counts_as_never_seen(radius_m):
    """The guard takes such cells for obstacles; the ground at its feet a robot does not see."""
    memory = GroundMemory(RobotModel(radius_m=radius_m).breadth)
    memory.update(0.0, HERE, np.empty((0, 2)), lambda places: places[:, 0] > 0.0)
    away = np.hypot(*memory.never_seen(0.0, HERE).T)
    assert away.min() > 1.4 * radius_m
    assert away.max() > 3.0 * radius_m
