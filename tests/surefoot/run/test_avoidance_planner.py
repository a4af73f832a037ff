"""The walker of seed 004: where it looks, and what it does where a passage proves closed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.estimate import Estimate
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, Pose3, head_rotation
from perception.primitives.robot_model import DARWIN_OP, HeadLimits
from planning.avoidance.choice import Choice
from planning.avoidance.pivot import Pivot
from planning.avoidance.primitives import Leg, on_line, passage
from planning.commands import GazeCommand
from planning.planners.avoidance_planner import (
    INTO_RAD,
    AvoidancePlanner,
    _off_aim,
    directions,
)
from planning.planners.settings import PlanningConfig
from planning.world_model import WorldModel
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box
from sim.world import World
from surefoot.config.schema import Config
from surefoot.recordings.recording import RecordingInfo
from surefoot.run.pipeline import Pipeline

HALF_PAN_DEG, HALF_TILT_DEG = 22.0, 17.5  # field of view of the range camera
HEAD_M = 0.45  # height of the eyes


def _grid(robot: Pose2, occupied: list[tuple[float, float]]) -> EgocentricGrid:
    """All free but for some places."""
    empty = EgocentricGrid(GridConfig(), np.array([robot.x, robot.y]))
    content = empty.snapshot()
    content["log_odds"] = np.full_like(content["log_odds"], -3.0)
    centres = empty.centres()
    for place in occupied:
        gap = np.hypot(*np.moveaxis(centres - np.array(place), -1, 0))
        content["log_odds"][np.unravel_index(np.argmin(gap), gap.shape)] = 3.0
    return EgocentricGrid.restored(GridConfig(), content)


def _world(robot: Pose2) -> WorldModel:
    pose = Gaussian(np.array([robot.x, robot.y, robot.yaw]), 1e-6 * np.eye(3))
    return WorldModel(Estimate(10.0, pose))


def _sees(pan: float, tilt: float) -> bool:
    return any(
        abs(pan - math.degrees(p)) <= HALF_PAN_DEG and abs(tilt - math.degrees(t)) <= HALF_TILT_DEG
        for p, t in directions(DARWIN_OP.head)
    )


def test_nine_views_leave_no_stripe_of_the_ground_ahead_unseen():
    assert len(directions(DARWIN_OP.head)) == 9
    for pan in np.linspace(-60.0, 60.0, 61):
        for away in np.linspace(0.75, 2.5, 8):
            assert _sees(float(pan), math.degrees(math.atan2(HEAD_M, away)))


@pytest.mark.parametrize(
    ("head", "many"),
    [
        (HeadLimits(90.0, (20.0, 75.0)), 9),  # looks down only: nine pans at 20 deg
        (HeadLimits(30.0, (-10.0, 60.0)), 7),  # 60 and 45 deg become 30: three views and four
    ],
)
def test_a_head_that_stops_at_its_limits_reaches_every_view_of_the_scan(head, many):
    most, (highest, lowest) = math.radians(head.pan_deg), np.radians(head.tilt_deg)
    image, camera = np.full((36, 44), 2.0, np.float32), Camera(44, 36, 54.0, 54.0, 22.0, 18.0)
    planner = AvoidancePlanner(PlanningConfig(robot=replace(DARWIN_OP, head=head)), [(3.0, 0.0)])
    planner._scan(Pose2(), 0.0)
    for pan, tilt in planner._directions:
        stopped = np.clip(pan, -most, most), np.clip(tilt, highest, lowest)
        eye = Pose3.from_rotation(head_rotation(*map(float, stopped)), np.array([0.0, 0.0, 0.4]))
        assert planner._aimed(_off_aim(Depth(image, 0.01 * image, camera, eye), (pan, tilt)))
    assert len(planner._directions) == len(set(planner._directions)) == many


def test_views_of_who_is_turned_by_its_own_head_show_things_where_they_stand():
    """A thing in the world, seen by a body that has turned by eight degrees meanwhile."""
    thing, heading = np.array([1.4, 0.8, 0.2]), 0.3
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    planner._scan(Pose2(0.5, 0.1, heading + 0.05), heading)
    stood = Pose2(0.5, 0.1, heading).inverse().apply(thing[None, :2])[0]
    for k, (pan, tilt) in enumerate(directions(DARWIN_OP.head)):
        now = Pose2(0.5 + 0.001 * k, 0.1 - 0.002 * k, heading + math.radians(k - 3.0))
        T_body_camera = Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.03, 0.0, 0.4]))
        in_camera = (now.lifted() @ T_body_camera).inverse().apply(thing[None])
        found = planner._as_stood(now, T_body_camera).apply(in_camera)[0]
        np.testing.assert_allclose(found, [*stood, 0.2], atol=1e-12)


def test_a_head_counts_as_aimed_where_it_was_told_to_look_or_where_it_comes_to_rest():
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])

    def aimed(*offs_deg: float) -> list[bool]:
        planner._scan(Pose2(), 0.0)
        return [planner._aimed(math.radians(off)) for off in offs_deg]

    assert aimed(30.0, 1.0) == [False, True]
    # a trunk that leans by three degrees: the head turns, comes there, and stays there
    assert aimed(30.0, 12.0, 3.2, 3.0) == [False, False, False, True]
    # one that leans as much at the last frame of another direction has not come to rest in this one
    assert aimed(1.2, 1.3) == [True, True]
    assert aimed(4.0, 4.0, 4.0) == [False, True, False]
    # a head that is held fast far away is not aimed, however still it keeps
    assert aimed(20.0, 20.0, 20.0) == [False, False, False]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_out_of_a_closed_passage_the_robot_backs_before_it_looks_again(side):
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    legs = passage("SS", Pivot(0.0, 0.3 * side, 0.3, 0.0), Pose2(), 1.6)
    slip = legs[2]
    robot = Pose2(0.8, 0.3 * side, slip.target.yaw)
    planner._legs = legs[2:]
    grid = _grid(robot, [(0.95, 0.3 * side)])
    assert planner._closed(slip, robot, grid, 10.0)
    (back,) = planner._legs
    assert back.target.x == pytest.approx(0.35, abs=0.01)
    assert back.target.y == pytest.approx(0.3 * side)
    np.testing.assert_allclose(planner._closers[0], [[0.95, 0.3 * side]], atol=0.036)


def test_a_passage_stays_open_between_cells_that_stand_beside_it():
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    slip = passage("SS", Pivot(0.0, 0.3, 0.3, 0.0), Pose2(), 1.6)[2]
    robot = Pose2(0.8, 0.3, slip.target.yaw)
    beside = [(0.8 + 0.05 * k, y) for k in range(6) for y in (0.2, 0.4)]
    assert not planner._closed(slip, robot, _grid(robot, beside), 10.0)


def test_a_cell_in_the_corridor_to_the_goal_blocks_and_one_beside_or_behind_it_does_not():
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    goal = np.array([3.0, 0.0])

    def blocked(*places: tuple[float, float]) -> bool:
        return planner._blocked(Pose2(), 0.0, np.array(places), goal)

    assert blocked((0.9, 0.05), (0.9, 0.1))
    assert not blocked((0.9, 0.3), (0.9, 0.35))
    assert not blocked((-0.4, 0.0), (-0.4, 0.05))
    assert not blocked((1.4, 0.0), (1.4, 0.05))


def test_what_stands_behind_the_goal_blocks_nothing():
    planner = AvoidancePlanner(PlanningConfig(), [(0.5, 0.0)])
    cells = np.array([[0.7, 0.0], [0.7, 0.05]])
    assert not planner._blocked(Pose2(), 0.0, cells, np.array([0.5, 0.0]))


@pytest.mark.parametrize("motion", ["SS", "RF", "TS"])
def test_the_legs_are_walked_to_their_end_on_open_ground(motion):
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    found = Pivot(0.7 if motion[0] == "R" else 0.0, 0.3, 0.3, 0.0)
    legs = passage(motion, found, Pose2(), 1.2)
    planner._legs, robot = list(legs), Pose2()
    planner._phase = "pass"
    planner.choices = [_choice(motion, found)]
    for _ in range(300):
        decision = planner._pass(_world(robot), _grid(robot, []), np.array([3.0, 0.0]))
        if decision is None:
            break
        walk = decision.walk
        robot = robot @ Pose2(walk.forward_m, walk.lateral_m, walk.turn_rad)
    assert planner._phase == "walk"
    assert robot.x == pytest.approx(1.2, abs=0.05)
    assert robot.y == pytest.approx(0.3, abs=0.05)


def _choice(motion, found):
    return Choice(motion, 1, found, 0.5, 0.5, 0.3, 1.0, (0.0,) * 7, 1.0, "")


def test_a_track_on_what_was_scanned_is_no_mover_and_one_in_the_open_may_be():
    planner = AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])
    planner._faces = np.array([[[1.0, 0.6], [1.0, -0.6]]])
    assert planner._was_scanned(np.array([1.1, 0.5]))
    assert planner._was_scanned(np.array([1.2, -0.7]))
    assert not planner._was_scanned(np.array([0.3, 0.0]))
    assert not planner._was_scanned(np.array([1.0, 1.2]))
    assert not AvoidancePlanner(PlanningConfig(), [(3.0, 0.0)])._was_scanned(np.array([1.0, 0.0]))


@pytest.mark.parametrize("primitive", ["S", "F"])
@pytest.mark.parametrize("away_m", [0.5, 0.25])
@pytest.mark.parametrize("astray", [Pose2(0.0, 0.012, 0.004), Pose2(0.005, -0.012, -0.004)])
def test_who_errs_about_its_pose_still_goes_through_the_middle(primitive, away_m, astray):
    """From pixels: pictures of two boxes 0.24 m apart, a body that believes to stand a centimetre beside."""
    front, depth, extent = 0.5, 0.24, (-2.0, -2.0, 2.0, 2.0)
    true = Pose2(front - away_m, 0.0, math.pi / 2 if primitive == "S" else 0.0)
    believed = astray @ true
    boxes = tuple(
        StaticObject(name, (Box((front + depth / 2, y, height / 2), (depth, 0.3, height)),))
        for name, y, height in (("left", 0.27, 0.25), ("right", -0.27, 0.32))
    )
    floor = (FloorArea("planks/pine", extent),)
    scene = Scene("a gap", 0, extent, floor, boxes, (), (), true, ())
    planner = AvoidancePlanner(PlanningConfig(), [(2.0, 0.0)])
    leg = Leg(primitive, Pose2(1.2, 0.0, true.yaw), 0.24)
    with (
        World(scene, "tiny", 0) as world,
        SimulatedRobot(world, RobotConfig(stereo=False, colour=False), 0) as robot,
    ):
        pipeline = Pipeline(Config(), RecordingInfo(name="", kind="simulation", start=believed))
        robot.look(GazeCommand(-math.pi / 2 if primitive == "S" else 0.0, INTO_RAD))
        for _ in range(12):
            world_model = pipeline.cycle(robot.read())
            moved = planner._in_the_middle(leg, world_model)
    middle = (world_model.pose2 @ true.inverse()).apply(np.array([[front + depth / 2, 0.0]]))
    assert abs(on_line(leg, believed, middle)[0, 1]) > 0.008  # where the leg would have led
    assert abs(on_line(moved, believed, middle)[0, 1]) < 0.004
