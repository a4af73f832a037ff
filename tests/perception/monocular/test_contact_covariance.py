"""Covariances of contact points, velocities and predictions against sampled pixels and camera poses."""

import math

import numpy as np
import pytest

from perception.monocular.back_projection import camera_pose, floor_points, project
from perception.monocular.contact_covariance import (
    UNKNOWN_SPEED_MPS,
    CameraNoise,
    CovarianceModel,
    pixel_jacobian,
    pose_jacobian,
    prior_covariance,
)
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.obstacles import floor_flows
from perception.monocular.result import Picture
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose3

CAMERA = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)
LENS = Camera(720, 720, 360.0, 350.0, 359.5, 359.5, (-0.1, 0.02, 0.001, -0.001, 0.0))
SMALL = CameraNoise(0.2, 0.15, 0.2, 0.002, 0.5)  # small enough for linearisation
PLACES = np.array([[0.8, 0.0], [1.2, 0.5], [1.6, -0.7]])
STEP_S, HORIZON_S = 0.2, 0.65


def camera_pose_with(error=(0.0, 0.0, 0.0, 0.0), x=0.3, yaw=0.4, roll=0.05):
    """Camera pose with errors of pitch (down), yaw, roll (right) about horizontal axes, rad, and height, m."""
    pose = camera_pose(np.array([x, -0.2, 0.42]), yaw, math.radians(30.0), roll)
    pitch, turn, sway, up = error
    level = turned((0.0, 0.0, 1.0), yaw_of(pose))
    axes = level @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]).T
    R = np.eye(3)
    for axis, angle in zip(axes.T, (pitch, turn, sway), strict=True):
        R = turned(axis, angle) @ R
    return Pose3.from_rotation(R @ pose.rotation, pose.position + np.array([0.0, 0.0, up]))


def yaw_of(pose):
    return math.atan2(pose.rotation[1, 2], pose.rotation[0, 2])


def turned(axis, angle):
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K


def pose_errors(count, rng):
    return rng.normal(size=(count, 4)) * np.sqrt(np.diag(SMALL.pose_covariance))


@pytest.mark.parametrize("camera", [CAMERA, LENS], ids=["pinhole", "lens"])
def test_jacobians_equal_finite_differences(camera):
    pose = camera_pose_with()
    pixels = project(PLACES + np.array([0.3, -0.2]), camera, pose)
    places = floor_points(pixels, camera, pose)
    by_pose, by_pixel = pose_jacobian(places, pose), pixel_jacobian(pixels, places, camera, pose)
    for k, step in enumerate(1e-5 * np.eye(4)):
        slope = floor_points(pixels, camera, camera_pose_with(step)) - floor_points(
            pixels, camera, camera_pose_with(-step)
        )
        np.testing.assert_allclose(by_pose[..., k], slope / 2e-5, rtol=1e-4, atol=1e-6)
    for k, step in enumerate(1e-3 * np.eye(2)):
        slope = floor_points(pixels + step, camera, pose) - floor_points(
            pixels - step, camera, pose
        )
        np.testing.assert_allclose(by_pixel[..., k], slope / 2e-3, rtol=2e-3, atol=1e-7)


def test_the_jacobian_is_finite_for_a_camera_that_looks_straight_down():
    pose = camera_pose(np.array([0.0, 0.0, 1.0]), 0.0, math.pi / 2, 0.0)
    slopes = pose_jacobian(np.zeros((1, 2)), pose)[0]
    np.testing.assert_allclose(
        slopes[:, 0], [-1.0, 0.0], atol=1e-9
    )  # 1 m per rad, towards the feet
    np.testing.assert_allclose(slopes[:, [1, 3]], 0.0, atol=1e-9)


def model_of(before, now):
    """The model of two pictures with independent errors, and a displacement that is exact."""
    errors = np.diag(np.diag(prior_covariance(now, SMALL)))
    errors[8:, 8:] = 0.0
    return CovarianceModel(before, now, HORIZON_S, errors, SMALL.edge_px)


def sampled(count=5_000):  # the standard error of a ratio of variances is 2 %
    """Samples of a contact point at 1.2 m and of the velocity of a corner beside it, and their true values."""
    rng = np.random.default_rng(6)
    black = np.zeros((720, 720, 3), np.uint8)
    before, now = (
        Picture(black, CAMERA, camera_pose_with(x=x), t) for x, t in ((0.29, 0.0), (0.30, STEP_S))
    )
    foot, corner = np.array([[1.5, 0.2]]), np.array([[1.5, 0.24]])
    moved = np.array([0.0, 0.10]) * STEP_S
    edge = project(foot, CAMERA, now.T_world_camera)
    begin = project(corner - moved, CAMERA, before.T_world_camera)
    end = project(corner, CAMERA, now.T_world_camera)
    of_corner = np.array([[[0.09, 0.05], [0.05, 0.04]]])  # on an outline askew
    flows = floor_flows(begin, end, of_corner, before, now, np.zeros(1, np.int32), 6.0)
    contacts, velocities = [], []
    for old, new in zip(pose_errors(count, rng), pose_errors(count, rng), strict=True):
        was, here = camera_pose_with(old, x=0.29), camera_pose_with(new, x=0.30)
        pixel = edge + rng.normal(0.0, SMALL.edge_px, (1, 2))
        ended = end + rng.multivariate_normal(np.zeros(2), of_corner[0], 1)
        contacts.append(floor_points(pixel, CAMERA, here)[0])
        gone = floor_points(ended, CAMERA, here) - floor_points(begin, CAMERA, was)
        velocities.append(gone[0] / STEP_S)
    return before, now, edge, foot, flows, np.array(contacts), np.array(velocities)


def ratios(estimated, samples):
    """Estimated over sample variance, for the two principal directions."""
    found = np.cov(samples.T)
    lower = np.linalg.inv(np.linalg.cholesky(found))
    return np.linalg.eigvalsh(lower @ estimated @ lower.T)


def agreeing(flows):
    """Velocity of the first flow, and a single measurement that agrees with it."""
    return flows.velocity_world[0], flows.velocity_world[:1]


def test_covariances_match_sampled_pixels_and_camera_poses():
    before, now, edge, foot, flows, contacts, velocities = sampled()
    model = model_of(before, now)
    contact, velocity, predicted = model.of_obstacle(edge, foot, flows, 0, *agreeing(flows))
    for estimated, samples in (
        (contact[0], contacts),
        (velocity, velocities),
        (predicted[0], contacts + HORIZON_S * velocities),
    ):
        assert ratios(estimated, samples) == pytest.approx(1.0, abs=0.12)


def test_a_speed_below_the_threshold_enters_the_covariance():
    before, now, edge, foot, flows, _, _ = sampled(2)
    model = model_of(before, now)
    velocity, measured = agreeing(flows)
    moving = model.of_obstacle(edge, foot, flows, 0, velocity, measured)
    static = model.of_obstacle(edge, foot, flows, 0, np.zeros(2), measured)
    rejected = np.outer(flows.velocity_world[0], flows.velocity_world[0])
    np.testing.assert_allclose(static[0], moving[0])
    np.testing.assert_allclose(static[1] - moving[1], rejected, atol=1e-12)
    np.testing.assert_allclose(static[2] - moving[2], HORIZON_S**2 * rejected[None], atol=1e-12)


def test_the_spread_of_disagreeing_corners_enters_the_covariance():
    before, now, edge, foot, flows, _, _ = sampled(2)
    model = model_of(before, now)
    velocity, measured = agreeing(flows)
    rng = np.random.default_rng(5)
    many = velocity + rng.multivariate_normal([0, 0], np.diag([0.03**2, 0.01**2]), 4000)
    alone, apart = (
        model.of_obstacle(edge, foot, flows, 0, velocity, each)[1] for each in (measured, many)
    )
    np.testing.assert_allclose(apart - alone, np.diag([0.03**2, 0.01**2]), atol=4e-5)


def test_without_flow_the_velocity_has_the_covariance_of_an_unknown_speed():
    before, now, edge, foot, flows, _, _ = sampled(2)
    for previous, flow in ((before, -1), (None, -1)):
        model = model_of(previous, now)
        contact, velocity, predicted = model.of_obstacle(
            edge, foot, flows, flow, np.zeros(2), np.zeros((0, 2))
        )
        np.testing.assert_allclose(velocity, UNKNOWN_SPEED_MPS**2 * np.eye(2))
        np.testing.assert_allclose(predicted - contact, HORIZON_S**2 * velocity[None])


def test_all_covariances_of_a_cycle_are_symmetric_and_positive_definite():
    v = np.mgrid[0:720, 0:720][0]
    rgb = np.where((v < 400)[..., None], (60, 80, 180), (190, 150, 105)).astype(np.uint8)
    result = Monocular(MonocularConfig()).cycle(
        None, Picture(rgb, CAMERA, camera_pose_with(roll=0.0), 0.0)
    )
    assert result.obstacles
    for obstacle in result.obstacles:
        for many in (obstacle.contact_covariance, obstacle.predicted_covariance):
            assert many.shape == (len(obstacle.edge), 2, 2)
            known = many[np.isfinite(obstacle.contact_world).all(axis=1)]
            np.testing.assert_allclose(known, known.transpose(0, 2, 1), atol=1e-12)
            assert (np.linalg.eigvalsh(known) > 0.0).all()


@pytest.mark.parametrize("name", ["pitch_deg", "height_m", "edge_px"])
def test_an_invalid_standard_deviation_is_refused(name):
    for value in (-0.1, math.nan):
        with pytest.raises(ConfigError, match=f"{name}={value}"):
            CameraNoise(**{name: value})
