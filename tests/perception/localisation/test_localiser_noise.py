"""The noise of the walking robot's motion: variances of intervals add, and the slip turns with the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.filtering.models import DRIFT, GYRO_BIAS, LATERAL_SLIP, PAN, RANGE, SLIP, TURN, YAW
from perception.localisation.localiser_noise import LocaliserConfig, process_noise

CONFIG = LocaliserConfig()


def parts(Q):
    """Without the floors that keep a covariance positive."""
    found = Q.copy()
    found[PAN, PAN] = 0.0
    return found


@pytest.mark.parametrize("steps", [0.0, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("dt", [0.05, 0.65])
def test_the_noise_of_two_intervals_is_that_of_one_as_long_as_both(steps, dt):
    """A random walk: the variance is proportional to the steps, to the time while the robot stands, or to both."""
    one, both = (
        process_noise(CONFIG, 0.4, steps, dt, None),
        process_noise(CONFIG, 0.4, 2 * steps, 2 * dt, None),
    )
    np.testing.assert_allclose(parts(both), 2.0 * parts(one), rtol=1e-12)
    assert (np.linalg.eigvalsh(one + 1e-20 * np.eye(10)) > -1e-18).all()


def test_without_odometry_the_deviation_grows_with_the_time():
    """A robot that walks on at one unknown speed: after t its deviation is speed times t, however t is cut."""
    whole = process_noise(CONFIG, 0.3, 0.0, 2.0, 0.0)
    cut = process_noise(CONFIG, 0.3, 0.0, 0.5, 0.0) + process_noise(CONFIG, 0.3, 0.0, 1.5, 0.5)
    np.testing.assert_allclose(parts(cut), parts(whole), rtol=1e-12, atol=1e-15)
    twice = process_noise(CONFIG, 0.3, 0.0, 4.0, 0.0)
    for entry in (0, 1, YAW):
        assert twice[entry, entry] == pytest.approx(4.0 * whole[entry, entry])
    assert 0.05 < math.sqrt(whole[0, 0]) / 2.0 < 0.2  # a walking speed, m/s


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0, math.pi])
def test_a_step_slips_along_and_across_its_heading(yaw):
    Q = process_noise(CONFIG, yaw, 4.0, 2.0, None)
    ahead, left = (
        np.array([math.cos(yaw), math.sin(yaw)]),
        np.array([-math.sin(yaw), math.cos(yaw)]),
    )
    assert ahead @ Q[:2, :2] @ ahead == pytest.approx(4.0 * CONFIG.step_x_sigma_m**2)
    assert left @ Q[:2, :2] @ left == pytest.approx(4.0 * CONFIG.step_y_sigma_m**2)
    assert ahead @ Q[:2, :2] @ left == pytest.approx(0.0, abs=1e-18)
    assert Q[YAW, YAW] == pytest.approx(4.0 * CONFIG.step_yaw_sigma_rad**2)
    assert Q[YAW, YAW] == Q[TURN, TURN] == Q[YAW, TURN]  # one and the same turn


def test_a_robot_that_stands_drifts_less_than_one_that_walks():
    stands, walks = (
        process_noise(CONFIG, 0.0, 0.0, 2.0, None),
        process_noise(CONFIG, 0.0, 3.0, 2.0, None),
    )
    for entry, sigma in (
        (0, CONFIG.still_sigma_m),
        (1, CONFIG.still_sigma_m),
        (YAW, CONFIG.still_sigma_rad),
    ):
        assert stands[entry, entry] == pytest.approx(2.0 * sigma**2)
        assert stands[entry, entry] < walks[entry, entry]
    for entry in (SLIP, LATERAL_SLIP, DRIFT):  # of the steps only
        assert stands[entry, entry] == 0.0 < walks[entry, entry]
    for entry in (GYRO_BIAS, RANGE):  # with the time only
        assert stands[entry, entry] == walks[entry, entry] > 0.0
