"""The live pose of the odometry on the floor, against drawn errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.odometry.odometry import Step
from perception.odometry.odometry_poses import OdometryPoses
from perception.primitives.pose import Pose3, head_rotation

SIGMA_RAD = math.radians(1.0)
COVARIANCE = np.diag([1e-4] * 3 + [SIGMA_RAD**2] * 3)


@pytest.mark.parametrize("pitch_deg", [0, 30, 60, 75])
def test_the_heading_of_a_camera_that_looks_down_is_as_doubtful_as_its_drawn_errors(pitch_deg):
    rng = np.random.default_rng(0)
    start = Pose3.from_rotation(
        head_rotation(0.4, math.radians(pitch_deg)), np.array([0.0, 0.0, 1.2])
    )
    poses = OdometryPoses(rng)
    poses.odometer._T_world_start, poses.odometer.states = start, ["first", "tracked"]
    poses._step = Step("tracked", Pose3(), Pose3(), COVARIANCE, 0)
    poses._covariance = COVARIANCE
    live = poses.pose
    assert live is not None
    drawn = Rotation.from_rotvec(SIGMA_RAD * rng.normal(size=(20000, 3)))
    ahead = drawn.apply(start.rotation[:, 2])
    error = np.arctan2(ahead[:, 1], ahead[:, 0]) - live.mean[2]
    assert live.mean[2] == pytest.approx(0.4)
    assert np.mean(error**2) / live.covariance[2, 2] == pytest.approx(1.0, abs=0.08)
    np.testing.assert_allclose(live.covariance[:2, :2], 1e-4 * np.eye(2), atol=1e-6)
