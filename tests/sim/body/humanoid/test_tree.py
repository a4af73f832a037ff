"""The moving links of described robots: masses and kinematics agree with the URDF and with the engine."""

import copy
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from perception.primitives.errors import InputError
from perception.primitives.kinematics import link_poses
from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.described import gait_of
from sim.body.dynamic.physics import Stage
from sim.body.dynamic.pybullet_engine import PyBulletPhysics
from sim.body.gait import Gait, GaitConfig
from sim.body.humanoid.dynamics_filter import DynamicsFilter, sole
from sim.body.humanoid.model import ankles, machine
from sim.body.humanoid.tree import tree_of
from sim.robots import urdf
from sim.robots.masses import masses


@pytest.fixture(scope="module")
def tree(described):
    """The links of a maker's robot."""
    return tree_of(described)


@pytest.fixture
def loaded(tree):
    """The robot in PyBullet at random angles, with these angles."""
    rng = np.random.default_rng(0)
    walk = tree.robot.description.dynamic
    angles = tree.standing(0.2, np.zeros(len(tree.names))) + 0.2 * rng.standard_normal(
        len(tree.names)
    )
    stage = Stage(
        machine(tree, (walk.contact_x_m, walk.contact_y_m)),
        Pose2(0.3, -0.2, 0.7),
        dict(zip(tree.names, angles.tolist(), strict=True)),
        3.0,
        0.005,
    )
    physics = PyBulletPhysics(stage)
    yield physics, angles
    physics.close()


def test_mass_and_centre_of_mass_are_those_of_the_links_of_the_file(tree):
    description = tree.robot.description
    model = urdf.read(description.urdf_path(), description.moving, dict(description.posture))
    poses = link_poses(model.tree, np.zeros(len(tree.names)))
    total, moment = 0.0, np.zeros(3)
    for link in ET.parse(model.path).getroot().findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        kg = float(inertial.find("mass").get("value"))
        place = model.place(link.get("name"))
        origin = inertial.find("origin")
        xyz = [0.0] * 3 if origin is None else [float(v) for v in origin.get("xyz").split()]
        total += kg
        moment += kg * (poses[place.link] @ place.T_link_frame @ [*xyz, 1.0])[:3]
    assert tree.weight_n / 9.81 == pytest.approx(total, rel=1e-9)
    turn = tree.robot.T_trunk_base.rotation
    found = tree.centre_of_mass(np.zeros(len(tree.names)))
    np.testing.assert_allclose(found, turn @ moment / total, atol=1e-9)


def test_the_engine_weighs_what_the_file_says(tree, loaded):
    physics, _ = loaded
    b, c = physics._bullet, physics.client
    numbers = [-1, *physics.index.values()]
    found = [b.getDynamicsInfo(physics.robot, k, physicsClientId=c)[0] for k in numbers]
    assert sum(found) == pytest.approx(tree.weight_n / 9.81, rel=1e-6)


def test_links_are_where_the_unreduced_kinematics_and_the_engine_have_them(tree, loaded):
    """To .1 mm; the engine keeps angles and lengths in double precision."""
    physics, angles = loaded
    pelvis = physics.pelvis()
    np.testing.assert_allclose(pelvis.translation, (0.3, -0.2, 3.0), atol=1e-6)
    turn = tree.robot.T_trunk_base.rotation
    original = link_poses(tree.robot.tree, angles)
    _, places = tree.links(angles)
    for link, place in enumerate(places[1:], 1):
        np.testing.assert_allclose(place, turn @ original[link][:3, 3], atol=1e-9)
        held = physics.link(tree.names[link - 1])
        np.testing.assert_allclose(held.translation, pelvis.apply(place), atol=1e-4)


def test_inverse_kinematics_puts_level_soles_where_they_are_wanted(tree):
    walk = tree.robot.description.walk
    angles = tree.standing(walk.stance_m, np.zeros(len(tree.names)))
    pelvis = np.array([0.02, 0.01, tree.hip_m - 0.01, 0.1])
    half_m = walk.stance_m / 2
    wanted = np.array([0.06, half_m, 0.02, 0.2]), np.array([-0.05, -half_m, 0.0, -0.1])
    tree.reach(pelvis, *wanted, angles)
    T_world_pelvis = Pose2(0.02, 0.01, 0.1).lifted()
    for found, (x, y, z, yaw) in zip(tree.soles(angles), wanted, strict=True):
        place = T_world_pelvis.apply(found.position)
        np.testing.assert_allclose(place, (x, y, z - pelvis[2]), atol=1e-5)
        R = T_world_pelvis.rotation @ found.rotation
        np.testing.assert_allclose(R[:, 2], (0.0, 0.0, 1.0), atol=1e-5)
        assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(yaw, abs=1e-5)


def test_ankles_turn_the_foot_about_the_axes_of_the_body(tree):
    zero = np.zeros(len(tree.names))
    for side, (pitch, roll) in enumerate(ankles(tree)):
        for (joint, sign), axis in ((pitch, 1), (roll, 0)):
            turned = zero.copy()
            turned[joint] = sign * 1e-4
            R = tree.soles(turned)[side].rotation
            vector = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2e-4
            assert vector[axis] > 0.97


def test_a_body_at_rest_has_its_zmp_below_its_centre_of_mass(tree):
    angles = tree.standing(0.2, np.zeros(len(tree.names)))
    pelvis = np.tile([0.3, 0.1, tree.hip_m, 0.5], (6, 1))
    zmp = tree.zero_moment_points(pelvis, np.tile(angles, (6, 1)), 0.005)
    com = Pose2(0.3, 0.1, 0.5).lifted().apply(tree.centre_of_mass(angles))
    np.testing.assert_allclose(zmp, np.tile(com[:2], (6, 1)), atol=1e-9)


def test_the_filter_leaves_millimetres_of_the_error_of_the_zmp(tree):
    description = tree.robot.description
    gait = Gait(replace(gait_of(description, GaitConfig()), zmp_inward_m=0.008), 0.8)
    limits = description.model.gait
    command = WalkCommand(
        0.12,
        single_support_s=limits.single_support_s,
        double_support_s=limits.double_support_s,
    )
    omega = np.sqrt(9.81 / gait.config.com_height_m)
    filtered = DynamicsFilter(tree, float(omega), 0.005)
    angles = tree.standing(description.walk.stance_m, np.zeros(len(tree.names)))
    for _ in range(6):
        step = gait.step(command)
        steps = [step, step_after(gait, command), step_after(gait, command, 2)]
        still = np.zeros((sum(one.ticks for one in steps), 2))
        plan = filtered.plan(steps, still, angles)
        angles = plan.angles[-1].copy()
    point_mass = step.com + step.com_velocity / omega
    point_mass = point_mass - np.gradient(point_mass, 0.005, axis=0) / omega
    inner = slice(8, -8)
    plain, found = tree.follow(
        step.com,
        sole(step, 1),
        sole(step, -1),
        step.body[:, 2],
        still[: step.ticks],
        plan.angles[0],
    )
    before = tree.zero_moment_points(plain, found, 0.005) - point_mass
    after = tree.zero_moment_points(plan.pelvis, plan.angles, 0.005) - point_mass
    rms = [float(np.sqrt(np.mean(e[inner] ** 2))) for e in (before, after)]
    assert rms[1] < 0.2 * rms[0]
    assert rms[1] < 0.005


def step_after(gait, command, times=1):
    """The step after these repeats of a command."""
    ahead = copy.copy(gait)
    for _ in range(times):
        step = ahead.step(command)
    return step


def test_a_link_without_mass_is_refused(tmp_path, little):
    description = little.description
    model = urdf.read(description.urdf_path(), description.moving, dict(description.posture))
    with pytest.raises(InputError, match="has no mass; expected <inertial>"):
        masses(model)
