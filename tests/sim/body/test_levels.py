"""A body that steps between levels: where its feet, its frame and its camera are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.body import true_frame
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.ground import Ground
from sim.robot import RobotConfig, SimulatedRobot
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box
from sim.world import World

RISER, EDGE = 0.03, 0.10
CONFIG = replace(
    RobotConfig(colour=False, stereo=False, tof=False),
    slip=SlipConfig(0.0, 0.0, 0.0, 0.0, 0.0),
    sway=SwayConfig(0.0, 0.0, 0.0, 0.0),
)
UP = [(0.02, 0.0), (0.12, RISER), (0.12, RISER), (0.0, 0.0), (0.0, 0.0)]
"""Steps ahead and rises; treads of 17 cm from x = 0.10."""


def stairs() -> Scene:
    extent = (-1.0, -1.0, 2.0, 1.0)
    boxes = []
    for k in range(1, 4):
        start, end = EDGE + 0.17 * (k - 1), 1.5
        size = (end - start, 1.6, k * RISER)
        boxes.append(Box(((start + end) / 2, 0.0, size[2] / 2), size, 0.0, "plain/sage"))
    ground = StaticObject("steps", tuple(boxes), ground=True)
    floor = (FloorArea("plain/oak", extent),)
    return Scene("steps", 0, extent, floor, (ground,), (), (), Pose2(), ())


@pytest.fixture(scope="module")
def walked():
    """What holds at the end of every step of a walk up."""
    rows = []
    scene = stairs()
    with World(scene) as world, SimulatedRobot(world, CONFIG) as robot:
        rise, motion = 0.0, Pose2()
        for forward, up in [*UP, (0.0, 0.0)]:
            body = robot.body
            while True:
                frame = robot.read()
                rise += frame.odometry.rise_m
                motion = motion @ frame.odometry.motion
                if frame.footstep_due:
                    break
            feet = [body.true_pose @ place for place, _ in body.feet_body]
            rows.append(
                (
                    body.true_height_m, rise, [robot.ground.under(foot) for foot in feet],
                    (frame.feet.left_m, frame.feet.right_m), robot.ground.struck(body.true_swing[1]),
                    robot.camera_in_world(CONFIG.tof_mount_m).translation[2],
                    (true_frame(body) @ robot.measured_camera(CONFIG.tof_mount_m)).translation[2],
                    motion, body.true_pose,
                )
            )  # fmt: skip
            robot.walk(WalkCommand(forward, 0.0, 0.0, rise_m=up))
    return rows


@pytest.fixture
def ground():
    pieces = [
        Box((0.5, 0.0, 0.05), (1.0, 2.0, 0.1), 0.0, "x"),
        Box((0.75, 0.0, 0.1), (0.5, 2.0, 0.2), 0.0, "x"),
    ]
    return Ground(pieces, (0.2, 0.1))


def test_the_ground_is_the_highest_piece(ground):
    places = np.array([[-0.5, 0.0], [0.2, 0.0], [0.7, 0.0]])
    assert ground.height(places) == pytest.approx([0.0, 0.1, 0.2])


def test_a_sole_over_an_edge_is_carried_in_part_and_falls_with_its_middle(ground):
    assert ground.carried(Pose2(0.25, 0.0)) == (1.0, True)
    share, middle = ground.carried(Pose2(0.45, 0.0))  # three quarters below, a quarter on the step
    assert share == pytest.approx(0.25, abs=0.03)
    assert not middle
    share, middle = ground.carried(Pose2(0.55, 0.0))
    assert share == pytest.approx(0.75, abs=0.03)
    assert middle
    assert ground.under(Pose2(0.45, 0.0)) == pytest.approx(0.2)


def test_a_foot_that_swings_through_a_riser_strikes_it(ground):
    low = np.array([[0.25, 0.0, 0.0, 0.10], [0.45, 0.0, 0.0, 0.13], [0.70, 0.0, 0.0, 0.20]])
    assert ground.struck(low) == pytest.approx(0.07)
    assert ground.struck(low + np.array([0.0, 0.0, 0.0, 0.1])) == 0.0


def test_feet_stand_on_the_ground_and_the_body_is_midway(walked):
    for height, rise, under, heights, struck, _, _, motion, pose in walked:
        assert height == pytest.approx(np.mean(under), abs=1e-9)
        assert rise == pytest.approx(height, abs=1e-9)  # by the joints, without error
        assert heights == pytest.approx(np.array(under) - height, abs=1e-9)
        assert struck < 1e-6
        assert motion.vector == pytest.approx(pose.vector, abs=1e-9)
    assert max(row[0] for row in walked) == pytest.approx(2 * RISER)


def test_the_camera_rises_with_the_lower_foot(walked):
    start = walked[0][5]
    for row in walked:
        assert row[5] - start == pytest.approx(min(row[2]), abs=2e-3)
        assert row[6] == pytest.approx(row[5], abs=6e-3)  # joint offsets


def test_a_robot_that_stays_keeps_its_feet_on_two_levels():
    with World(stairs()) as world, SimulatedRobot(world, CONFIG) as robot:
        for forward, up in UP[:2]:
            while not robot.read().footstep_due:
                pass
            robot.walk(WalkCommand(forward, 0.0, 0.0, rise_m=up))
        while not robot.read().footstep_due:
            pass
        before = robot.body.feet_body
        for _ in range(2):
            robot.walk(WalkCommand(stay=True))
            while not robot.read().footstep_due:
                pass
        for (now, now_m), (then, then_m) in zip(robot.body.feet_body, before, strict=True):
            assert now.vector == pytest.approx(then.vector, abs=1e-9)
            assert now_m == pytest.approx(then_m, abs=1e-9)
        assert abs(before[0][1] - before[1][1]) == pytest.approx(RISER)
