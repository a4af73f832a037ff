"""Attitude, landing control and odometry against closed-form results."""

import math

import numpy as np
import pytest

from perception.primitives.pose import Pose2, wrap_angle
from planning.commands import WalkCommand
from sim.body.dynamic.anatomy import DARWIN
from sim.body.dynamic.balance import (
    GYRO_GAIN_S,
    LOWER_MOST_M,
    STANDING_SHARE,
    AnkleFeedback,
    Attitude,
    BalanceConfig,
    LandingControl,
)
from sim.body.dynamic.legs import Legs
from sim.body.dynamic.odometry import FootToFootOdometry
from sim.body.gait import Gait, GaitConfig
from sim.body.pendulum import GRAVITY_MPS2

TICK_S = 0.005


def upward(roll, pitch):
    """The vertical in the axes of a trunk rolled, then pitched (fixed axes)."""
    return np.array(
        [-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch)]
    )


def test_gyro_alone_tracks_the_vertical_in_a_rotating_trunk():
    attitude = Attitude(BalanceConfig(attitude_s=1e9), TICK_S)
    angle = 0.0
    for k in range(400):
        rate = 0.8 * math.cos(k * TICK_S)
        angle += rate * TICK_S
        attitude.update(np.array([0.0, rate, 0.0]), np.array([0.0, 0.0, 9.81]), np.zeros(2))
    assert attitude.tilt == pytest.approx((0.0, angle), abs=2e-3)


def test_at_rest_the_accelerometer_corrects_the_vertical_and_the_gyro_bias_is_estimated():
    attitude = Attitude(BalanceConfig(), TICK_S)
    bias = np.array([0.01, -0.02, 0.0])
    force = GRAVITY_MPS2 * upward(0.05, -0.03)
    for _ in range(8000):
        attitude.update(bias, force, np.zeros(2))
    assert attitude.tilt == pytest.approx((0.05, -0.03), abs=1e-4)
    np.testing.assert_allclose(attitude._bias[:2], bias[:2], atol=5e-4)


def test_planned_acceleration_does_not_tilt_the_vertical():
    attitude = Attitude(BalanceConfig(), TICK_S)
    for k in range(2000):
        sway = 1.5 * math.sin(2 * math.pi * 0.77 * k * TICK_S)
        attitude.update(np.zeros(3), np.array([0.0, sway, GRAVITY_MPS2]), np.array([0.0, sway]))
    assert attitude.tilt == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("upward_share", [0.5, -0.5])
def test_gear_chatter_does_not_tilt_the_vertical(upward_share):
    """Shocks forward and up, 5 m/s^2: each one tilts the estimate, their mean does not."""
    attitude = Attitude(BalanceConfig(), TICK_S)
    for k in range(4000):
        blow = 5.0 * (-1.0) ** k
        force = np.array([blow, 0.3 * blow, GRAVITY_MPS2 + upward_share * blow])
        attitude.update(np.zeros(3), force, np.zeros(2))
    assert attitude.tilt == pytest.approx((0.0, 0.0), abs=math.radians(0.1))


def test_a_hard_landing_does_not_tilt_the_vertical():
    attitude = Attitude(BalanceConfig(), TICK_S)
    attitude.update(np.zeros(3), np.array([60.0, -80.0, GRAVITY_MPS2]), np.zeros(2))
    assert math.hypot(*attitude.tilt) < math.radians(0.2)


def test_gyro_feedback_has_full_gain_only_while_walking():
    ticks = 100

    def turned(walking: bool) -> float:
        ankles = AnkleFeedback(TICK_S)
        for _ in range(ticks):
            angles = np.zeros(12)
            ankles.correct(angles, np.zeros(2), np.array([0.0, 0.2]), 0, walking)
        return float(angles[4])

    assert turned(True) == pytest.approx(0.2 * GYRO_GAIN_S)
    assert turned(False) == pytest.approx(0.2 * GYRO_GAIN_S * STANDING_SHARE)


def test_level_axes_undo_the_tilt():
    attitude = Attitude(BalanceConfig(), TICK_S)
    attitude.up = upward(0.1, -0.2)
    np.testing.assert_allclose(attitude.level() @ attitude.up, [0, 0, 1], atol=1e-12)
    # rotation about the vertical equals the yaw rate
    assert attitude.yaw_rate(0.7 * attitude.up) == pytest.approx(0.7, abs=1e-12)


def walking_step():
    gait = Gait(GaitConfig())
    gait.step(WalkCommand(0.04))
    return gait.step(WalkCommand(0.04))


def test_a_sole_that_lands_early_keeps_its_height():
    step, landing = walking_step(), LandingControl(BalanceConfig(), TICK_S)
    swinging = 0 if step.swing > 0 else 1
    touched = None
    for tick in range(step.double_support_ticks, step.ticks):
        early = tick >= step.ticks - 8
        landing.update(step, tick, 5.0 if early else 0.0)
        height = step.lift[tick] + landing.heights[swinging]
        if early and touched is None:
            touched = height
        if touched is not None:
            assert height == pytest.approx(max(touched, step.lift[tick]), abs=1e-12)
    assert touched is not None
    assert landing.heights[1 - swinging] == 0.0


def test_a_foot_that_lands_at_once_stops_at_the_floor():
    step, config = walking_step(), BalanceConfig()
    landing = LandingControl(config, TICK_S)
    swinging, heights = 0 if step.swing > 0 else 1, []
    first = step.double_support_ticks + 15  # the foot still rises
    for tick in range(first, step.ticks):
        landing.land_now()
        floor = bool(heights) and heights[-1] < 0.002
        landing.update(step, tick, 5.0 if floor else 0.0)
        heights.append(float(step.lift[tick] + landing.heights[swinging]))
        assert landing.landed_early(step) == floor
        if floor:
            assert heights[-1] == pytest.approx(stood, abs=1e-12)
        else:
            stood = heights[-1]
    assert -0.001 < stood < 0.002
    # the next step lands at its planned time
    landing.update(step, 0, 5.0)
    assert not landing.landed_early(step)


def test_a_foot_that_lands_at_once_over_a_hole_stops_at_the_limit():
    step, landing = walking_step(), LandingControl(BalanceConfig(), TICK_S)
    for tick in range(step.double_support_ticks, step.ticks):
        landing.land_now()
        landing.update(step, tick, 0.0)
        sole = step.lift[tick] + landing.heights[0 if step.swing > 0 else 1]
        assert sole >= -LOWER_MOST_M - 1e-12
    assert sole == pytest.approx(-LOWER_MOST_M)


def test_a_sole_without_contact_is_lowered_to_the_limit_only():
    step, most = walking_step(), LOWER_MOST_M
    landing = LandingControl(BalanceConfig(), TICK_S)
    standing = 1 if step.swing > 0 else 0
    for tick in range(step.double_support_ticks):
        landing.update(step, tick, 0.0)
        lowered = -min(0.03 * TICK_S * (tick + 1), most)  # less the decay
        assert lowered - 1e-12 <= landing.heights[standing] <= 0.85 * lowered
    assert landing.must_wait(step, 0, 0.0)
    assert not landing.must_wait(step, 0, 10.0)
    assert not landing.must_wait(step, 1, 0.0)


def test_waiting_for_a_landing_is_limited():
    step, landing = walking_step(), LandingControl(BalanceConfig(wait_s=0.1), TICK_S)
    waited = 0
    while landing.must_wait(step, 0, 0.0):
        waited += 1
    assert waited == 20


def test_foot_to_foot_odometry_is_exact_without_slip():
    legs, gait = Legs(DARWIN), Gait(GaitConfig())
    rng = np.random.default_rng(5)
    angles = legs.stand(np.zeros(2), GaitConfig().stance_width_m)
    odometry = FootToFootOdometry(legs.footprints(angles))
    for _ in range(12):
        step = gait.step(WalkCommand(*rng.uniform([-0.02, -0.02, -0.2], [0.06, 0.02, 0.2])))
        pelvis = legs.pelvis_trajectory(step, angles, 0.005, DARWIN.hip_m)
        left, right = legs.ankles(step)
        for k in range(step.ticks):
            angles = legs.solve(pelvis[k], left[k], right[k])
            if 2 * k >= step.double_support_ticks:
                odometry.set_stance(legs.footprints(angles), -step.swing)
        there = odometry.body(legs.footprints(angles))
        x, y, yaw = step.body[-1]
        assert (there.x, there.y) == pytest.approx((x, y), abs=1e-9)
        assert wrap_angle(there.yaw - yaw) == pytest.approx(0.0, abs=1e-9)
    assert odometry.pelvis(legs.footprints(angles)) != Pose2()
