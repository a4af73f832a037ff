"""A robot that is described by a URDF: its cameras see its own arms and legs where they truly are."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.depth.self_filter import silhouette
from perception.primitives.kinematics import link_poses
from planning.commands import GazeCommand, WalkCommand
from sim.body.head import HeadConfig
from sim.body.inertial import ImuConfig
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.contact import robot_solid
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.truth import Truth
from sim.world import World

LITTLE = Path(__file__).resolve().parents[1] / "little_robot" / "little.toml"
NOISY = RobotConfig(model=str(LITTLE), colour=False, tof_source="rays")
EXACT = replace(
    NOISY,
    slip=SlipConfig(0.0, 0.0, 0.0, 0.0, 0.0),
    sway=SwayConfig(0.0, 0.0, 0.0, 0.0),
    head=HeadConfig(encoder_deg=0.0, offset_deg=0.0),
    imu=ImuConfig(0.0, 0.0, 0.0, 0.0),
)


@pytest.fixture(scope="module")
def room():
    return catalogue.load("empty_room", 0)


def steps(robot, count):
    """The frames of some steps ahead and to the left, with a gaze that turns."""
    for k in range(count):
        while True:
            frame = robot.read()
            yield frame
            if frame.footstep_due:
                break
        robot.walk(WalkCommand(0.1, 0.01, 0.1, 0.5, 0.2))
        robot.look(GazeCommand(0.5 * math.sin(k), 0.9))


def test_true_links_measured_joints_and_camera_agree_without_errors(room):
    with World(room, "tiny") as world, SimulatedRobot(world, EXACT, 0) as robot:
        for frame in steps(robot, 4):
            joints = frame.joints
            poses = link_poses(robot.own_body.tree, np.array(joints.angles))
            here = robot.body.true_pose.lifted()
            for link, T_world_link in zip(robot._shown, world._link_poses, strict=True):
                measured = here.matrix @ joints.T_body_base.matrix @ poses[link]
                np.testing.assert_allclose(measured, T_world_link.matrix, atol=1e-6)
            mount = robot.config.tof_mount_m
            seen_from = (here @ frame.tof.T_body_camera).matrix
            np.testing.assert_allclose(robot.camera_in_world(mount).matrix, seen_from, atol=1e-9)


def test_soles_stay_on_the_floor_under_a_swaying_trunk(room):
    with World(room, "tiny") as world, SimulatedRobot(world, NOISY, 3) as robot:
        for _ in steps(robot, 3):
            lowest = {}
            for link, T in zip(robot._shown, world._link_poses, strict=True):
                parts = [p.corners for p in robot.own_body.parts if p.link == link]
                lowest[link] = min(T.apply(corners)[:, 2].min() for corners in parts)
            legs = robot._head.robot.legs
            for leg, (_, lift_m) in zip(legs, robot.body.feet_body, strict=True):
                assert lowest[leg[-1] + 1] == pytest.approx(lift_m, abs=1e-6)


def test_the_robot_hides_the_floor_behind_its_arms_and_the_filter_knows_where(room):
    """With the walk's own sway, offsets and resolution: every pixel of which any ray meets a link is masked."""
    shown = 0
    with World(room, "tiny") as world, SimulatedRobot(world, NOISY, 1) as robot:
        truth = Truth(robot)
        for frame in steps(robot, 5):
            own = truth.own_pixels("tof")
            view = frame.tof
            mask = silhouette(robot.own_body, frame.joints, view.camera, view.T_body_camera, 1.5)
            assert not (own & ~mask).any()
            nearer = np.nanmedian(view.range_m[own]) if own.any() else 0.0
            assert nearer < 0.75  # arms, not the floor 0.95 m below
            assert mask.mean() < 0.5
            shown += int(own.sum())
    assert shown > 1000


def test_the_renderer_and_the_rays_show_the_same_links(room):
    with World(room, "tiny") as world, SimulatedRobot(world, EXACT, 0) as robot:
        for _ in steps(robot, 2):
            pass
        camera, mount = robot._tof.camera, robot.config.tof_mount_m
        pose = robot.camera_in_world(mount)
        by_rays = world.ranges("rays").look(camera, pose)
        rendered = world.ranges("camera").look(camera, pose)
        own = world.rays.shows_links(camera, pose)
        assert own.mean() > 0.05
        same = np.abs(by_rays.distance_m - rendered.distance_m) < 0.01
        assert same[own].mean() > 0.95  # all but edges
        assert np.abs(by_rays.cosine - rendered.cosine)[own & same].max() < 0.02


def test_contact_is_judged_by_the_sizes_of_the_description(room):
    with World(room, "tiny") as world, SimulatedRobot(world, EXACT, 0) as robot:
        trunk, left, right = robot_solid(robot.body, robot.config.measures)
        model = robot.config.described.model
        assert trunk.size[:2] == (model.depth_m, model.width_m)
        assert trunk.top_m == pytest.approx(model.height_m)
        assert left.size[:2] == right.size[:2] == model.foot_m
        assert math.dist(left.centre[:2], right.centre[:2]) == pytest.approx(0.16)


def test_our_own_robot_carries_no_links_and_tells_no_joints(room):
    config = RobotConfig(colour=False, stereo=False, tof_source="rays")
    with World(room, "tiny") as world, SimulatedRobot(world, config, 0) as robot:
        assert robot.read().joints is None
        assert robot.own_body is None
        assert Truth(robot).own_pixels("tof") is None
