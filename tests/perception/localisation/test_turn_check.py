"""Feet that slide and gyros that err for a while: doubted while it lasts, forgotten soon after."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.filtering.models import LATERAL_SLIP, SLIP
from perception.localisation.filter import PoseFilter
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2, wrap_angle

DEG = math.pi / 180
DT, STEPS, FORWARD_M = 0.325, 0.5, 0.03
BEGINS, ENDS, LAST = 60, 78, 120  # frames: the fault lasts for six seconds
GRAVITY = np.array([0.0, 0.0, 9.81])
DISAGREE = "gyro and steps disagree"
SIDEWAYS = 0.67  # share by which sliding feet claim more than was walked


def walked(
    seed: int,
    twist_deg: float = 0.0,
    bias_deg: float = 0.0,
    ends: int = ENDS,
    slips: float | None = None,
) -> tuple[PoseFilter, list[bool], np.ndarray, np.ndarray]:
    """Steps and gyro alone. In the fault feet slide, and turn by `twist_deg` a step, or the gyro adds `bias_deg` a second.

    Where it begins, one step slips by as many standard deviations as `slips` says.

    Returns:
        The filter at the end; of every frame: whether gyro and steps disagree, NEES of the pose, its largest sigma (m).
    """
    rng = np.random.default_rng(seed)
    true, start = Pose2(), np.diag([0.005, 0.005, 0.5 * DEG]) ** 2
    robot = PoseFilter(Gaussian(rng.multivariate_normal(np.zeros(3), start), start), ())
    drift, bias = rng.normal(0.0, 0.15 * DEG), rng.normal(0.0, 0.005)
    doubted, nees, sigmas = [], [], []
    for k in range(LAST):
        fault = BEGINS <= k < ends
        made = Pose2(FORWARD_M, 0.0, 3.0 * DEG * math.sin(k / 15))
        root = math.sqrt(STEPS)
        x, y, yaw = rng.normal(size=3)
        yaw = slips if slips is not None and k == BEGINS else yaw
        slip = Pose2(
            -0.0012 * STEPS + 0.0015 * root * x,
            0.0006 * root * y,
            drift * STEPS + 0.6 * DEG * root * yaw,
        )
        now = true @ made @ slip
        rate = wrap_angle(now.yaw - true.yaw) / DT + bias + 0.002 * rng.normal()
        true, told = now, made
        if fault:
            rate += bias_deg * DEG
        if fault and twist_deg:
            told = Pose2((1.0 + SIDEWAYS) * made.x, 0.0, made.yaw + twist_deg * DEG * STEPS)
        robot.predict(StepOdometry(told, STEPS), Imu(np.array([0.0, 0.0, rate]), GRAVITY), DT)
        doubted.append(DISAGREE in {one.words for one in robot.doubts()})
        pose = robot.pose
        off = true.vector - pose.mean
        off[2] = wrap_angle(off[2])
        nees.append(off @ np.linalg.solve(pose.covariance, off))
        sigmas.append(math.sqrt(np.linalg.eigvalsh(pose.covariance[:2, :2])[-1]))
    return robot, doubted, np.array(nees), np.array(sigmas)


@pytest.mark.parametrize("fault", [{"twist_deg": 4.0}, {"twist_deg": -4.0}, {"bias_deg": 10.0}])
@pytest.mark.parametrize("seed", range(6))
def test_a_fault_is_doubted_soon_and_no_longer_than_four_seconds_after_its_end(fault, seed):
    _, doubted, _, _ = walked(seed, **fault)
    assert not any(doubted[:BEGINS])
    assert any(doubted[BEGINS : BEGINS + round(2.0 / DT)])
    assert all(doubted[BEGINS + round(2.0 / DT) : ENDS])
    assert not any(doubted[ENDS + round(4.0 / DT) :])


def test_one_step_that_slips_is_seldom_a_fault():
    """A walk has thousands of steps, and one slips as far by chance."""
    doubts = [any(walked(seed, slips=slips)[1]) for seed in range(20) for slips in (4.1, -4.1)]
    assert np.mean(doubts) <= 0.1


@pytest.mark.parametrize("seed", range(6))
def test_a_fault_that_stays_is_not_forgotten(seed):
    _, doubted, _, _ = walked(seed, twist_deg=4.0, ends=LAST)
    assert all(doubted[BEGINS + round(2.0 / DT) :])


@pytest.mark.parametrize("fault", [{"twist_deg": 4.0}, {"bias_deg": 10.0}])
def test_the_pose_is_honest_from_the_alarm_on(fault):
    """In the mean of twelve walks; the first second of a fault is unnoticed and excepted."""
    nees = [walked(seed, **fault)[2][BEGINS + round(2.0 / DT) :].mean() for seed in range(12)]
    assert np.mean(nees) < 6.0  # 3 in expectation; twelve walks of lasting errors


@pytest.mark.parametrize("fault", [{"twist_deg": 4.0}, {"twist_deg": 2.0}, {"bias_deg": 10.0}])
def test_feet_that_no_longer_slide_slip_as_before(fault):
    """Whether the turns are suddenly as before, or drift and bias usual again: else a robot without landmarks is soon lost."""
    seen = 0
    for seed in range(6):
        robot, doubted, nees, _ = walked(seed, **fault)
        seen += any(doubted)
        assert not doubted[-1]
        slip, lateral = np.sqrt(np.diag(robot.state.covariance)[[SLIP, LATERAL_SLIP]])
        assert max(slip, lateral) < 0.001  # m a step; .5 and .2 mm when the walk begins
        assert nees[-1] < 16.3  # 99.9 % of chi-square with three degrees of freedom
    assert seen == 6


def test_the_path_before_an_alarm_is_doubted():
    """Feet slid before it was noticed: the position is uncertain by a share of what was walked then."""
    _, doubted, _, sigmas = walked(0, twist_deg=4.0)
    alarm = doubted.index(True)
    assert sigmas[alarm] > sigmas[alarm - 1] + 0.03
