"""Legs: inverse and forward kinematics agree, and so does the mass centre with a sum over all links."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.commands import WalkCommand
from sim.body.dynamic.anatomy import DARWIN, LEG_JOINTS, TALL, links
from sim.body.dynamic.legs import Legs
from sim.body.gait import Gait, GaitConfig

BODIES = (DARWIN, TALL)
small = st.floats(-0.04, 0.04)
turn = st.floats(-0.5, 0.5)
bend = st.one_of(st.just((0.0, 0.0)), st.tuples(st.floats(-0.4, 0.4), st.floats(-0.8, 0.8)))
foot = st.tuples(small, st.floats(-0.02, 0.03), st.floats(0.0, 0.03), turn)


def turned(axis, angle):
    """Rotation about a unit axis, by Rodrigues."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def chain(body, angles):
    """Position, rotation and mass of every link, from the table."""
    by_joint = dict(zip(Legs.joints, angles, strict=True))
    poses = {"": (np.zeros(3), np.eye(3))}
    for link in links(body):
        place, R = poses[link.parent]
        angle = by_joint.get(link.name, 0.0)
        poses[link.name] = (place + R @ np.array(link.origin), R @ turned(link.axis, angle))
    return poses


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(BODIES), foot, foot, turn, bend)
def test_inverse_kinematics_reaches_the_foot_poses(body, left, right, yaw, bend):
    legs, half = Legs(body), 1.2 * body.hip_half_m
    scale = body.hip_m / DARWIN.hip_m
    height = 0.99 if bend == (0.0, 0.0) else 0.9  # a raised hip must stay within reach
    pelvis = np.array([0.01, -0.02, height * body.hip_m, yaw])
    c, s = math.cos(yaw), math.sin(yaw)
    asked = []
    for side, (x, y, z, turned_by) in ((1, left), (-1, right)):
        x, y = scale * x, side * (half + scale * y)
        height = body.ankle_m + scale * z
        asked.append(
            np.array([0.01 + c * x - s * y, -0.02 + s * x + c * y, height, yaw + turned_by])
        )
    angles = legs.solve(pelvis, *asked, np.array(bend))
    roll, pitch = bend
    for found, wanted in zip(legs.feet(angles), asked, strict=True):
        R = turned((0, 0, 1), yaw) @ turned((0, 1, 0), pitch) @ turned((1, 0, 0), roll)
        place = pelvis[:3] + R @ found.translation
        np.testing.assert_allclose(place, wanted[:3], atol=1e-12)
        np.testing.assert_allclose(R @ found.rotation, turned((0, 0, 1), wanted[3]), atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(BODIES), st.lists(st.floats(-1.2, 1.2), min_size=12, max_size=12))
def test_feet_and_mass_centre_agree_with_the_link_table(body, values):
    angles = np.array(values)
    legs, poses = Legs(body), chain(body, angles)
    for side, found in zip(("left", "right"), legs.feet(angles), strict=True):
        place, R = poses[f"{side}_{LEG_JOINTS[-1]}"]
        np.testing.assert_allclose(found.translation, place, atol=1e-12)
        np.testing.assert_allclose(found.rotation, R, atol=1e-12)
    parts = links(body)
    mass = sum(part.mass for part in parts)
    weight = sum(
        part.mass * (poses[part.name][0] + poses[part.name][1] @ part.centre_of_mass)
        for part in parts
    )
    np.testing.assert_allclose(legs.centre_of_mass(angles), weight / mass, atol=1e-12)


def test_the_leg_stretches_towards_a_foot_out_of_reach():
    legs = Legs(DARWIN)
    far = np.array([0.0, 0.037, -0.3, 0.0])
    angles = legs.solve(np.zeros(4), far, far * np.array([1, -1, 1, 1]))
    assert angles[3] == pytest.approx(0.0, abs=1e-6)
    left, _ = legs.feet(angles)
    np.testing.assert_allclose(left.translation, [0.0, 0.037, -0.186], atol=1e-6)


def test_mass_centre_of_the_legs_follows_the_pendulum():
    legs, gait = Legs(DARWIN), Gait(GaitConfig())
    angles = legs.stand(np.zeros(2), 0.09)
    for command in [WalkCommand(0.05, 0.01, 0.15)] * 3:
        step = gait.step(command)
        pelvis = legs.pelvis_trajectory(step, angles, 0.005, DARWIN.hip_m)
        left, right = legs.ankles(step)
        for k in range(0, step.ticks, 13):
            solved = legs.solve(pelvis[k], left[k], right[k])
            R = turned((0, 0, 1), pelvis[k, 3])
            com = pelvis[k, :3] + R @ legs.centre_of_mass(solved)
            np.testing.assert_allclose(com[:2], step.com[k], atol=2e-4)
        angles = legs.solve(pelvis[-1], left[-1], right[-1])


def test_mass_centre_of_a_standing_body_has_the_height_of_the_pendulum():
    legs = Legs(DARWIN)
    angles = legs.stand(np.zeros(2), 0.09)
    com = legs.centre_of_mass(angles)
    assert DARWIN.hip_m + com[2] == pytest.approx(GaitConfig().com_height_m, abs=2e-3)
    left, right = legs.feet(angles)
    np.testing.assert_allclose((left.position + right.position)[:2] / 2, com[:2], atol=1e-6)
