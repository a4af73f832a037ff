"""Parts of the self-localisation experiment, on synthetic data and on short parts of real recordings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.planar.config import PlanarConfig
from perception.planar.planar import filter_journey
from perception.primitives.gaussian import Gaussian
from surefoot.experiments.real.planar_smoother import smooth_journey
from surefoot.experiments.real.range_only import follow_ranges
from surefoot.experiments.real.robot_run import RobotRun, run_errors
from surefoot.experiments.real.robot_tracks import RobotTracks
from surefoot.experiments.real.tilt_filter import GRAVITY, TiltFilter, tilt
from surefoot.recordings.plaza import RangeLog

SURE = Gaussian(np.zeros(3), np.diag([0.01, 0.01, 0.005]) ** 2)


def seen(config: PlanarConfig, x: float, y: float) -> np.ndarray:
    return np.array([config.offset + config.scale * x, math.atan2(y, x)])


def test_a_track_is_confirmed_after_enough_sightings():
    config, rng = PlanarConfig(), np.random.default_rng(0)
    tracks = RobotTracks(config)
    found = []
    for k in range(40):
        noise = rng.normal(size=2) * [0.02, 0.004]
        found.append(tracks.update(2, 0.3 * k, seen(config, 2.0 + 0.02 * k, 0.5) + noise, SURE))
    assert found[:3] == [None] * 3
    assert found[-1].mean[0] == pytest.approx(2.0 + 0.02 * 39, abs=0.08)
    assert found[-1].mean[2] == pytest.approx(0.02 / 0.3, abs=0.05)
    assert tracks.rejected == 0


def test_a_misread_tag_does_not_move_a_track():
    config = PlanarConfig()
    tracks = RobotTracks(config)
    for k in range(20):
        tracks.update(2, 0.3 * k, seen(config, 2.0, 0.5), SURE)
    assert tracks.update(2, 6.1, seen(config, 5.0, -1.5), SURE) is None
    assert tracks.update(2, 6.3, seen(config, 5.0, -1.5), SURE) is None
    assert tracks.rejected == 2
    there = tracks.update(2, 6.5, seen(config, 2.0, 0.5), SURE)
    np.testing.assert_allclose(there.mean[:2], [2.0, 0.5], atol=0.1)


def test_a_track_restarts_after_several_consistent_sightings_elsewhere():
    config = PlanarConfig()
    tracks = RobotTracks(config)
    for k in range(20):
        tracks.update(2, 0.3 * k, seen(config, 2.0, 0.5), SURE)
    found = [tracks.update(2, 6.0 + 0.3 * k, seen(config, 5.0, -1.5), SURE) for k in range(12)]
    np.testing.assert_allclose(found[-1].mean[:2], [5.0, -1.5], atol=0.2)


def test_a_tilted_imu_at_rest_estimates_the_vertical_and_its_gyro_bias():
    rng = np.random.default_rng(1)
    up = np.array([0.9, 0.1, -0.4]) / np.linalg.norm([0.9, 0.1, -0.4])
    bias = np.array([0.01, -0.02, 0.05])
    robot = TiltFilter(GRAVITY * up + 0.5 * rng.normal(size=3))
    for _ in range(300):
        force = GRAVITY * up + 0.05 * rng.normal(size=3)
        robot.advance(bias + 0.005 * rng.normal(size=3), force, 0.02, rests=True)
    assert math.degrees(math.acos(float(robot.up @ up))) < 0.3
    np.testing.assert_allclose(robot.biases[0], bias, atol=0.01)


def test_the_gyro_keeps_the_vertical_during_vibration():
    """A rotation of twenty degrees about the first axis with random forces."""
    rng, dt = np.random.default_rng(2), 0.02
    robot = TiltFilter(np.array([0.0, 0.0, GRAVITY]))
    for _ in range(150):
        robot.advance(np.zeros(3), np.array([0.0, 0.0, GRAVITY]), dt, rests=True)
    rate = math.radians(20.0) / (50 * dt)
    for _ in range(50):
        robot.advance(np.array([rate, 0.0, 0.0]), rng.normal(size=3) * 8.0, dt)
    angle = math.radians(20.0)
    assert float(robot.up @ [0.0, math.sin(angle), math.cos(angle)]) > math.cos(math.radians(2.0))


def test_the_scale_of_long_ranges_and_the_path_are_estimated():
    rng = np.random.default_rng(3)
    places = np.array([[-30.0, 0.0], [20.0, -20.0], [25.0, 30.0]])
    n, truth, rows = 1500, [np.zeros(4)], []
    for k in range(1, n):
        t, x, y, yaw = truth[-1]
        yaw += 0.02
        truth.append(
            np.array([t + 0.2, x + 0.2 * math.cos(yaw - 0.01), y + 0.2 * math.sin(yaw - 0.01), yaw])
        )
        if k % 3 == 0:
            far = np.hypot(*(truth[-1][1:3] - places[k % 9 // 3]))
            long = 15.0 if k % 60 == 0 else 0.0  # multipath
            rows.append((truth[-1][0], k % 9 // 3, 1.08 * far + long + 0.3 * rng.normal()))
    odometry = np.array([(row[0], 0.2 * 1.002 + 0.002 * rng.normal(), 0.02) for row in truth[1:]])
    stamps, beacons, ranges = (np.array(column) for column in zip(*rows, strict=True))
    log = RangeLog(odometry, stamps, beacons.astype(np.int64), ranges, places, np.array(truth))
    found = follow_ranges(log)
    assert found.rmse_m < 0.25
    assert found.scale == pytest.approx(1.08, abs=0.01)
    assert 0.04 < found.rejected_share < 0.08


def test_the_first_minutes_of_a_real_robot_are_accurate(recordings):
    """With default parameters the error is a few decimetres, and smoothing reduces it further."""
    run = RobotRun.read(recordings / "mrclam6", 3)
    short = RobotRun(
        run.log, run.places, run.subjects, run.truth,
        run.start_s, run.start_s + 250.0,
    )  # fmt: skip
    instants = short.instants()
    found = filter_journey(short.journey(instants, 0.2))
    errors = run_errors(short, instants, found.means, found.covariances)
    assert errors.rmse_m < 0.15
    assert errors.heading_deg < 2.0
    assert short.dead_reckoning() > 0.5
    seconds = short.seconds()
    journey = short.journey(seconds, 0.2)
    means, covariances = smooth_journey(journey, filter_journey(journey), PlanarConfig())
    assert short.rmse_between(seconds, means) < errors.rmse_m
    np.linalg.cholesky(covariances)


def test_the_vertical_of_a_real_imu_is_accurate(recordings):
    found = tilt(recordings / "euroc_v101_stereo")
    assert found.rest_deg < 1.0
    assert found.flight_deg < 5.0
    np.testing.assert_allclose(
        found.gyro_bias, [-0.002, 0.021, 0.077], atol=0.01
    )  # V1_01, published
