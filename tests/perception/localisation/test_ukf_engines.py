"""filterpy and the compiled square-root filter give the same estimates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.filtering import models
from perception.localisation.filter import PoseFilter
from perception.localisation.localiser_noise import LocaliserConfig
from perception.localisation.ukf_engines import ENGINES, measure_all, predict_all, ukf_engine
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.pose import Pose2

MARKS = [
    Landmark(i, (x, y, 0.4), 0.16)
    for i, (x, y) in enumerate([(2.0, 1.0), (-2.0, 0.5), (0.5, -2.0)])
]
UP = np.array([0.0, 0.0, 9.81])


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_both_engines_give_the_same_estimates(seed):
    """Turns, sightings, gyro, gaps in all of them and a kidnapping: the same to the last digits."""
    rng = np.random.default_rng(seed)
    start = Gaussian(np.append(rng.normal(size=2) * 0.1, rng.uniform(-3, 3)), np.eye(3) * 1e-3)
    robots = [PoseFilter(start, MARKS, LocaliserConfig(engine=name)) for name in ENGINES]
    true = Pose2(*start.mean.tolist())
    for k in range(40):
        step = Pose2(0.03, 0.0, rng.uniform(-0.2, 0.2))
        true = true @ step if k != 20 else Pose2(0.5, 0.5, true.yaw + 1.0)
        odometry = StepOdometry(step, 0.5) if rng.random() < 0.9 else None
        imu = Imu(np.array([0.0, 0.0, step.yaw / 0.3]), UP) if rng.random() < 0.8 else None
        seen = []
        for mark in MARKS:
            measured = models.range_bearing(true.vector, np.array([mark.position[:2]]))
            if rng.random() < 0.5:
                noise = rng.normal(size=2) * [0.02, 0.01]
                told = mark.identity if rng.random() < 0.8 else None
                seen.append(Sighting(told, measured + noise, np.diag([0.02, 0.01]) ** 2))
        reports = []
        for robot in robots:
            robot.predict(odometry, imu, 0.3)
            reports.append(robot.update(seen))
        assert reports[0].accepted == reports[1].accepted
        np.testing.assert_allclose(reports[0].nis, reports[1].nis, rtol=1e-5)
        apart = models.walker_difference(robots[0].state.mean, robots[1].state.mean)
        assert np.abs(apart).max() < 1e-8
        ours, peer = (robot.state.covariance for robot in robots)
        sigma = np.sqrt(np.diag(peer))
        assert np.abs((ours - peer) / np.outer(sigma, sigma)).max() < 1e-5


@given(st.integers(0, 2**32 - 1), st.floats(-0.3, 0.3), st.floats(0.0, 1.0))
def test_vectorised_models_agree_with_the_scalar_models(seed, turn, steps):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(5, models.WALKER_SIZE))
    motion, places, sigmas = Pose2(0.05, 0.01, turn), rng.normal(size=(3, 2)), rng.uniform(size=3)
    for point, moved, seen in zip(
        points, predict_all(points, motion, steps), measure_all(points, places, sigmas), strict=True
    ):
        assert (
            np.abs(models.walker_difference(moved, models.walk(point, 0.0, motion, steps))).max()
            < 1e-12
        )
        expected = models.sighted(point, places, sigmas)
        assert np.abs(models.sighting_difference(seen, expected)).max() < 1e-12


@pytest.mark.parametrize("name", ENGINES)
def test_the_initial_state_is_returned_unchanged(name):
    mean = np.arange(float(models.WALKER_SIZE)) / 10.0
    P = np.diag(mean + 0.1) * 1e-3
    believed = ukf_engine(name, Gaussian(mean, P)).state
    np.testing.assert_allclose(believed.mean, mean)
    np.testing.assert_allclose(believed.covariance, P, rtol=1e-12)


def test_an_unknown_engine_is_refused():
    with pytest.raises(ConfigError, match="engine='fast' is unknown; choose compiled, filterpy"):
        LocaliserConfig(engine="fast")
    with pytest.raises(ConfigError, match="unknown"):
        ukf_engine("fast", Gaussian(np.zeros(models.WALKER_SIZE), np.eye(models.WALKER_SIZE)))


def test_the_compiled_engine_survives_a_nearly_singular_covariance():
    """A thousand noise-free sightings while standing: the covariance stays tiny, positive and finite."""
    robot = PoseFilter(Gaussian(np.zeros(3), np.eye(3) * 1e-4), MARKS)
    exact = [
        Sighting(
            m.identity,
            models.range_bearing(np.zeros(3), np.array([m.position[:2]])),
            np.eye(2) * 1e-18,
        )
        for m in MARKS
    ]
    for _ in range(1000):
        robot.update(exact)
    P = robot.state.covariance
    sigma = np.sqrt(np.diag(P))
    assert np.all(np.isfinite(P))
    assert np.linalg.eigvalsh(P / np.outer(sigma, sigma)).min() > -1e-14
    assert math.hypot(*robot.pose.mean[:2]) < 1e-3
