"""A robot of links: its soles, its eyes, its gaze and its outline, of the boxes and of other makers."""

import math

import numpy as np
import pytest

from perception.primitives.kinematics import link_poses
from perception.primitives.pose import Pose2, Pose3


def outline(robot, angles, joint=None):
    """Corners of all hulls in the trunk frame."""
    poses = link_poses(robot.tree, angles)
    base = robot.T_trunk_base.matrix
    found = []
    for hull in robot.hulls:
        T = base @ poses[hull.link]
        found.append(hull.corners @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def stance(robot):
    half = robot.description.walk.stance_m / 2
    return robot.standing(robot.bent, Pose3(), ((Pose2(0.0, half), 0.0), (Pose2(0.0, -half), 0.0)))


def check_outline(robot):
    model = robot.description.model
    points = outline(robot, stance(robot))
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.002)  # soles on the floor
    assert 0.9 * model.height_m < points[:, 2].max() < model.height_m + 0.02
    assert np.hypot(points[:, 0], points[:, 1]).max() < model.radius_m + 0.005
    assert np.ptp(points[:, 1]) < model.width_m + 0.01
    assert np.abs(points[:, 1].max() + points[:, 1].min()) < 0.01  # left as right
    assert points[:, 0].max() > -points[:, 0].min() - 0.05  # hands and toes ahead
    angles = stance(robot)
    eye = robot.camera(angles, (0.0, 0.0, 0.0))
    assert eye.translation[2] == pytest.approx(model.eye_m, abs=0.07)


def check_gaze(robot):
    head, zero = robot.description.model.head, np.zeros(len(robot.tree.joints))
    for tilt_deg in np.linspace(*head.tilt_deg, 4):
        angles = zero.copy()
        angles[list(robot.gaze)] = robot.aimed(zero, 0.3, math.radians(tilt_deg))
        ahead = robot.camera(angles, (0.0, 0.0, 0.0)).rotation[:, 2]
        wanted = math.radians(tilt_deg)
        true = [
            math.cos(0.3) * math.cos(wanted),
            math.sin(0.3) * math.cos(wanted),
            -math.sin(wanted),
        ]
        assert math.degrees(math.acos(min(1.0, float(ahead @ true)))) < 3.0


def test_the_boxes_stand_on_the_floor_within_their_circle(little):
    check_outline(little)


def test_models_of_other_makers_stand_on_the_floor_within_their_circle(maker):
    check_outline(maker)


def test_the_gaze_joints_of_the_boxes_turn_the_eyes_where_they_are_told(little):
    check_gaze(little)


def test_the_gaze_joints_of_other_makers_turn_the_eyes_where_they_are_told(maker):
    check_gaze(maker)


def test_longest_steps_are_within_reach_of_the_legs_of_other_makers(maker):
    gait, walk = maker.description.model.gait, maker.description.walk
    half, length = walk.stance_m / 2, gait.max_speed_mps * gait.step_s
    angles = stance(maker)
    for side in (1.0, -1.0):
        feet = (
            (Pose2(side * length / 2, half, 0.12), walk.lift_m if side < 0 else 0.0),
            (Pose2(-side * length / 2, -half, -0.12), walk.lift_m if side > 0 else 0.0),
        )
        T_body_trunk = Pose3((0.2 * length, side * half, 0.0))
        angles = maker.standing(angles, T_body_trunk, feet)
        poses = link_poses(maker.tree, angles)
        for k, (place, height) in enumerate(feet):
            x, y, z = maker.description.legs.sole_m
            T = T_body_trunk.matrix @ maker.T_trunk_base.matrix @ poses[maker.legs[k][-1] + 1]
            ankle = place.lifted().apply(np.array([-x, -(1, -1)[k] * y, -z]))
            np.testing.assert_allclose(
                (T @ maker.feet[k])[:3, 3], ankle + np.array([0.0, 0.0, height]), atol=1e-7
            )


def test_a_camera_does_not_see_what_it_is_built_into(little):
    own = little.own_body(0.005, 0.01, [(0.0, 0.0, 0.0)])
    seen = {part.name.split()[0] for part in own.parts}
    assert "head" not in seen
    assert {"l_forearm", "r_forearm", "l_foot", "r_thigh", "pelvis"} <= seen
    doubt = {part.name.split()[0]: part.angle_sigma_rad for part in own.parts}
    assert doubt["l_forearm"] == 0.0  # on the link of the camera
    assert doubt["pelvis"] == pytest.approx(math.hypot(math.sqrt(2) * 0.005, 0.01))
    assert doubt["l_foot"] == pytest.approx(math.hypot(math.sqrt(8) * 0.005, 0.01))
