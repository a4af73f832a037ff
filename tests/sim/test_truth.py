"""Ground truth: clearance, occupancy and obstacles against geometry by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import InputError
from perception.primitives.pose import Pose2
from sim.body.dynamic.config import DynamicConfig
from sim.movers.law import MoversConfig
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.truth import Truth
from sim.world import World

BLIND = RobotConfig(tof=True, stereo=False, colour=False)


@pytest.fixture
def truth():
    with World(catalogue.load("corridor", 0), "tiny") as world:
        yield Truth(SimulatedRobot(world, BLIND, 0))


def stand(truth, x, y, yaw):
    truth._robot.body.true_pose = Pose2(x, y, yaw)


def test_clearance_is_the_distance_to_the_nearest_object(truth):
    stand(truth, 0.6, 0.8, 0.0)
    # a tag on a side wall, 6 mm thick, is nearer than the first carton
    gap, item = truth.clearance_m()
    assert gap == pytest.approx(0.6 - 0.055 - 0.006, abs=1e-9)
    assert item.startswith("tag")
    stand(truth, 0.10, 0.8, 0.0)
    gap, _ = truth.clearance_m()
    assert gap == pytest.approx(0.10 - 0.055, abs=7e-3)  # a tag plate is 6 mm thick


def test_touching_a_moving_object_is_contact(truth):
    x, y, _, _ = truth._world.moving_states()[0]
    stand(truth, x - 0.15, y, 0.0)  # 5.2 cm of foot and trunk, 10 cm of the moving object
    gap, item = truth.clearance_m()
    assert item == "robot 1"
    assert gap == pytest.approx(0.15 - 0.055 - 0.10, abs=1e-9)
    stand(truth, x - 0.3, y, math.pi / 2)
    assert truth.clearance_m()[0] == pytest.approx(0.3 - 0.083 - 0.10, abs=1e-3)


def test_a_larger_body_has_less_clearance():
    """Seed 004's robot: 0.30 m wide, 0.20 m deep."""
    tall = replace(BLIND, dynamic=DynamicConfig(anatomy="tall"))
    with World(catalogue.load("corridor", 0), "tiny") as world:
        truth = Truth(SimulatedRobot(world, tall, 0))
        x, y, _, _ = world.moving_states()[0]
        stand(truth, x - 0.3, y, 0.0)
        assert truth.clearance_m()[0] == pytest.approx(0.3 - 0.10 - 0.10, abs=1e-9)
        stand(truth, x - 0.3, y, math.pi / 2)
        assert truth.clearance_m()[0] == pytest.approx(0.3 - 0.15 - 0.10, abs=1e-9)


def test_occupied_covers_objects_and_the_outside_of_walls(truth):
    carton = truth._scene.obstacles[0].parts[0]
    x, y, _, _ = truth._world.moving_states()[0]
    points = np.array([[0.6, 0.8], carton.centre[:2], [x, y], [-0.05, 0.8], [4.0, 1.65]])
    assert truth.occupied(points).tolist() == [False, True, True, True, True]


def test_listed_obstacles_cover_their_objects_and_moving_ones_move(truth):
    listed = truth.obstacles()
    assert [one[0] for one in listed] == [1, 101, 102, 103, 104]
    assert truth.names()[1] == truth._scene.obstacles[0].name
    assert len(truth.names()) == len(listed)
    _, x, y, vx, vy, _, _ = listed[0]
    truth._world.advance(0.5)
    _, x2, y2, *_ = truth.obstacles()[0]
    assert (x2, y2) == pytest.approx((x + 0.5 * vx, y + 0.5 * vy), abs=1e-9)
    carton = truth._scene.obstacles[0].parts[0]
    assert listed[1][5] == pytest.approx(math.hypot(carton.size[0], carton.size[1]) / 2)


def test_an_absent_camera_is_named(truth):
    assert truth.cameras() == ("tof",)
    with pytest.raises(InputError, match=r"'stereo' is not on this robot; it has tof"):
        truth.camera_pose("stereo")


def test_only_the_near_sides_of_a_carton_are_in_view(truth):
    """Of the points half way up its four sides, those towards the camera."""
    identity, _, height, parts = truth.outlines()[0]
    assert identity == 101
    ring = parts[0]
    middles = (ring + np.roll(ring, -1, axis=0)) / 2
    centre = ring.mean(axis=0)
    stand(truth, float(centre[0]) - 1.0, float(centre[1]), 0.0)
    points = np.column_stack([middles, np.full(len(middles), height / 2)])
    seen = truth.in_view(points, 3.0)
    away = truth.camera_pose("tof").position[:2] - middles
    outward = middles - centre
    facing = (away * outward).sum(axis=1) > 0.0
    assert seen.any()
    assert not seen[~facing].any()
    assert not truth.in_view(points, 0.3).any()  # out of reach


def test_touching_a_leg_is_contact_with_the_person_though_the_trunk_is_farther_out():
    scene = catalogue.load("hall", 0, movers=MoversConfig(legs=True))
    with World(scene, "tiny") as world:
        truth, person = Truth(SimulatedRobot(world, BLIND, 0)), scene.moving_objects[0]
        x, y, _, _ = world.body_states()[1]
        touching = x - 0.055 - person.legs.radius  # half the depth of the robot's trunk
        stand(truth, touching - 0.01, y, 0.0)
        gap, item = truth.clearance_m()
        assert (gap, item) == (pytest.approx(0.01, abs=1e-9), "person 1")
        stand(truth, touching + 0.01, y, 0.0)
        assert truth.clearance_m() == (pytest.approx(-0.01, abs=1e-9), "person 1")
