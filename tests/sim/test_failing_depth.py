"""Loss of depth: a failing time-of-flight camera, and surfaces without texture."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from sim.rendering.textures import PALETTE, paint
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.world import World


def test_a_failed_camera_delivers_nothing_and_the_other_sensors_continue():
    config = RobotConfig(stereo=False, colour=False, tof_fails_at_s=2.0)
    with (
        World(catalogue.load("empty_room", 0), "tiny") as world,
        SimulatedRobot(world, config) as robot,
    ):
        frames = [robot.read() for _ in range(12)]
    assert frames[-1].stamp_s > 3.0
    assert [f.tof is not None for f in frames] == [f.stamp_s < 2.0 for f in frames]
    assert all(f.odometry is not None and f.imu is not None for f in frames)


def test_a_time_before_the_start_is_refused():
    with pytest.raises(ConfigError, match="tof_fails_at_s"):
        RobotConfig(tof_fails_at_s=-1.0)


def test_plain_material_is_one_colour():
    image = paint("plain/oak", (0.5, 0.3), 0.005, np.random.default_rng(0))
    assert (image == np.array(PALETTE["oak"], np.uint8)).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_box_blocks_the_straight_path_and_leaves_room_beside_it(seed):
    room = catalogue.load("plain_room", seed)
    first = room.obstacles[0].parts[0]
    (goal,) = room.goals
    assert room.start.x < first.centre[0] < goal[0]
    reach = np.hypot(0.14, 0.14)  # of the box at any yaw
    assert abs(first.centre[1] - room.start.y) < reach + 0.15
    assert first.centre[1] + reach + 0.3 < room.extent[3]
    assert first.centre[1] - reach - 0.3 > room.extent[1]
