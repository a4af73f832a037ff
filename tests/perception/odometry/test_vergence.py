"""The vergence of a stereo pair by its own motion, against the angle that rendered pairs were given."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth import stereo
from perception.depth.distortion import DistortionConfig
from perception.depth.stereo import Disparity, StereoConfig
from perception.odometry.pyramid import build, compress
from perception.odometry.rgbd_odometry import Odometer
from perception.odometry.vergence import Vergence, VergenceEstimator
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import StereoView

from .road import BASELINE_M, CAMERA, SIGMA_PX, STEP_M, pose, seen

IMAGES = 12
TURNED = np.radians(0.1)  # 1.25 px at the 718 px of KITTI's cameras


def driven(vergence: float, seed: int, images: int = IMAGES) -> Odometer:
    rng, odometer = np.random.default_rng(seed), Odometer(np.random.default_rng(0))
    for number in range(images):
        odometer.track_images(*seen(pose(number), vergence, rng), "stereo")
    return odometer


@pytest.fixture(scope="module", params=[TURNED, -TURNED], ids=["outwards", "inwards"])
def turned(request) -> tuple[float, Odometer]:
    return request.param, driven(request.param, 3)


def test_a_moving_pair_tells_that_it_is_turned(turned):
    angle, odometer = turned
    found = odometer.vergence.solve()
    assert found.pairs == IMAGES - 1
    assert found.angle * angle > 0.0
    assert 0.4 < found.angle / angle < 1.2  # one estimate at a wrong motion finds half or more
    assert abs(found.angle) > 2.0 * found.sigma


def test_the_claims_of_a_turned_pair_hold_its_error_which_grows_with_the_path(turned):
    """The error is .8 m and more after 11 m; steps that err independently would claim .05 to .06 m."""
    _, odometer = turned
    poses, solution = odometer.trajectory()
    claims = odometer.uncertainty(solution)
    start = poses[0] @ pose(0).inverse()
    errors = [one.position - (start @ pose(n)).position for n, one in enumerate(poses)]
    assert np.linalg.norm(errors[-1]) > 0.05 * STEP_M * (IMAGES - 1)
    for number in (4, 8, IMAGES - 1):
        C = claims.from_start[number][:3, :3]
        assert (
            errors[number] @ np.linalg.solve(C, errors[number]) < 11.3
        )  # chi squared of 3 at 99 %
    sigma = np.sqrt(claims.from_start[:, 2, 2])
    assert 1.6 < sigma[8] / sigma[4] < 2.4  # of independent steps 1.4


def test_a_calibrated_pair_is_not_suspected():
    odometer = driven(0.0, 4)
    found = odometer.vergence.solve()
    assert abs(found.angle) < 3.0 * found.sigma
    assert found.usual == pytest.approx(SIGMA_PX / CAMERA.fx, rel=0.05)
    assert found.size * BASELINE_M < 2.0 * found.usual


def test_a_pair_that_stands_still_tells_nothing():
    rng, odometer = np.random.default_rng(0), Odometer(np.random.default_rng(0))
    for _ in range(4):
        odometer.track_images(*seen(pose(0), TURNED, rng), "stereo")
    found = odometer.vergence.solve()
    assert not found.known
    assert found.size == pytest.approx(found.usual / BASELINE_M)


@pytest.mark.parametrize("angle", [TURNED, 0.0])
def test_what_is_left_is_taken_out_round_by_round(angle):
    estimator, rng = VergenceEstimator(DistortionConfig().stereo), np.random.default_rng(5)
    for number in range(IMAGES):
        estimator.add(*seen(pose(number), angle, rng))
    found = estimator.solve()
    assert abs(found.angle - angle) < 3.0 * found.sigma
    assert found.sigma < np.radians(0.03)


def test_the_setting_takes_the_vergence_out_of_depth():
    """The pixels of a right camera that is turned outwards, by the tangent of its angle."""
    camera = Camera(320, 40, 300.0, 300.0, 159.5, 19.5)
    z, baseline_m = 12.0, 0.5
    slope = camera.rays[..., 0] / camera.rays[..., 2]
    right = np.tan(np.arctan(slope - baseline_m / z) - TURNED)
    disparity = (300.0 * (slope - right)).astype(np.float32)
    ones = np.ones_like(disparity)
    view = StereoView(
        np.zeros((40, 320), np.uint8), np.zeros((40, 320), np.uint8), baseline_m, camera
    )
    matched = Disparity(disparity, ones, 0.1 * ones)
    as_given = stereo.depth_of(view, matched, StereoConfig())
    assert abs(as_given.z - z).min() > 0.4
    found = stereo.depth_of(view, matched, StereoConfig(vergence_deg=float(np.degrees(TURNED))))
    np.testing.assert_allclose(found.z, z, atol=0.04)


@pytest.mark.parametrize("value", [2.1, -2.1, float("nan")])
def test_an_impossible_vergence_is_refused(value):
    with pytest.raises(ConfigError, match="vergence_deg="):
        StereoConfig(vergence_deg=value)


def test_references_keep_what_is_far():
    """A road is known again by what is 10 to 90 m away."""
    depth, rgb = seen(pose(0), 0.0, np.random.default_rng(0))
    image = build(depth, rgb)
    kept = compress(image).pyramid()
    for name in ("z", "sigma"):
        was, now = getattr(image.levels[0], name), getattr(kept.levels[0], name)
        np.testing.assert_array_equal(np.isnan(now), np.isnan(was))
        np.testing.assert_allclose(now, was, atol=2e-3)
    assert np.nanmax(kept.levels[0].z) > 80.0


def test_without_images_of_a_pair_nothing_is_told():
    odometer = Odometer(np.random.default_rng(0))
    assert odometer.vergence.solve() == Vergence()
    assert not odometer.vergence.of_image(-1).any()


@pytest.mark.parametrize("others", [{0, 1, 2}, {4}, set(range(8)) - {3, 4, 5}])
def test_images_of_another_sensor_may_stand_between_those_of_a_pair(others):
    """As a frame without its depth image, where the odometry takes the pair instead."""
    rng, odometer = np.random.default_rng(3), Odometer(np.random.default_rng(0))
    for number in range(8):
        odometer.track_images(
            *seen(pose(number), TURNED, rng), "depth" if number in others else "stereo"
        )
    poses, solution = odometer.trajectory()
    claims = odometer.uncertainty(solution)
    assert claims.from_start.shape == (8, 6, 6)
    common = odometer.vergence.covariances(poses, odometer.T_world_start or poses[0])
    grown = common.from_start[:, 2, 2] > 1e-9
    first = min(
        number for number in range(1, 8) if number not in others and number - 1 not in others
    )
    assert not grown[:first].any()
    assert grown[first:].all()
