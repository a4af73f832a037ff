"""The dynamic body on steps: it climbs them, and its joints tell where its feet and its camera are."""

from __future__ import annotations

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.gait import Gait, GaitConfig
from sim.robot import RobotConfig, SimulatedRobot
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box
from sim.world import World
from surefoot.experiments.joint import dynamic_stairs

RISER_M, EDGE_M, TREAD_M = 0.03, 0.12, 0.20
STEPS = [(0.02, 0.0), (0.15, RISER_M), (0.05, 0.0), (0.15, RISER_M), (0.05, 0.0), (0.0, 0.0)]
"""Steps ahead and rises, the left foot first."""


@pytest.fixture(scope="module")
def walked():
    """At the end of every step of a walk up two steps: heights of body, feet and camera, by the joints and in truth."""
    extent = (-1.0, -1.0, 2.0, 1.0)
    boxes = tuple(
        Box(
            ((EDGE_M + (k - 1) * TREAD_M + 1.5) / 2, 0.0, k * RISER_M / 2),
            (1.5 - EDGE_M - (k - 1) * TREAD_M, 1.6, k * RISER_M),
            0.0,
            "plain/sage",
        )
        for k in (1, 2)
    )
    floor, ground = (FloorArea("plain/oak", extent),), StaticObject("steps", boxes, ground=True)
    scene = Scene("steps", 0, extent, floor, (ground,), (), (), Pose2(), ())
    config = RobotConfig(body="dynamic", tof=False, stereo=False, colour=False)
    rows, risen = [], 0.0
    with World(scene) as world, SimulatedRobot(world, config) as robot:
        for forward, up in STEPS:
            robot.walk(WalkCommand(forward, rise_m=up))
            while True:
                frame = robot.read()
                risen += frame.odometry.rise_m
                if frame.footstep_due:
                    break
            body = robot.body
            assert not body.fallen
            (_, left), (_, right) = body.feet_body
            camera_m = robot.measured_camera((0.0, 0.0, 0.0)).position[2]
            true_m = robot.camera_in_world((0.0, 0.0, 0.0)).position[2]
            rows.append(
                (
                    body.true_height_m, risen, np.subtract((frame.feet.left_m, frame.feet.right_m), (left, right)),
                    body.true_height_m + camera_m - true_m,
                )
            )  # fmt: skip
    return rows


def test_it_stands_on_the_second_step_and_its_odometry_rose_as_high(walked):
    assert walked[-1][0] == pytest.approx(2 * RISER_M, abs=0.003)
    assert walked[-1][1] == pytest.approx(2 * RISER_M, abs=1e-9)
    assert max(abs(true - told) for true, told, _, _ in walked) < 0.006


def test_its_joints_tell_the_heights_of_feet_and_camera(walked):
    for _, _, feet, camera_m in walked:
        assert np.abs(feet).max() < 0.006
        assert abs(camera_m) < 0.006


@pytest.mark.parametrize("riser_m", [0.03, 0.05])
def test_it_goes_up_a_flight_and_down_another(riser_m):
    done = dynamic_stairs.climb(riser_m, 100)
    assert done.arrived
    assert done.feet_on_edges == 0


def test_a_step_from_or_to_another_level_takes_longer_and_lands_where_it_is_told():
    gait = Gait(GaitConfig())
    level = gait.step(WalkCommand(0.05))
    up = gait.step(WalkCommand(0.12, rise_m=0.03), extension_m=0.05)
    joins = gait.step(WalkCommand(0.05))
    after = gait.step(WalkCommand(0.05))
    assert up.ticks == 2 * level.ticks == joins.ticks
    assert after.ticks == level.ticks
    assert up.right[-1, 0] - level.left[-1, 0] == pytest.approx(0.12)


def test_shares_are_those_of_each_height():
    climbs = [dynamic_stairs.Climb(0.03, k > 0, k == 0, 20, 0) for k in range(4)]
    climbs.append(dynamic_stairs.Climb(0.08, False, True, 5, 1))
    figures = dynamic_stairs.summary(climbs)
    assert figures["dynamic_30mm_share"] == 0.75
    assert figures["dynamic_80mm_share"] == 0.0
    assert figures["dynamic_feet_on_edges"] == 1.0
