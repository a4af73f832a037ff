"""Capture point error after a push: against the pendulum, and on bodies that are pushed."""

import math

import numpy as np
import pytest

from perception.primitives.pose import Pose2
from planning.commands import WalkCommand
from sim.body.dynamic.balance import BalanceConfig
from sim.body.dynamic.capture import STEP_GAIN, CapturePoint
from sim.body.pendulum import pendulum

HEIGHT_M = 0.215
RECOVERS = BalanceConfig()
IGNORES = BalanceConfig(deadband_m=1.0, tipping_m=1.0)  # the trunk does not bend either
STIFF = BalanceConfig(bend_most_rad=(0.0, 0.0))


def errors_after(roll, pitch, roll_rate=0.0, pitch_rate=0.0, config=RECOVERS):
    point = CapturePoint(config, HEIGHT_M)
    for _ in range(60):
        point.update(np.array([roll, pitch]), np.array([roll_rate, pitch_rate]))
    return point


@pytest.mark.parametrize(("tilt", "rate"), [(0.02, 0.0), (0.0, 0.15), (0.03, -0.1), (-0.02, -0.2)])
def test_a_pendulum_over_its_capture_point_comes_to_rest(tilt, rate):
    """A pendulum over its capture point comes to rest there."""
    x, speed = HEIGHT_M * tilt, HEIGHT_M * rate
    ahead = errors_after(0.0, tilt, 0.0, rate).error[0]
    position, after = pendulum(x, speed, ahead, 0.9, HEIGHT_M)
    assert position == pytest.approx(ahead, abs=1e-3 * math.exp(-1))
    assert after == pytest.approx(0.0, abs=3e-3)
    left = errors_after(tilt, 0.0, rate, 0.0).error
    assert left == pytest.approx((0.0, -ahead))  # rolled to its right


def test_errors_in_the_dead_band_extend_no_step():
    for pitch in (-0.08, 0.08):  # 17 mm
        assert errors_after(0.0, pitch).step_extension_m == 0.0
    further = STEP_GAIN * (HEIGHT_M * 0.2 - RECOVERS.deadband_m)
    assert errors_after(0.0, 0.2).step_extension_m == pytest.approx(further)
    assert errors_after(0.0, -0.2).step_extension_m == pytest.approx(-further)


def test_the_side_of_a_fall_is_detected():
    for side in (-1, 1):
        assert errors_after(-side * 0.3, 0.0).is_falling_to(side)
        assert not errors_after(side * 0.3, 0.0).is_falling_to(side)
        assert not errors_after(-side * 0.1, 0.5).is_falling_to(side)


def test_landing_at_once_prevents_a_fall_towards_the_swing_foot(pushed):
    fallen = {
        balance: sum(
            pushed(balance, seed, WalkCommand(0.06), 0.2, math.pi / 2)[1] for seed in range(6)
        )
        for balance in (RECOVERS, IGNORES)
    }
    assert fallen[RECOVERS] <= 1
    assert fallen[IGNORES] >= 4


@pytest.mark.parametrize(("angle", "sign"), [(math.pi, -1.0), (0.0, 1.0)])
def test_the_step_after_a_push_goes_in_the_direction_of_the_push(pushed, angle, sign):
    quiet, _ = pushed(STIFF, 5, WalkCommand(0.03), 0.5, None, 7)
    moved, _ = pushed(STIFF, 5, WalkCommand(0.03), 0.5, angle, 7)
    ahead = [a.inverse() @ b for a, b in zip(quiet, moved, strict=True)]
    assert ahead[4] == Pose2()
    assert sign * ahead[6].x > 0.01
