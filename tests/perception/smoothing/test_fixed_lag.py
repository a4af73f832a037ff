"""The fixed-lag smoother: its front equals the Kalman filter, without forgetting it equals the batch; and live."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from perception.filtering import models
from perception.filtering.consistency import band, nees
from perception.localisation.filter import PoseFilter
from perception.localisation.localiser_noise import (
    GYRO_BIAS_SIGMA_RADPS,
    NO_ODOMETRY_MPS,
    RANGE_WALK,
    LocaliserConfig,
)
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.pose import Pose2, wrap_angle
from perception.smoothing.factors import Factor, Motion, PoseSeen
from perception.smoothing.fixed_lag import FixedLagSmoother, smooth_fixed_lag
from perception.smoothing.lagged_filter import LaggedFilter
from perception.smoothing.smoother import SmootherConfig, smooth, solve
from perception.smoothing.walk_factors import Instant, step, walk_factors, walk_systematics

DEG = math.pi / 180
CONFIG = LocaliserConfig()
MARKS = [
    Landmark(i, (x, y, 0.45), 0.16)
    for i, (x, y) in enumerate([(1.5, 1.5), (3.0, -1.5), (0.0, -1.6), (4.2, 0.5), (2.5, 2.0)])
]
PLACES = {mark.identity: (mark.position[0], mark.position[1]) for mark in MARKS}
STARTING = np.diag([0.02, 0.02, 2 * DEG]) ** 2
LAG_S = 5.0
LIVE = replace(CONFIG, lag_s=LAG_S)


def walk(seed: int, frames: int = 36) -> tuple[Gaussian, list[Instant], list[Pose2]]:
    """A walk with the errors that the filter models: start, measurements, ground truth.

    A winding path with two frames a step; slip, turn, gyro, pan and ranges have systematic and random errors.
    """
    rng = np.random.default_rng(seed)
    c = CONFIG
    slip = c.slip_m + c.slip_sigma_m * rng.standard_normal()
    drift = c.drift_sigma_rad * rng.standard_normal()
    bias = GYRO_BIAS_SIGMA_RADPS * rng.standard_normal()
    pan_offset = c.pan_offset_sigma_rad * rng.standard_normal()
    common = c.range_offset_sigma * rng.standard_normal()
    true, stamp = Pose2(), 0.0
    start = Gaussian(rng.multivariate_normal(true.vector, STARTING), STARTING)
    instants, truth = [Instant(0.0)], [true]
    for k in range(1, frames):
        dt, root = (0.2 if k % 2 else 0.45), math.sqrt(0.5)
        told = Pose2(0.0225, 0.0, 3.0 * DEG * math.sin(k / 10))
        x = told.x + slip * 0.5 + c.step_x_sigma_m * root * rng.standard_normal()
        y = told.y + c.step_y_sigma_m * root * rng.standard_normal()
        turn = told.yaw + drift * 0.5 + c.step_yaw_sigma_rad * root * rng.standard_normal()
        true, stamp = true @ Pose2(x, y, turn), stamp + dt
        rate = turn / dt + bias + c.gyro_sigma_radps * rng.standard_normal()
        imu = Imu(np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, 9.81]))
        sightings = look(true, pan_offset, common, rng) if k % 4 == 0 else []
        common += RANGE_WALK * math.sqrt(dt) * rng.standard_normal()
        instants.append(Instant(stamp, StepOdometry(told, 0.5), imu, sightings))
        truth.append(true)
    return start, instants, truth


def look(true: Pose2, pan_offset: float, common: float, rng: np.random.Generator) -> list[Sighting]:
    pan = pan_offset + CONFIG.shared_bearing_sigma_rad * rng.standard_normal()
    seen = []
    for mark in MARKS:
        r, b = models.range_bearing(true.vector, np.array([mark.position[:2]]))
        if r < 3.0 and abs(b) < 0.9:
            P = np.diag([(0.01 * r) ** 2, CONFIG.shared_bearing_sigma_rad**2 + 0.002**2])
            long = 0.01 * r * (common + rng.standard_normal())
            seen.append(
                Sighting(
                    mark.identity, np.array([r + long, b + pan + 0.002 * rng.standard_normal()]), P
                )
            )
    return seen


def followed(robot: PoseFilter, instants: list[Instant]) -> list[Gaussian]:
    """The pose at every instant, as known then."""
    poses = [robot.pose]
    for before, now in itertools.pairwise(instants):
        robot.predict(now.odometry, now.imu, now.stamp_s - before.stamp_s)
        robot.update(now.sightings)
        poses.append(robot.pose)
    return poses


def errors(poses: list[Gaussian], truth: list[Pose2]) -> np.ndarray:
    found = np.array([pose.mean for pose in poses]) - np.array([pose.vector for pose in truth])
    found[:, 2] = models.wrap_angles(found[:, 2])
    return found


@pytest.fixture(scope="module")
def walks() -> dict[str, np.ndarray]:
    """Errors (50, frames, 3) and covariances of filter, fixed lag and batch over 50 walks."""
    kept: dict[str, list[np.ndarray]] = {}
    for seed in range(50):
        start, instants, truth = walk(seed)
        frames = walk_factors(instants, PLACES, CONFIG)
        everything = [factor for _, factors in frames for factor in factors]
        systematics = walk_systematics(CONFIG)
        lagging = SmootherConfig(lag_s=LAG_S)
        for name, poses in (
            ("filter", followed(PoseFilter(start, MARKS, CONFIG), instants)),
            ("live", followed(LaggedFilter(start, MARKS, LIVE), instants)),
            ("lag", smooth_fixed_lag(frames, start, systematics, lagging)),
            ("batch", smooth(everything, start, systematics)),
        ):
            kept.setdefault(name, []).append(errors(poses, truth))
            kept.setdefault(f"{name} P", []).append(np.array([pose.covariance for pose in poses]))
    return {name: np.array(values) for name, values in kept.items()}


def test_later_measurements_reduce_the_error_over_50_walks(walks):
    rmse = {
        name: np.sqrt(np.mean(walks[name][..., :2] ** 2)) for name in ("filter", "lag", "batch")
    }
    assert rmse["lag"] < 0.95 * rmse["filter"]
    assert rmse["batch"] < rmse["lag"]
    heading = {name: np.sqrt(np.mean(walks[name][..., 2] ** 2)) for name in ("filter", "lag")}
    assert heading["lag"] < heading["filter"]


@pytest.mark.parametrize("name", ["lag", "batch", "live"])
@pytest.mark.parametrize("frame", [8, 20, 32])
def test_marginals_are_consistent_over_50_walks(walks, name, frame):
    values = nees(walks[name][:, frame], walks[f"{name} P"][:, frame])
    low, high = band(3, 50, 0.99)  # nine of them: 91 % that all are inside
    assert low < np.mean(values) < high


def test_marginal_covariances_do_not_exceed_the_filter_s(walks):
    for axis in range(3):
        sure = np.mean(walks["batch P"][:, 5:-5, axis, axis])
        assert sure < np.mean(walks["filter P"][:, 5:-5, axis, axis])


def test_the_newest_pose_agrees_with_the_kalman_filter():
    rng = np.random.default_rng(1)
    firm = 1e-4
    start = Gaussian(np.zeros(3), np.diag([0.1, firm, firm]) ** 2)
    smoother = FixedLagSmoother(start, (), SmootherConfig(lag_s=0.5))
    smoother.update(0.0, [])
    mean, variance = 0.0, 0.1**2
    for k in range(1, 40):
        told = 0.1 + 0.05 * rng.standard_normal()
        factors: list[Factor] = [
            Motion(k - 1, k, Pose2(told, 0.0, 0.0), np.diag([0.05, firm, firm]) ** 2)
        ]
        mean, variance = mean + told, variance + 0.05**2
        if k % 5 == 0:
            seen = 0.1 * k + 0.03 * rng.standard_normal()
            place = Gaussian(np.array([seen, 0.0, 0.0]), np.diag([0.03, 0.1, 0.1]) ** 2)
            factors.append(PoseSeen(k, place))
            gain = variance / (variance + 0.03**2)
            mean, variance = mean + gain * (seen - mean), variance * (1 - gain)
        smoother.update(0.1 * k, factors)
        pose = smoother.pose(k)
        assert isinstance(pose, Gaussian)
        np.testing.assert_allclose([pose.mean[0]], [mean], atol=1e-5)
        np.testing.assert_allclose(pose.covariance[0, 0], variance, rtol=1e-3)
        assert len(smoother.window) <= 6


def test_a_lost_frame_does_not_begin_the_smoother_anew(caplog):
    """The time without odometry is one interval, the measured motion after it another."""
    start, instants, _ = walk(3, 24)
    robot = LaggedFilter(start, MARKS, LIVE)
    followed(robot, instants[:12])
    robot.predict(None, None, 0.65)
    robot.predict(instants[12].odometry, instants[12].imu, 0.2)
    robot.update(instants[12].sightings)
    assert not caplog.records
    assert len(robot._smoother.window) > 8


def test_with_an_infinite_lag_the_last_update_agrees_with_the_batch():
    start, instants, _ = walk(7)
    frames = walk_factors(instants, PLACES, CONFIG)
    smoother = FixedLagSmoother(start, walk_systematics(CONFIG), SmootherConfig(lag_s=math.inf))
    for stamp, factors in frames:
        smoother.update(stamp, factors)
    # The same losses; iSAM2 keeps linearised what has moved less than a millimetre since.
    whole = solve(
        [factor for _, factors in frames for factor in factors],
        start,
        walk_systematics(CONFIG),
        SmootherConfig(outliers="losses"),
    )
    for number in (0, 20, 35):
        pose, other = smoother.pose(number), whole.poses[number]
        deviations = np.sqrt(np.diag(other.covariance))
        assert np.all(np.abs(pose.mean - other.mean) < 0.05 * deviations)
        np.testing.assert_allclose(np.sqrt(np.diag(pose.covariance)), deviations, rtol=0.01)


def test_a_misread_tag_hardly_changes_the_trajectory():
    start, instants, truth = walk(11)
    spoilt = [
        Instant(
            one.stamp_s,
            one.odometry,
            one.imu,
            [
                Sighting(
                    (s.identity + 1) % 5 if k % 3 == 0 else s.identity, s.measured, s.covariance
                )
                for s in one.sightings[:1]
            ]
            + list(one.sightings[1:]),
        )
        for k, one in enumerate(instants)
    ]
    found = {}
    for name, told in (("clean", instants), ("spoilt", spoilt)):
        frames = walk_factors(told, PLACES, CONFIG)
        everything = [factor for _, factors in frames for factor in factors]
        poses = smooth(everything, start, walk_systematics(CONFIG))
        found[name] = np.sqrt(np.mean(errors(poses, truth)[:, :2] ** 2))
    assert found["spoilt"] < found["clean"] + 0.01


def test_without_sensors_the_uncertainty_grows():
    instants = [Instant(0.0)]
    instants += [Instant(0.3 * k, None, None) for k in range(1, 20)]
    instants += [Instant(6.0, StepOdometry(Pose2(math.nan, 0.0, 0.0), 0.5), None)]
    frames = walk_factors(instants, PLACES, CONFIG)
    poses = smooth([f for _, factors in frames for f in factors], Gaussian(np.zeros(3), STARTING))
    deviation = math.sqrt(poses[-1].covariance[0, 0])
    assert deviation >= NO_ODOMETRY_MPS * 6.0


def test_the_turn_by_legs_and_gyro_is_weighted_by_variance():
    told = StepOdometry(Pose2(0.02, 0.0, 0.05), 0.5)
    imu = Imu(np.array([0.0, 0.0, 0.1]), np.zeros(3))
    motion = step(CONFIG, 1, told, imu, 0.3).motion
    assert isinstance(motion, Pose2)
    legs, gyro = CONFIG.step_yaw_sigma_rad**2 * 0.5, 0.0006**2
    expected = (0.05 / legs + 0.03 / gyro) / (1 / legs + 1 / gyro)
    assert wrap_angle(motion.yaw - expected) == pytest.approx(0.0, abs=1e-9)


def test_poses_that_left_the_window_are_refused():
    start = Gaussian(np.zeros(3), STARTING)
    smoother = FixedLagSmoother(start, (), SmootherConfig(lag_s=1.0))
    smoother.update(0.0, [])
    noise = np.eye(3) * 1e-4
    for k in range(1, 8):
        smoother.update(0.4 * k, [Motion(k - 1, k, Pose2(0.1, 0.0, 0.0), noise)])
    assert min(smoother.window) > 0
    with pytest.raises(InputError, match="pose 0 is not in the window"):
        smoother.pose(0)
    with pytest.raises(InputError, match="not connected"):
        smoother.update(3.0, [Motion(0, 9, Pose2(), noise)])
    with pytest.raises(InputError, match="lies before"):
        smoother.update(1.0, [])


def test_live_the_newest_pose_is_as_good_as_the_filter_s(walks):
    """Robust losses cost a Gaussian error 5 % at most, by their width."""
    for axes in (slice(0, 2), slice(2, 3)):
        live, other = (np.sqrt(np.mean(walks[name][..., axes] ** 2)) for name in ("live", "filter"))
        assert live < 1.1 * other


@pytest.mark.parametrize("hz", [5, 30])
def test_live_without_odometry_is_as_uncertain_as_the_filter_at_any_frame_rate(hz):
    start = Gaussian(np.zeros(3), STARTING)
    robots = PoseFilter(start, MARKS, CONFIG), LaggedFilter(start, MARKS, LIVE)
    for robot in robots:
        for _ in range(4 * hz):
            robot.predict(None, None, 1.0 / hz)
            robot.update([])
    one, live = (np.sqrt(np.diag(robot.pose.covariance)) for robot in robots)
    assert live[0] == pytest.approx(math.hypot(NO_ODOMETRY_MPS * 4.0, 0.02), rel=0.01)
    np.testing.assert_allclose(live, one, rtol=0.1)


def test_live_the_noise_is_the_learnt_one():
    start = Gaussian(np.zeros(3), STARTING)
    sharp = {
        "slip_sigma_m": 1e-5,
        "lateral_slip_sigma_m": 1e-5,
        "drift_sigma_rad": 1e-5,
        "range_offset_sigma": 1e-5,
    }
    robots = (
        PoseFilter(start, MARKS, replace(CONFIG, **sharp)),
        LaggedFilter(start, MARKS, replace(LIVE, **sharp)),
    )
    for robot in robots:
        robot._turns.factor.value = robot._sightings_factor.value = 3.0
        for _ in range(20):
            robot.predict(StepOdometry(Pose2(), 1.0), None, 0.65)
            robot.update([])
    one, live = (np.sqrt(np.diag(robot.pose.covariance)) for robot in robots)
    np.testing.assert_allclose(live, one, rtol=0.05)
    for robot in robots:
        r, b = models.range_bearing(robot.pose.mean, np.array([MARKS[0].position[:2]]))
        robot.update([Sighting(0, np.array([r, b]).ravel(), np.diag([0.05, 2 * DEG]) ** 2)])
    one, live = (np.sqrt(np.diag(robot.pose.covariance)) for robot in robots)
    np.testing.assert_allclose(live, one, rtol=0.1)


def test_live_memory_is_bounded_and_the_pose_stays_right(monkeypatch):
    monkeypatch.setattr("perception.smoothing.lagged_filter.MOST_FRAMES", 10)
    found, claims = [], []
    for seed in range(20):
        start, instants, truth = walk(seed)
        robot = LaggedFilter(start, MARKS, LIVE)
        poses = followed(robot, instants)
        assert len(robot._given) <= 11
        found.append(errors(poses, truth))
        claims.append([pose.covariance for pose in poses])
    squares = nees(np.array(found)[:, -1], np.array(claims)[:, -1])
    low, high = band(3, 20)
    assert low < np.mean(squares) < high
    assert np.sqrt(np.mean(np.array(found)[:, -1, :2] ** 2)) < 0.05


def test_live_smoothing_begins_anew_at_a_state_that_was_set():
    """As by scan registration; the turn there is part of what the next frames go on from."""
    start, instants, _ = walk(3)
    robot = LaggedFilter(start, MARKS, LIVE)
    followed(robot, instants[:20])
    mean, P = robot.state.mean.copy(), robot.state.covariance
    mean[:3] += [0.5, -0.3, 0.2]
    robot.set_state(Gaussian(mean, P))
    np.testing.assert_allclose(robot.pose.mean, mean[:3])
    np.testing.assert_allclose(robot.pose.covariance, P[:3, :3])
    robot.predict(StepOdometry(Pose2(0.02, 0.0, 0.0), 0.5), None, 0.3)
    robot.update([])
    c, s = math.cos(mean[2]), math.sin(mean[2])
    assert robot.pose.mean[:2] == pytest.approx(mean[:2] + 0.02 * np.array([c, s]), abs=0.002)


def test_live_a_carried_robot_is_found_by_its_landmarks():
    start, instants, truth = walk(5)
    away = Gaussian(start.mean + np.array([1.2, 0.8, 0.9]), STARTING)
    robot = LaggedFilter(away, MARKS, LIVE)
    k = next(k for k, one in enumerate(instants) if len(one.sightings) >= 2)
    for _ in range(6):
        robot.predict(StepOdometry(Pose2(), 0.0), None, 0.3)
        robot.update(instants[k].sightings)
    here = truth[k]
    assert np.linalg.norm(robot.pose.mean[:2] - here.vector[:2]) < 0.1


def test_a_lag_shorter_than_some_frames_is_refused():
    with pytest.raises(ConfigError, match=r"lag_s=0\.2"):
        LocaliserConfig(lag_s=0.2)
