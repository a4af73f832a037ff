"""The robot as a whole: timing, noise, independence of the ground truth, reproducibility."""

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

from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import GazeCommand, WalkCommand
from sim.body.dynamic.config import DynamicConfig
from sim.body.head import HeadConfig
from sim.body.inertial import ImuConfig
from sim.body.kinematic import SlipConfig, SwayConfig
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scenes import catalogue
from sim.sensors.cameras import ImageConfig
from sim.truth import Truth
from sim.world import World

BLIND = RobotConfig(tof=False, stereo=False, colour=False)
EXACT = replace(
    BLIND,
    slip=SlipConfig(0.0, 0.0, 0.0, 0.0, 0.0),
    sway=SwayConfig(0.0, 0.0, 0.0, 0.0),
    head=HeadConfig(encoder_deg=0.0, offset_deg=0.0),
    imu=ImuConfig(0.0, 0.0, 0.0, 0.0),
)
SMALL = RobotConfig(
    image_pairs=True,
    colour_camera=ImageConfig(160, 160, 90.0, (0.035, 0.0, 0.035)),
    stereo_camera=ImageConfig(160, 120, 60.0, (0.035, 0.02, 0.035)),
)


@pytest.fixture(scope="module")
def room():
    return catalogue.load("empty_room", 0)


def drive(world, config, seed, commands):
    """Frames and true poses of a walk, one command per step."""
    robot = SimulatedRobot(world, config, seed)
    truth = Truth(robot)
    frames, poses = [], [truth.robot_pose()]
    for command in commands:
        while True:
            frame = robot.read()
            frames.append(frame)
            poses.append(truth.robot_pose())
            if frame.footstep_due:
                break
        robot.walk(command)
        robot.look(GazeCommand(0.3 * math.sin(len(frames)), 0.4))
    return frames, poses


def test_frames_come_twice_per_step_at_exact_times(room):
    with World(room, "tiny") as world:
        frames, _ = drive(world, BLIND, 0, [WalkCommand(0.04)] * 50)
    stamps = [f.stamp_s for f in frames]
    expected = [round(0.65 * (k // 2) + (0.45 if k % 2 == 0 else 0.65), 9) for k in range(100)]
    assert stamps == expected
    assert [f.footstep_due for f in frames] == [False, True] * 50


def test_without_noise_motion_and_odometry_equal_the_command(room):
    commands = [WalkCommand(0.04, 0.0, 0.05)] * 6 + [WalkCommand()] * 3
    with World(room, "tiny") as world:
        frames, poses = drive(world, EXACT, 0, commands)
    reported = room.start
    for frame, true in zip(frames, poses[1:], strict=True):
        reported = reported @ frame.odometry.motion
        np.testing.assert_allclose(reported.vector, true.vector, atol=1e-9)
    assert wrap_angle(poses[-1].yaw - room.start.yaw) == pytest.approx(0.30, abs=1e-9)


def test_a_standing_robot_does_not_move_and_reports_no_steps(room):
    with World(room, "tiny") as world:
        frames, poses = drive(world, BLIND, 0, [WalkCommand()] * 5)
    assert all(f.odometry.steps == 0.0 and f.odometry.motion == Pose2() for f in frames)
    assert all(p == room.start for p in poses)


def test_slip_has_the_configured_mean_and_standard_deviation(room):
    errors, biases = [], []
    with World(room, "tiny") as world:
        for seed in range(8):
            world.stamp_s = 0.0
            frames, poses = drive(world, BLIND, seed, [WalkCommand(0.04)] * 50)
            assert sum(f.odometry.steps for f in frames) == pytest.approx(49.0)
            run = []
            for k in range(2, len(frames) - 1, 2):  # whole steps, from footstep to footstep
                asked = frames[k].odometry.motion @ frames[k + 1].odometry.motion
                moved = poses[k].inverse() @ poses[k + 2]
                run.append((asked.inverse() @ moved).vector)
            biases.append(math.degrees(np.mean([e[2] for e in run])))
            errors += run
    x, y, yaw = np.array(errors).T
    count = math.sqrt(len(x))
    assert 1e3 * x.mean() == pytest.approx(-1.2, abs=4 * 1.5 / count)
    assert 1e3 * x.std() == pytest.approx(1.5, rel=0.15)
    assert 1e3 * y.std() == pytest.approx(0.6, rel=0.2)
    assert math.degrees(yaw.std()) == pytest.approx(0.6, rel=0.15)
    assert max(abs(b) for b in biases) < 0.2 + 4 * 0.6 / math.sqrt(49)
    assert np.std(biases) > 0.05  # constant within a run, different between runs


def test_the_gyro_measures_the_true_rotation_up_to_bias_and_noise(room):
    with World(room, "tiny") as world:
        frames, poses = drive(world, BLIND, 3, [WalkCommand(0.04, 0.0, 0.1)] * 80)
    stamps = np.array([0.0, *(f.stamp_s for f in frames)])
    turns = [wrap_angle(b.yaw - a.yaw) for a, b in itertools.pairwise(poses)]
    residual = [
        f.imu.angular_velocity[2] - turn / dt
        for f, turn, dt in zip(frames, turns, np.diff(stamps), strict=True)
    ]
    assert np.std(residual) == pytest.approx(0.002, rel=0.3)
    assert abs(np.mean(residual)) < 0.02


def test_the_body_lags_its_feet_by_half_a_step(room):
    """Between decisions the body makes half of the last step and half of the new one."""
    rng = np.random.default_rng(4)
    off, quick = [], []
    with World(room, "tiny") as world:
        robot = SimulatedRobot(world, EXACT, 0)
        truth, last, step = Truth(robot), WalkCommand(), WalkCommand()
        before = None
        while len(off) < 60:
            if not robot.read().footstep_due:
                continue
            here = truth.robot_pose()
            if before is not None:
                late = before
                for walk in (last, step):
                    half = Pose2(walk.forward_m / 2, walk.lateral_m / 2, walk.turn_rad / 2)
                    late = late @ half
                at_once = before @ Pose2(step.forward_m, step.lateral_m, step.turn_rad)
                for kept, told in ((off, late), (quick, at_once)):
                    kept.append(math.hypot(told.x - here.x, told.y - here.y))
            before, last = here, step
            step = WalkCommand(rng.choice([-0.019, 0.0, 0.045, 0.065]), 0.0, rng.uniform(-0.2, 0.2))
            robot.walk(step)
    assert np.median(off) < 0.004
    assert np.median(quick) > 2.0 * np.median(off)


def test_a_noiseless_accelerometer_measures_the_change_of_velocity(room):
    with World(room, "tiny") as world:
        robot = SimulatedRobot(world, EXACT, 0)
        for _ in range(3):
            robot.read()
        robot.walk(WalkCommand(0.05))
        velocity = np.zeros(2)
        stamp = world.stamp_s
        for _ in range(8):
            frame = robot.read()
            now = robot.body.velocity_body
            dt, stamp = frame.stamp_s - stamp, frame.stamp_s
            np.testing.assert_allclose(
                frame.imu.specific_force, [*((now - velocity) / dt), 9.81], atol=1e-9
            )
            velocity = now
            if frame.footstep_due:
                robot.walk(WalkCommand(0.05))


def test_measured_camera_pose_is_accurate_up_to_sway(room):
    config = replace(BLIND, tof=True, tof_camera=replace(BLIND.tof_camera, sub_rays=1))
    tilts, heights = [], []
    with World(room, "tiny") as world:
        robot = SimulatedRobot(world, config, 1)
        truth = Truth(robot)
        for k in range(160):
            frame = robot.read()
            if frame.footstep_due:
                robot.walk(WalkCommand(0.04, 0.0, 0.2 if k % 50 < 25 else -0.2))
            by_joints = truth.robot_pose().lifted() @ frame.tof.T_body_camera
            error = truth.camera_pose("tof").inverse() @ by_joints
            tilts.append(2 * np.array(error.quat_xyzw[:3]) * np.sign(error.quat_xyzw[3]))
            heights.append(error.position)
            level = truth.floor("tof")
            assert level.offset_m == pytest.approx(truth.camera_pose("tof").translation[2])
    spread = np.degrees(np.std(tilts[4:], axis=0))  # camera axes: pitch is x, yaw is y, roll is z
    np.testing.assert_allclose(spread, [0.5, 0.4, 0.72], rtol=0.3)
    assert np.linalg.norm(heights, axis=1).max() < 0.02


def test_the_head_respects_its_speed_and_range(room):
    with World(room, "tiny") as world:
        robot = SimulatedRobot(world, replace(EXACT, head=HeadConfig(speed_radps=1.0)), 0)
        robot.look(GazeCommand(3.0, 2.0))
        robot.read()
        assert (robot._head._pan, robot._head._tilt) == pytest.approx((0.45, 0.45))
        for _ in range(8):
            robot.read()
        assert robot._head._pan == pytest.approx(math.pi / 2)
        assert robot._head._tilt == pytest.approx(math.radians(60))


def test_disabled_cameras_deliver_nothing(room):
    with World(room, "tiny") as world:
        frame = SimulatedRobot(world, BLIND, 0).read()
    assert (frame.tof, frame.stereo, frame.colour, frame.T_world_camera) == (None,) * 4


def digest(frames) -> str:
    total = hashlib.sha256()
    for frame in frames:
        for part in (
            frame.tof.range_m,
            frame.tof.amplitude,
            frame.colour.rgb,
            frame.stereo.left,
            frame.stereo.right,
            frame.imu.angular_velocity,
            frame.imu.specific_force,
            frame.odometry.motion.vector,
            np.array(frame.tof.T_body_camera.quat_xyzw),
        ):
            total.update(np.ascontiguousarray(part).tobytes())
    return total.hexdigest()


WALK = [WalkCommand(0.04, 0.0, 0.1)] * 2


def run_digest() -> str:
    with World(catalogue.load("boxes", 2), "auto", 2) as world:
        return digest(drive(world, SMALL, 2, WALK)[0])


@pytest.fixture(scope="module")
def expected_digest():
    return run_digest()


def test_the_same_seed_gives_the_same_bits_again(expected_digest):
    assert run_digest() == expected_digest


def test_the_same_seed_gives_the_same_bits_in_another_process(expected_digest):
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); "
        "import test_robot; print(test_robot.run_digest())"
    )
    there = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONHASHSEED": "1"},
    )
    assert there.stdout.strip() == expected_digest


def test_sensors_do_not_use_the_truth(expected_digest, monkeypatch):
    for name in ("robot_pose", "camera_pose", "floor", "obstacles", "clearance_m", "occupied"):
        monkeypatch.setattr(Truth, name, lambda self, *args: Pose2(9.0, 9.0, 9.0))
    assert run_digest() == expected_digest


@pytest.mark.parametrize(
    ("dynamic", "factor"),
    [
        (DynamicConfig(), 1.0),
        (
            DynamicConfig(anatomy="tall"),
            0.600 / 0.455,
        ),  # height of seed 004's body over the DARwIn-OP's
        (DynamicConfig(scale=2.0), 2.0),
    ],
)
def test_both_bodies_have_the_dimensions_of_their_anatomy(room, dynamic, factor):
    found = []
    for body in ("kinematic", "dynamic"):
        still = replace(EXACT, tof=True, stereo=True, body=body, dynamic=dynamic)
        still = replace(
            still, dynamic=replace(dynamic, backlash_deg=0.0, offset_deg=0.0, bump_m=0.0)
        )
        with World(room, "tiny") as world, SimulatedRobot(world, still, 0) as robot:
            truth = Truth(robot)
            heights = [truth.camera_pose(name).translation[2] for name in ("tof", "stereo")]
            left, right = (foot for foot, _ in robot.body.feet_body)
            found.append([*heights, left.y - right.y, robot.config.baseline_m])
    nominal = factor * np.array([0.4055, 0.4055, 0.090, 0.040])  # DARwIn-OP, head level
    np.testing.assert_allclose(found[0], nominal, rtol=1e-9)
    np.testing.assert_allclose(found[1], nominal, rtol=0.01)


@pytest.mark.parametrize(("body", "within_m"), [("kinematic", 1e-12), ("dynamic", 0.02)])
def test_the_feet_by_the_encoders_are_where_the_true_feet_are(room, body, within_m):
    lifted = 0
    with World(room, "tiny") as world, SimulatedRobot(world, replace(EXACT, body=body), 0) as robot:
        for _ in range(6):
            robot.walk(WalkCommand(0.03))
            feet = robot.read().feet
            found = zip((feet.left, feet.right), feet.lifted, strict=True)
            for (foot, up), (true, height_m) in zip(found, robot.body.feet_body, strict=True):
                assert math.hypot(foot.x - true.x, foot.y - true.y) <= within_m
                assert abs(wrap_angle(foot.yaw - true.yaw)) <= 0.01 + within_m
                lifted += up
                assert up or height_m < 0.01
    assert lifted >= 2
