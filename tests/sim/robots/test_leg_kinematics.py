"""Legs: the foot is where it was wanted, and out of reach it is as near as it gets."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.primitives.kinematics import link_poses
from perception.primitives.pose import Pose2, Pose3
from sim.robots.leg_kinematics import bent, solved


def tip(robot, side, angles):
    return link_poses(robot.tree, angles)[robot.legs[side][-1] + 1] @ robot.feet[side]


@pytest.mark.parametrize("side", [0, 1])
def test_a_pose_that_a_leg_can_have_is_found(little, side):
    rng = np.random.default_rng(side)
    leg = list(little.legs[side])
    for _ in range(20):
        angles = little.bent
        angles[leg] += rng.uniform(-0.3, 0.3, 6)
        wanted = tip(little, side, angles)
        found, error = solved(
            little.tree,
            little.bent,
            little.legs[side],
            little.feet[side],
            Pose3.from_matrix(wanted),
        )
        assert error < 1e-8
        np.testing.assert_allclose(tip(little, side, found), wanted, atol=1e-8)
        others = [j for j in range(len(found)) if j not in leg]
        np.testing.assert_array_equal(found[others], little.bent[others])


def test_a_foot_out_of_reach_is_approached_with_a_straight_leg(little):
    foot = tip(little, 0, little.bent)
    foot[2, 3] -= 0.5
    found, error = solved(
        little.tree, little.bent, little.legs[0], little.feet[0], Pose3.from_matrix(foot)
    )
    knee = found[little.tree.index("l_knee")]
    assert knee < 0.1
    assert 0.3 < error < 0.5
    for joint, angle in zip(little.tree.joints, found, strict=True):
        assert joint.least_rad - 1e-12 <= angle <= joint.most_rad + 1e-12


def test_the_knee_begins_bent_the_way_it_bends(little):
    assert bent(little.tree, little.legs[0])[3] == pytest.approx(0.5)


@pytest.mark.parametrize("lift_m", [0.0, 0.03])
def test_the_soles_stand_where_the_gait_puts_them(little, lift_m):
    gait = little.description.model.gait
    length = gait.max_speed_mps * gait.step_s
    feet = ((Pose2(length / 2, 0.08, 0.2), lift_m), (Pose2(-length / 2, -0.09, -0.1), 0.0))
    T_body_trunk = Pose3.from_rotation(np.eye(3), np.array([0.01, 0.05, 0.0]))
    angles = little.standing(little.bent, T_body_trunk, feet)
    for side, (place, height) in enumerate(feet):
        T = T_body_trunk.matrix @ little.T_trunk_base.matrix @ tip(little, side, angles)
        sole = T @ np.array([0.02, 0.0, -0.05, 1.0])  # of the URDF: its foot's axes are level
        np.testing.assert_allclose(sole[:3], [place.x, place.y, height], atol=1e-8)
        np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, 1.0], atol=1e-8)
        np.testing.assert_allclose(np.arctan2(T[1, 0], T[0, 0]), place.yaw, atol=1e-8)


def test_both_soles_are_level_on_the_highest_and_longest_step_that_is_stated(maker):
    description = maker.description
    limits, half = description.model.steps, description.walk.stance_m / 2
    for rise_m, most_m, most_rad in (
        (limits.up_m, 0.005, 0.02),
        (-limits.down_m, 0.015, math.radians(10.5)),  # the heel behind lifts
    ):
        for share in (0.35, 0.5, 0.65):  # of the pelvis on its way to the foot ahead
            ahead = Pose2((1.0 - share) * limits.reach_m, half), rise_m / 2
            behind = Pose2(-share * limits.reach_m, -half), -rise_m / 2
            lowered = Pose3((0.0, 0.0, -abs(rise_m) / 2))
            angles = maker.standing(maker.bent, lowered, (ahead, behind))
            poses = link_poses(maker.tree, angles)
            base = (lowered @ maker.T_trunk_base).matrix
            for leg, foot, level, side, (place, height_m) in zip(
                maker.legs, maker.feet, maker.level, (1.0, -1.0), (ahead, behind), strict=True
            ):
                tip = base @ poses[leg[-1] + 1] @ foot
                x, y, z = description.legs.sole_m
                ankle = [place.x - x, place.y - side * y, height_m - z]
                assert tip[:3, 3] == pytest.approx(ankle, abs=most_m)
                turned = Rotation.from_matrix(tip[:3, :3] @ level.T).magnitude()
                assert turned < most_rad
