"""Both physics engines obey the same mechanics with the same body, and the walker walks in both."""

from __future__ import annotations

import importlib.util
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.errors import ConfigError, SurefootError
from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.dynamic.anatomy import DARWIN, links
from sim.body.dynamic.config import DynamicConfig
from sim.body.dynamic.engines import begin
from sim.body.dynamic.legs import Legs
from sim.body.dynamic.physics import ENGINES, Physics, Stage
from sim.body.pendulum import GRAVITY_MPS2
from sim.robot import SimulatedRobot
from sim.robot_config import RobotConfig
from sim.scene import FloorArea, Scene, StaticObject
from sim.shapes import Box, Cylinder, Solid
from sim.world import World

TICK_S = 0.005
STRAIGHT_M = DARWIN.thigh_m + DARWIN.shank_m + DARWIN.ankle_m
BLIND = RobotConfig(body="dynamic", tof=False, stereo=False, colour=False)
EXTENT = (-1.5, -1.5, 1.5, 1.5)
SOLES = ("left_ankle_roll", "right_ankle_roll")
needs_mujoco = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None,
    reason="MuJoCo is not installed; run: pip install 'surefoot[physics]'",
)
both = pytest.mark.parametrize(
    "engine", [pytest.param(name, marks=[needs_mujoco] * (name == "mujoco")) for name in ENGINES]
)


def stage(height_m=STRAIGHT_M, **objects):
    return Stage(DARWIN, Pose2(0.1, -0.2, 0.5), {}, height_m, TICK_S, **objects)


def robot_in(engine, *static_objects, seed=0, **dynamic):
    floor = (FloorArea("plaster/white", EXTENT),)
    scene = Scene("floor", 0, EXTENT, floor, static_objects, (), (), Pose2(), ())
    config = replace(BLIND, dynamic=DynamicConfig(engine=engine, **dynamic))
    return SimulatedRobot(World(scene, "tiny", seed), config, seed)


def walk(robot, command, steps):
    for _ in range(steps):
        robot.body.walk(command)
        robot.body.start_due_step()
        robot.body.advance(robot.body.ticks_left)


@both
def test_a_falling_body_falls_by_half_g_t_squared_and_feels_no_weight(engine):
    physics = begin(engine, stage(1.0))
    assert isinstance(physics, Physics)
    for _ in range(40):
        physics.step()
    x, y, z = physics.pelvis().translation
    turn, force = physics.imu_reading()
    physics.close()
    seconds = 40 * TICK_S
    assert 1.0 - z == pytest.approx(GRAVITY_MPS2 * seconds**2 / 2, rel=0.03)  # one tick is 2.5 %
    assert (x, y) == pytest.approx((0.1, -0.2), abs=1e-3)
    np.testing.assert_allclose(force, 0.0, atol=0.02)
    np.testing.assert_allclose(turn, 0.0, atol=0.02)


@both
def test_the_gyro_adds_up_to_the_rotation_of_a_trunk_that_shakes(engine):
    """In free fall, with legs kicked to and fro faster than a tick can resolve."""
    physics, names = begin(engine, stage(3.0)), ("left_hip_roll", "right_hip_pitch", "left_hip_yaw")
    told = Rotation.from_matrix(physics.pelvis().rotation)
    farthest = 0.0
    for k in range(60):
        physics.command_joints(names, np.full(3, 0.3 * (-1) ** (k // 3)), np.zeros(3))
        physics.step()
        told = told * Rotation.from_rotvec(TICK_S * physics.imu_reading()[0])
        true = Rotation.from_matrix(physics.pelvis().rotation)
        farthest = max(farthest, (true * Rotation.from_euler("z", 0.5).inv()).magnitude())
    physics.close()
    assert math.degrees(farthest) > 3.0
    assert math.degrees((told.inv() * true).magnitude()) < 0.01


@both
def test_a_standing_body_rests_at_its_height_and_its_soles_bear_its_weight(engine):
    with robot_in(engine, bump_m=0.0, backlash_deg=0.0, offset_deg=0.0) as robot:
        physics, loads, felt = robot.body.physics, [], []
        for _ in range(100):
            robot.body.advance(1)
            loads.append(sum(physics.sole_force(sole) for sole in SOLES))
            felt.append(physics.imu_reading()[1])
        heights = [physics.link(sole).translation[2] for sole in SOLES]
        assert physics.pelvis().translation[2] == pytest.approx(DARWIN.hip_m, abs=2e-3)
    weight = GRAVITY_MPS2 * sum(link.mass for link in links(DARWIN))
    assert np.mean(loads) == pytest.approx(weight, rel=0.02)
    assert heights == pytest.approx([DARWIN.ankle_m] * 2, abs=5e-4)
    assert np.linalg.norm(np.mean(felt, axis=0)) == pytest.approx(GRAVITY_MPS2, rel=0.01)


@both
def test_steps_are_as_long_as_commanded(engine):
    with robot_in(engine) as robot:
        walk(robot, WalkCommand(0.04), 2)
        before, planned = robot.body.true_pose, robot.body.planned_pose
        walk(robot, WalkCommand(0.04), 6)
        made = before.inverse() @ robot.body.true_pose
        asked = planned.inverse() @ robot.body.planned_pose
        assert not robot.fallen
    assert asked.x == pytest.approx(0.24, abs=0.002)
    assert made.x == pytest.approx(asked.x, abs=6 * 0.003)
    assert made.y == pytest.approx(asked.y, abs=6 * 0.003)
    assert math.degrees(made.yaw - asked.yaw) == pytest.approx(0.0, abs=6 * 1.0)


@needs_mujoco
@pytest.mark.parametrize(("newtons", "seconds", "falls"), [(10.0, 0.1, False), (60.0, 0.2, True)])
def test_a_push_is_survived_in_mujoco_or_reported_as_a_fall(newtons, seconds, falls):
    with robot_in("mujoco") as robot:
        walk(robot, WalkCommand(0.04), 2)
        robot.body.push(np.array([0.0, newtons, 0.0]), seconds)
        walk(robot, WalkCommand(0.04), 2)
        assert robot.fallen == falls


@needs_mujoco
def test_the_same_seed_gives_the_same_bits_in_mujoco():
    def ends(seed):
        with robot_in("mujoco", seed=seed) as robot:
            robot.body.advance(20)
            return robot.body.physics.data.qpos.tobytes()

    assert ends(3) == ends(3) != ends(4)


@needs_mujoco
def test_a_body_in_mujoco_stands_without_pybullet(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with robot_in("mujoco") as robot:
        robot.config.require()
        robot.body.advance(1)
        assert not robot.fallen


@needs_mujoco
def test_the_model_in_mujoco_has_the_masses_and_lengths_of_the_anatomy():
    """Its centre of mass is that of our own leg kinematics, in a posture with every leg joint bent."""
    angles = np.array([0.1, -0.1, -0.4, 0.7, -0.3, 0.1, -0.1, 0.05, -0.5, 0.8, -0.3, -0.05])
    stance = dict(zip(Legs.joints, angles.tolist(), strict=True))
    physics = begin("mujoco", replace(stage(1.0), stance=stance))
    assert physics.model.body_mass.sum() == pytest.approx(sum(o.mass for o in links(DARWIN)))
    com = physics.pelvis().inverse().apply(physics.data.subtree_com[1][None])[0]
    np.testing.assert_allclose(com, Legs(DARWIN).centre_of_mass(angles), atol=1e-6)
    for foot, side in zip(Legs(DARWIN).feet(angles), SOLES, strict=True):
        found = physics.pelvis().inverse() @ physics.link(side)
        np.testing.assert_allclose(found.matrix, foot.matrix, atol=1e-6)


@needs_mujoco
def test_objects_stop_the_robot_in_mujoco_and_are_not_felt_as_floor():
    """A box before the left foot, a mesh before the right one."""
    corners = np.array([[x, y, z] for x in (0.12, 0.3) for y in (-0.4, -0.01) for z in (0.0, 0.5)])
    mesh = StaticObject("mesh", (Solid(corners, np.array([[0, 1, 2]])),))
    crate = StaticObject("crate", (Box((0.21, 0.2, 0.25), (0.18, 0.38, 0.5)),))
    with robot_in("mujoco", mesh, crate, bump_m=0.0) as robot:
        physics, aloft = robot.body.physics, []
        for _ in range(5 * 13):
            robot.walk(WalkCommand(0.05))
            robot.body.advance(10)
            for sole in SOLES:
                at = physics.link(sole)
                assert at.translation[0] + DARWIN.foot_m[0] / 2 < 0.12 + 0.005
                if at.translation[2] > DARWIN.ankle_m + 0.006 and not robot.fallen:
                    aloft.append(physics.sole_force(sole))
        assert robot.body.true_pose.x > 0.03
    assert max(aloft) == 0.0


@both
def test_a_moving_object_pushes_the_robot(engine):
    pillar = [Cylinder((0.0, 0.0, 0.4), 0.1, 0.8)]
    physics = begin(engine, replace(stage(moving=[pillar]), start=Pose2()))
    ahead = DARWIN.torso_m[0] / 2 + 0.1
    for gap in (0.02, -0.01):
        physics.place([(ahead + gap, 0.0)])
        before = physics.pelvis().translation[0]
        for _ in range(20):
            physics.step()
        moved = physics.pelvis().translation[0] - before
        assert moved == pytest.approx(0.0, abs=1e-3) if gap > 0.0 else moved < -0.003
    physics.close()


def test_an_unknown_engine_is_refused():
    with pytest.raises(ConfigError, match="engine='ode' is unknown; choose pybullet, mujoco"):
        DynamicConfig(engine="ode")


def test_without_its_wheel_mujoco_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    robot = replace(BLIND, dynamic=DynamicConfig(engine="mujoco"))
    assert not robot.needs_pybullet
    with pytest.raises(SurefootError, match=r"run: pip install 'surefoot\[physics\]'"):
        robot.require()
