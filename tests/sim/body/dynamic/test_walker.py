"""The dynamic body: it walks without falling, its odometry is consistent, and its runs are reproducible."""

import hashlib
import itertools
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import GazeCommand, WalkCommand
from sim.body.dynamic.anatomy import DARWIN, links
from sim.body.dynamic.balance import BalanceConfig
from sim.body.dynamic.config import DynamicConfig
from sim.body.dynamic.walker import NECK, DynamicBody
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box, Solid
from sim.truth import Truth
from sim.world import World

BLIND = RobotConfig(body="dynamic", tof=False, stereo=False, colour=False)
SEES = replace(BLIND, tof=True, tof_camera=replace(BLIND.tof_camera, sub_rays=1))
TURNING = WalkCommand(0.04, 0.0, 0.08)
EXTENT = (-1.5, -1.5, 1.5, 1.5)


def room(*static_objects):
    floor = (FloorArea("plaster/white", EXTENT),)
    return Scene("floor", 0, EXTENT, floor, static_objects, (), (), Pose2(0.1, -0.2, 0.5), ())


def walked(steps, seed=0, config=BLIND, scene=None, command=TURNING):
    """Frames, true poses at the end of each step, whether it fell, and its clearance."""
    with (
        World(scene or room(), "tiny", seed) as world,
        SimulatedRobot(world, config, seed) as robot,
    ):
        frames, poses = [], []
        while len(poses) < steps:
            frames.append(robot.read())
            if frames[-1].footstep_due:
                poses.append(Truth(robot).robot_pose())
                robot.walk(command)
                robot.look(GazeCommand(0.3, 0.5))
        return frames, poses, robot.fallen, Truth(robot).clearance_m()


def test_the_body_walks_over_bumps_with_backlash():
    frames, poses, fallen, _ = walked(16)
    assert not fallen
    moved = [a.inverse() @ b for a, b in itertools.pairwise(poses[3:])]
    assert np.mean([m.x for m in moved]) == pytest.approx(0.04, abs=0.004)
    assert math.degrees(np.mean([m.yaw for m in moved])) == pytest.approx(4.6, abs=0.8)
    force = np.mean([f.imu.specific_force for f in frames[8:]], axis=0)
    np.testing.assert_allclose(force, [0.0, 0.0, 9.81], atol=0.25)


def test_odometry_is_accurate_up_to_slip_and_backlash():
    frames, poses, _, _ = walked(14, seed=1)
    told = Pose2()
    for frame in frames[2:]:
        told = told @ frame.odometry.motion
    true = poses[0].inverse() @ poses[-1]
    assert (told.x, told.y) == pytest.approx((true.x, true.y), abs=13 * 0.002)  # slip of 13 steps
    assert told != true  # odometry is not the truth
    assert math.degrees(wrap_angle(told.yaw - true.yaw)) == pytest.approx(0.0, abs=13 * 0.4)
    turned = sum(
        f.imu.angular_velocity[2] * (f.stamp_s - before.stamp_s)
        for before, f in itertools.pairwise(frames[1:])
    )
    seconds = frames[-1].stamp_s - frames[1].stamp_s
    assert wrap_angle(turned - true.yaw) == pytest.approx(0.0, abs=0.02 * seconds)
    assert sum(f.odometry.steps for f in frames) == pytest.approx(13.0)


ODOMETRY_WITHIN = np.array([0.001, 0.001, math.radians(0.2)])


def tight_walk(seed, balance):
    """Greatest errors of odometry without backlash and joint offsets, and of the plan, against the true feet."""
    exact = DynamicConfig(backlash_deg=0.0, offset_deg=0.0, balance=balance)
    tight = replace(BLIND, dynamic=exact)
    odometry_error, plan_error = np.zeros(3), np.zeros(3)
    with World(room(), "tiny", seed) as world, SimulatedRobot(world, tight, seed) as robot:
        body = robot.body

        def soles():
            return [below(body.physics.link(f"{side}_ankle_roll")) for side in ("left", "right")]

        start = told = body.true_pose
        planned, standing = body.planned_pose.inverse(), body._odometry.standing
        foot = soles()[standing < 0]
        for _ in range(130 * 8):
            body.walk(TURNING)
            told = told @ body.advance(1).motion
            now, before = body._odometry.standing, soles()[standing < 0]
            if now != standing:  # motion by the true feet, without slip of the stance foot
                foot, standing = foot @ before.inverse() @ soles()[now < 0], now
            true = foot @ soles()[standing < 0].inverse() @ body.true_pose
            asked = start @ planned @ body.planned_pose
            odometry_error = np.maximum(odometry_error, np.abs((true.inverse() @ told).vector))
            plan_error = np.maximum(plan_error, np.abs((true.inverse() @ asked).vector))
    return odometry_error, plan_error


@pytest.mark.parametrize("balance", [BalanceConfig(inward_m=0.0), BalanceConfig()])
def test_odometry_without_backlash_follows_the_true_feet_not_the_command(balance):
    """Contacts are chaotic: single walks have lateral errors of up to 1.4 mm, so four walks are judged together."""
    walks = [tight_walk(seed, balance) for seed in range(4)]
    told, asked = np.sqrt(np.mean(np.square(walks), axis=0))
    assert np.all(told < ODOMETRY_WITHIN)
    assert np.any(asked > 1.5 * ODOMETRY_WITHIN)


def test_pressure_lies_inside_the_stance_foot():
    where = []
    with World(room(), "tiny", 0) as world, SimulatedRobot(world, BLIND, 0) as robot:
        body, physics = robot.body, robot.body.physics
        for _ in range(130 * 8):
            body.walk(TURNING)
            body.advance(1)
            aloft = body._tick - body._step.double_support_ticks
            if not body.stepping or not 10 <= aloft <= 40:  # clearly in the air
                continue
            touched = physics._bullet.getContactPoints(
                bodyA=physics.robot, physicsClientId=physics.client
            )
            load = np.array([point[9] for point in touched])
            place = load @ np.array([point[5] for point in touched]) / load.sum()
            ankle = physics.link(f"{'left' if body.swinging < 0 else 'right'}_ankle_roll")
            where.append(ankle.inverse().apply(place[None])[0] * (1, -body.swinging, 1))
    x, y, _ = np.array(where).T
    length, width, _ = DARWIN.foot_m
    assert len(where) > 200
    assert np.all(np.abs(x) <= length / 2 + 1e-3)
    assert np.all(np.abs(y - DARWIN.foot_outward_m) <= width / 2 + 1e-3)
    assert np.mean(np.abs(x) < 0.8 * length / 2) > 0.8  # pressure away from the edges
    assert np.mean(np.abs(y - DARWIN.foot_outward_m) < 0.8 * width / 2) > 0.8


def test_measured_camera_pose_is_accurate_up_to_backlash():
    with World(room(), "tiny", 2) as world, SimulatedRobot(world, SEES, 2) as robot:
        truth, angles, places = Truth(robot), [], []
        for _ in range(16):
            frame = robot.read()
            by_joints = truth.robot_pose().lifted() @ frame.tof.T_body_camera
            error = truth.camera_pose("tof").inverse() @ by_joints
            angles.append(2 * np.linalg.norm(error.quat_xyzw[:3]))
            places.append(np.linalg.norm(error.position))
            if frame.footstep_due:
                robot.walk(WalkCommand(0.04))
        assert math.degrees(max(angles)) < 2.5
        assert max(places) < 0.015


def digest(frames):
    total = hashlib.sha256()
    for f in frames:
        for part in (f.odometry.motion.vector, f.imu.angular_velocity, f.imu.specific_force):
            total.update(np.ascontiguousarray(part).tobytes())
        total.update(np.float64(f.stamp_s).tobytes())
    return total.hexdigest()


def test_the_same_seed_gives_the_same_bits_again():
    first, second, other = (digest(walked(4, seed)[0]) for seed in (3, 3, 4))
    assert first == second
    assert first != other


SHORT_WALK = """
import hashlib, numpy, sys
sys.path.insert(0, sys.argv[1])
from test_walker import digest, walked
print(digest(walked(4)[0]))
"""


def test_another_processor_gives_the_same_bits():
    """BLAS libraries and NumPy choose code by processor; contacts would amplify another last bit."""
    settings = (
        {"OPENBLAS_CORETYPE": "Haswell"},
        {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"},
    )
    words = [sys.executable, "-W", "ignore", "-c", SHORT_WALK, str(Path(__file__).parent)]
    root = str(Path(__file__).parents[4])
    digests = {
        subprocess.run(
            words,
            env={**os.environ, "PYTHONPATH": root, **one},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for one in settings
    }
    assert len(digests) == 1


def below(pose):
    """Projection of a pose on the floor."""
    return Pose2(*pose.position[:2], math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]))


def deepest(scene, item, steps):
    """Greatest penetration of a link's corner into an upright box during a walk, m; negative without contact."""
    found = -math.inf
    middle, size = np.array(item.centre), np.array(item.size)
    c, s = math.cos(item.yaw_rad), math.sin(item.yaw_rad)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    with World(scene, "tiny", 0) as world, SimulatedRobot(world, BLIND, 0) as robot:
        for _ in range(steps * 13):
            robot.walk(WalkCommand(0.05))
            robot.body.advance(10)
            for link in links(DARWIN)[1:]:
                if link.solid:
                    box = np.array(link.middle) + signs * link.size
                    inside = (robot.body.physics.link(link.name).apply(box) - middle) @ axes
                    found = max(found, float(np.min(size / 2 - np.abs(inside), axis=1).max()))
    return found


def test_objects_are_solid():
    ahead = Pose2(0.1, -0.2, 0.5) @ Pose2(0.25, 0.0, 0.0)
    crate = Box((ahead.x, ahead.y, 0.3), (0.2, 0.8, 0.6), 0.5)
    assert (
        -0.003 < deepest(room(StaticObject("crate", (crate,))), crate, 11) < 0.005
    )  # contact without penetration


def test_a_fall_after_a_hard_push_is_reported():
    with World(room(), "tiny", 0) as world, SimulatedRobot(world, BLIND, 0) as robot:
        robot.read()
        assert isinstance(robot.body, DynamicBody)
        robot.body.push(np.array([0.0, 60.0, 0.0]), 0.2)
        for _ in range(6):
            robot.read()
        assert robot.fallen


@pytest.mark.parametrize("seed", [0, 4, 13])
def test_a_standing_body_that_turns_its_head_does_not_creep(seed):
    """Soles on their edges shake; friction must hold nevertheless (without anchors the body turns by 5 degrees)."""
    poses = []
    with World(room(), "tiny", seed) as world, SimulatedRobot(world, BLIND, seed) as robot:
        for number in range(30):
            robot.body.walk(WalkCommand(0.04) if number < 5 else WalkCommand())
            robot.look(GazeCommand(1.0 if number % 2 else -1.0, 0.4))
            robot.body.start_due_step()
            robot.body.advance(robot.body.ticks_left)
            poses.append(Truth(robot).robot_pose())
    crept = poses[8].inverse() @ poses[-1]  # over 14 seconds, after settling
    assert abs(math.degrees(crept.yaw)) < 1.0
    assert math.hypot(crept.x, crept.y) < 0.001


def test_the_tall_body_of_seed_004_stands_and_steps():
    config = replace(BLIND, dynamic=DynamicConfig(anatomy="tall"))
    _, poses, fallen, _ = walked(6, config=config, command=WalkCommand(0.04))
    assert not fallen
    assert (poses[0].inverse() @ poses[-1]).x > 0.12


def test_head_encoders_follow_a_fast_head():
    steady = replace(BLIND, dynamic=DynamicConfig(offset_deg=0.0))
    steady = replace(steady, head=replace(steady.head, offset_deg=0.0))
    play, grain = steady.dynamic.backlash_deg, steady.head.encoder_deg
    off, late = [], []
    with World(room(), "tiny", 0) as world, SimulatedRobot(world, steady, 0) as robot:
        for pan in (0.9, -0.9):
            robot.look(GazeCommand(pan, 0.5))
            for _ in range(60):
                robot.body.advance(1)
                true = robot.body.physics.angles(NECK)
                ahead, up = robot._head.camera_from_encoders((0.0, 0.0, 0.0)).rotation[:, [2, 1]].T
                told = (math.atan2(ahead[1], ahead[0]), math.acos(-up[2]))
                off.append(np.degrees(np.abs(told - true)))
                late.append(np.degrees(np.abs(robot._head.setpoints - true)))
    assert np.max(off) <= play / 2 + grain
    assert np.max(late) > 2.0 * np.max(off)  # the joint lags its setpoint


def test_leg_encoders_give_whole_counts():
    with World(room(), "tiny", 0) as world, SimulatedRobot(world, BLIND, 0) as robot:
        robot.walk(WalkCommand(0.04))
        for _ in range(3):
            robot.read()
        counts = robot.body._encoders / (2.0 * math.pi / 4096)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)


def test_sole_sensors_measure_the_floor_and_not_objects():
    sill = StaticObject("sill", (Box((0.11, 0.0, 0.03), (0.04, 0.8, 0.06), 0.0),))
    scene = replace(room(sill), start=Pose2())
    smooth = replace(BLIND, dynamic=DynamicConfig(bump_m=0.0))
    met = 0
    with World(scene, "tiny", 0) as world, SimulatedRobot(world, smooth, 0) as robot:
        physics = robot.body.physics
        weight = [
            sum(physics.sole_force(f"{side}_ankle_roll") for side in ("left", "right"))
            for _ in range(100)
            if robot.body.advance(1)
        ]
        assert np.mean(weight) == pytest.approx(2.92 * 9.81, rel=0.02)
        for _ in range(500):
            robot.walk(WalkCommand(0.05))
            robot.body.advance(1)
            for (_, height), side in zip(robot.body.feet_body, ("left", "right"), strict=True):
                name = f"{side}_ankle_roll"
                if height < 0.006 or robot.fallen:
                    continue
                aloft = physics._bullet.getContactPoints(
                    bodyA=physics.robot,
                    linkIndexA=physics.index[name],
                    physicsClientId=physics.client,
                )
                met += any(point[9] > 0.0 for point in aloft)
                assert physics.sole_force(name) == 0.0
    assert met > 0


def test_up_is_against_gravity_on_a_slope():
    flat, steep = (
        DynamicConfig(),
        DynamicConfig(slope_rad=(0.05, -0.03), bump_m=0.0, backlash_deg=0.0),
    )
    assert flat.up == (0.0, 0.0, 1.0)
    assert steep.up[:2] == pytest.approx((math.sin(0.05), -math.sin(0.03)))  # rise per metre
    with (
        World(room(), "tiny", 0) as world,
        SimulatedRobot(world, replace(BLIND, dynamic=steep), 0) as robot,
    ):
        felt = []
        for _ in range(200):
            robot.body.advance(1)
            _, force = robot.body.physics.imu_reading()
            felt.append(robot.body.physics.pelvis().rotation @ force)
        np.testing.assert_allclose(np.mean(felt, axis=0) / 9.81, robot.up, atol=2e-3)
    with World(room(), "tiny", 0) as world:
        assert SimulatedRobot(world, replace(BLIND, body="kinematic"), 0).up == (0.0, 0.0, 1.0)


def test_an_unknown_body_is_refused():
    with pytest.raises(ConfigError, match="body='ghost' is unknown; choose kinematic, dynamic"):
        RobotConfig(body="ghost")


def test_solids_of_any_shape_stop_the_robot():
    corners = np.array([[x, y, z] for x in (0.12, 0.3) for y in (-0.4, 0.4) for z in (0.0, 0.5)])
    block = StaticObject("block", (Solid(corners, np.array([[0, 1, 2]])),))
    scene = replace(room(block), start=Pose2())
    assert -0.003 < deepest(scene, Box((0.21, 0.0, 0.25), (0.18, 0.8, 0.5)), 5) < 0.005
