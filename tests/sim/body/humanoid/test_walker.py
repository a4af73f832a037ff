"""The dynamic body of described robots: it walks, its odometry is as good as it claims, its runs are reproducible."""

import hashlib
import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import ConfigError, InputError
from perception.primitives.kinematics import link_poses
from perception.primitives.pose import Pose2
from planning.commands import GazeCommand, WalkCommand
from sim.body.dynamic.config import DynamicConfig
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.robots import catalogue
from sim.scene import FloorArea, Scene
from sim.scenes import catalogue as scenes
from sim.truth import Truth
from sim.world import World
from surefoot.config.presets import needs

EXTENT = (-2.0, -2.0, 4.0, 2.0)
ROOM = Scene("floor", 0, EXTENT, (FloorArea("plaster/white", EXTENT),), (), (), (), Pose2(), ())


@pytest.fixture(scope="module")
def blind(described):
    """A maker's robot with a dynamic body, without cameras."""
    return RobotConfig(
        model=described.file.stem, body="dynamic", tof=False, stereo=False, colour=False
    )


def commands(config, ahead_m, turn_deg):
    """Steps ahead, then on the spot."""
    gait = config.described.model.gait
    times = {
        "single_support_s": gait.single_support_s,
        "double_support_s": gait.double_support_s,
    }
    length = gait.cruise_mps * gait.step_s
    ahead = [WalkCommand(length, **times)] * round(ahead_m / length)
    turn = math.radians(gait.max_turn_deg)
    return [*ahead, *[WalkCommand(0.0, 0.0, turn, **times)] * round(turn_deg / gait.max_turn_deg)]


def walked(config, orders, seed=0):
    """Per step the true pose at its end, what odometry tells of it, and the steps' frames; whether the robot fell."""
    with World(ROOM, "tiny", seed) as world, SimulatedRobot(world, config, seed) as robot:
        poses, told, frames, moved = [], [], [], Pose2()
        for order in [*orders, WalkCommand(), WalkCommand()]:
            while True:
                frames.append(robot.read())
                moved = moved @ frames[-1].odometry.motion
                if frames[-1].footstep_due or robot.fallen:
                    break
            poses.append(Truth(robot).robot_pose())
            told.append(moved)
            moved = Pose2()
            robot.walk(order)
            robot.look(GazeCommand(0.2, 0.6))
        return poses, told, frames, robot.fallen


@pytest.fixture(scope="module")
def walk(blind):
    """One walk of 1.5 m and a turn of 42 deg."""
    return walked(blind, commands(blind, 1.5, 42.0))


def test_the_robot_walks_ahead_and_turns_without_falling(walk):
    poses, _, _, fallen = walk
    assert not fallen
    assert math.hypot(poses[-1].x, poses[-1].y) > 1.2
    assert math.degrees(poses[-1].yaw) == pytest.approx(42.0, abs=12.0)


def test_the_odometry_errs_as_its_noise_claims(blind, walk):
    """The errors of all steps together, chi-square over three axes: mean slips, drift and noise of a step."""
    poses, told, _, _ = walk
    claimed = dict(blind.described.dynamic.odometry)
    errors = np.array(
        [
            (step.inverse() @ a.inverse() @ b).vector
            for step, (a, b) in zip(told[1:], itertools.pairwise(poses), strict=True)
        ]
    )[1:-2]
    n = len(errors)
    total = errors.sum(axis=0) - n * np.array([claimed["slip_m"], claimed["lateral_slip_m"], 0.0])
    sigma = np.array(
        [
            math.hypot(n * claimed[mean], math.sqrt(n) * claimed[step])
            for mean, step in (
                ("slip_sigma_m", "step_x_sigma_m"),
                ("lateral_slip_sigma_m", "step_y_sigma_m"),
                ("drift_sigma_rad", "step_yaw_sigma_rad"),
            )
        ]
    )
    assert float(np.sum((total / sigma) ** 2)) < 16.3  # 99.9 % of chi-square of 3


def test_the_encoders_tell_how_many_steps_were_made(walk):
    _, _, frames, _ = walk
    made = sum(frame.odometry.steps for frame in frames)
    assert made == pytest.approx(round(made), abs=1e-6)


def test_a_step_out_of_standing_leaves_no_gap_between_frames(walk):
    """The clock of a run takes an interval 1.3 times as long as the usual ones for missing frames."""
    _, _, frames, _ = walk
    intervals = np.diff([frame.stamp_s for frame in frames])
    assert intervals.max() < 1.3 * 0.65


def test_the_feet_in_the_frame_are_where_they_truly_are(blind):
    """Within the joint offsets: six joints of .3 deg below a leg of a metre."""
    with World(ROOM, "tiny") as world, SimulatedRobot(world, blind, 5) as robot:
        for order in commands(blind, 0.3, 0.0):
            frame = robot.read()
            (left, left_m), (right, right_m) = robot.body.feet_body
            for told, told_m, true, true_m in (
                (frame.feet.left, frame.feet.left_m, left, left_m),
                (frame.feet.right, frame.feet.right_m, right, right_m),
            ):
                assert math.hypot(told.x - true.x, told.y - true.y) < 0.025
                assert told_m == pytest.approx(true_m, abs=0.025)
            robot.walk(order)


def test_true_links_are_those_of_the_engine_and_the_encoders_err_by_their_offsets(blind):
    with World(ROOM, "tiny") as world, SimulatedRobot(world, blind, 2) as robot:
        robot.look(GazeCommand(0.4, 0.7))
        for _ in range(6):
            frame = robot.read()
            if frame.footstep_due:
                robot.walk(commands(blind, 1.0, 0.0)[0])
        body = robot.body
        names = body.tree.names
        poses = robot._legs.true_links()
        for link, name in enumerate(names, 1):
            np.testing.assert_allclose(
                poses[link].translation, body.physics.link(name).translation, atol=1e-4
            )
        off = np.array(frame.joints.angles) - body.physics.angles(names) + robot._head.offsets
        count = math.radians(robot.config.head.encoder_deg)
        assert np.abs(off).max() <= count / 2 + 1e-9
        tree = robot._head.robot.tree
        chosen = list(robot._head.robot.gaze)
        moved = robot._head.true_angles[chosen]
        np.testing.assert_allclose(moved, body.physics.angles(names)[chosen], atol=1e-9)
        assert len(link_poses(tree, np.array(frame.joints.angles))) == len(poses)


def test_same_seed_same_bits(blind):
    def digest():
        poses, told, frames, _ = walked(blind, commands(blind, 0.12, 0.0), seed=7)
        parts = [p.vector for p in (*poses, *told)] + [f.imu.angular_velocity for f in frames]
        return hashlib.sha256(np.concatenate(parts).tobytes()).hexdigest()

    assert digest() == digest()


def test_the_localiser_is_told_the_noise_of_this_body(blind):
    wanted = needs(blind)["localiser"]
    for name, value in blind.described.dynamic.odometry:
        assert wanted.get(name, value) == value
    assert "step_x_sigma_m" in wanted


def test_impossible_bodies_are_refused(blind, tmp_path):
    with pytest.raises(ConfigError, match=r"dynamic.engine='mujoco' is for our own robot"):
        replace(blind, dynamic=DynamicConfig(engine="mujoco"))
    storeys = scenes.load("storeys", 0)
    with World(storeys, "tiny") as world, pytest.raises(ConfigError, match="one level only"):
        SimulatedRobot(world, blind, 0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("inward_m", "inwards_m", "[dynamic] key 'inwards_m' is unknown; did you mean 'inward_m'?"),
        ("start_s = 0.8", "start_s = -1", "start_s = -1; expected a number, from 0.1 to 5"),
        ("contact_y_m = [-0.03, 0.03]", "contact_y_m = [0.03, -0.03]", "the smaller number first"),
        ("slip_sigma_m = ", "# ", "slip_sigma_m = None; expected a finite number"),
    ],
)
def test_a_table_that_cannot_work_is_refused_with_its_key(tmp_path, old, new, message):
    text = catalogue.load("g1").file.read_text()
    assert old in text
    file = tmp_path / "own.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(message)):
        catalogue.read(file)
