"""The live pose of the odometry on the floor, against drawn errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.depth.reach import ReachConfig, ReachesConfig
from perception.odometry.odometry import Step
from perception.odometry.odometry_poses import OdometryPoses
from perception.odometry.rgbd_odometry import Odometer
from perception.primitives.camera import Camera
from perception.primitives.frame import DepthView, Frame
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


def narrow_view_of_the_floor() -> Frame:
    """By a level camera 1.7 m above the floor, noisy as structured light; its lowest row sees it 7.4 m ahead."""
    camera = Camera(160, 120, 260.0, 260.0, 79.5, 59.5)
    below = np.mgrid[:120, :160][0] / 260.0 - 59.5 / 260.0
    z = 1.7 / np.where(below > 0.02, below, np.nan)
    z += np.random.default_rng(1).normal(size=z.shape) * (0.0012 + 0.0019 * np.square(z - 0.4))
    return Frame(0.0, depth=DepthView(z.astype(np.float32), camera))


@pytest.mark.parametrize(("farthest_m", "seen"), [(4.0, False), (7.0, False), (12.0, True)])
def test_the_floor_is_looked_for_within_the_reach_that_the_user_sets(farthest_m, seen):
    reach = ReachesConfig(depth=ReachConfig(0.3, farthest_m, 2))
    odometer = Odometer(np.random.default_rng(0), reach=reach)
    odometer.track(narrow_view_of_the_floor())
    start = odometer.T_world_start
    assert (start is not None) == seen
    if start is not None:
        assert start.position[2] == pytest.approx(1.7, abs=0.03)


def test_a_floor_beyond_a_shorter_reach_is_not_used():
    camera = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
    rows = np.mgrid[:120, :160][0] - 59.5
    down = math.radians(45)
    z = 1.7 / (rows / 130.0 * math.cos(down) + math.sin(down))
    frame = Frame(0.0, depth=DepthView(z.astype(np.float32), camera))
    for farthest_m, seen in ((4.0, True), (1.5, False)):  # the nearest pixel is 1.65 m away
        reach = ReachesConfig(depth=ReachConfig(0.3, farthest_m, 2))
        odometer = Odometer(np.random.default_rng(0), reach=reach)
        odometer.track(frame)
        assert (odometer.T_world_start is not None) == seen
