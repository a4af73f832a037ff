"""The pose filter on simulated walks: accurate, consistent and robust."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.filtering import models
from perception.filtering.consistency import band, nees
from perception.localisation.filter import PoseFilter, UpdateReport
from perception.localisation.localiser_noise import (
    GYRO_BIAS_SIGMA_RADPS,
    LocaliserConfig,
    joint_noise,
    process_noise,
)
from perception.localisation.ukf_engines import ENGINES
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.pose import Pose2, wrap_angle

DEG = math.pi / 180
MARKS = [
    Landmark(i, (x, y, 0.45), 0.16)
    for i, (x, y) in enumerate([(1.5, 1.5), (3.0, -1.5), (0.0, -1.6), (4.2, 0.5), (2.5, 2.0)])
]
STARTING = np.diag([0.02, 0.02, 2 * DEG]) ** 2
GRAVITY = np.array([0.0, 0.0, 9.81])


@dataclass
class Walk:
    """Errors (frames, 3), covariances (frames, 3, 3) and reports of a walk with ground truth."""

    errors: np.ndarray
    covariances: np.ndarray
    reports: list[UpdateReport]
    filter: PoseFilter

    @property
    def nees(self) -> np.ndarray:
        return nees(self.errors, self.covariances)


class Walker:
    """A robot with step noise: ground truth and its measurements.

    Forward slip -1.2 +- 1.5 mm a step, lateral 0.6 mm, heading: up to 0.2 deg a step for the whole run and 0.6 deg
    that are new at every step. The head has a pan offset of 0.3 deg, the ranges a common bias of half their
    standard deviation. Two frames a step; the robot stands for the first six.
    """

    def __init__(self, seed: int, noise: float = 1.0) -> None:
        """Every error times `noise`; sightings claim what they have at 1."""
        self.rng = np.random.default_rng(seed)
        self.true = Pose2()
        self.noise = noise
        self.drift = noise * self.rng.uniform(-0.2, 0.2) * DEG
        self.gyro_bias = noise * self.rng.normal() * 0.005
        self.pan_offset = noise * self.rng.normal() * 0.3 * DEG
        self.common = noise * self.rng.normal() * 0.7
        self.lateral_slip = 0.0  # m a step to the left
        self.frame = 0

    def step(self) -> tuple[StepOdometry, Imu, float]:
        dt = 0.2 if self.frame % 2 else 0.45
        steps = 0.0 if self.frame < 6 else 0.5
        told = Pose2()
        slip = Pose2()
        if steps:
            told = Pose2(0.0225, 0.0, 3.0 * DEG * math.sin(self.frame / 20))
            root = self.noise * math.sqrt(steps)
            slip = Pose2(
                -0.0012 * steps + 0.0015 * root * self.rng.normal(),
                self.lateral_slip * steps + 0.0006 * root * self.rng.normal(),
                self.drift * steps + 0.6 * DEG * root * self.rng.normal(),
            )
        now = self.true @ told @ slip
        rate = wrap_angle(now.yaw - self.true.yaw) / dt
        rate += self.gyro_bias + 0.002 * self.noise * self.rng.normal()
        self.true = now
        self.frame += 1
        return StepOdometry(told, steps), Imu(np.array([0.0, 0.0, rate]), GRAVITY), dt

    def look(self, reach_m: float = 2.5) -> list[Sighting]:
        """Landmarks ahead, all with the same pan error."""
        pan = self.pan_offset + 0.4 * DEG * self.noise * self.rng.normal()
        seen = []
        for mark in MARKS:
            r, b = models.range_bearing(self.true.vector, np.array([mark.position[:2]]))
            if r < reach_m and abs(b) < 0.9:
                P = np.diag([(0.01 * r) ** 2, (0.4 * DEG) ** 2 + 0.001**2])
                long = 0.01 * r * (self.common + self.noise * self.rng.normal())
                noise = [long, pan + 0.001 * self.noise * self.rng.normal()]
                seen.append(Sighting(mark.identity, np.array([r, b]) + noise, P))
        return seen


Spoil = Callable[[int, list[Sighting], np.random.Generator], list[Sighting]]


def walk(
    seed: int,
    frames: int = 120,
    landmarks: bool = True,
    gyro: bool = True,
    spoil: Spoil | None = None,
    config: LocaliserConfig | None = None,
    noise: float = 1.0,
    reach_m: float = 2.5,
) -> Walk:
    """Walk and filter; `spoil` may change the sightings of a frame."""
    walker = Walker(seed, noise)
    start = walker.rng.multivariate_normal(walker.true.vector, STARTING)
    robot = PoseFilter(Gaussian(start, STARTING), MARKS, config)
    errors, covariances, reports = [], [], []
    for k in range(frames):
        odometry, imu, dt = walker.step()
        robot.predict(odometry, imu if gyro else None, dt)
        if landmarks:
            seen = walker.look(reach_m)
            reports.append(robot.update(spoil(k, seen, walker.rng) if spoil else seen))
        error = robot.pose.mean - walker.true.vector
        error[2] = wrap_angle(float(error[2]))
        errors.append(error)
        covariances.append(robot.pose.covariance)
    return Walk(np.array(errors), np.array(covariances), reports, robot)


@pytest.fixture(scope="module")
def walks() -> list[Walk]:
    return [walk(seed, frames=80) for seed in range(14)]


def test_with_landmarks_the_error_agrees_with_the_covariance(walks):
    low, high = band(3, len(walks))
    assert low < np.mean([w.nees.mean() for w in walks]) < high
    at_the_end = np.mean([w.nees[-1] for w in walks])
    assert low < at_the_end < high


@pytest.mark.parametrize("noise", [0.5, 1.5])
def test_noise_that_is_half_or_one_and_a_half_times_as_large_is_learnt(noise):
    """The claimed covariance would make the NEES .25 or 2.25 per degree of freedom, times that of the usual noise, .7.

    The errors here are all new in every frame, so that the smaller ones are still claimed too large.
    """
    runs = [walk(seed, frames=200, noise=noise, reach_m=6.0) for seed in range(6)]
    assert 0.4 < np.mean([w.nees[100:].mean() for w in runs]) / 3.0 < 2.0
    learnt = (
        np.mean([w.filter.noise.step_x_sigma_m for w in runs]) / LocaliserConfig().step_x_sigma_m
    )
    assert learnt < 0.85 if noise < 1.0 else learnt > 1.1


@pytest.mark.parametrize("noise", [0.5, 1.5])
def test_the_noise_of_steps_is_learnt_from_the_gyro_alone(noise):
    runs = [walk(seed, frames=120, landmarks=False, noise=noise) for seed in range(8)]
    learnt = (
        np.mean([w.filter.noise.step_x_sigma_m for w in runs]) / LocaliserConfig().step_x_sigma_m
    )
    assert learnt == pytest.approx(noise, abs=0.25)
    assert 0.4 < np.mean([w.nees[60:].mean() for w in runs]) / 3.0 < 2.0


def test_noise_that_is_as_claimed_stays_so(walks):
    learnt = [w.filter.noise.gyro_sigma_radps for w in walks]
    assert np.mean(learnt) == pytest.approx(LocaliserConfig().gyro_sigma_radps, rel=0.1)


def test_with_landmarks_the_position_error_is_centimetres(walks):
    errors = np.concatenate([w.errors[20:] for w in walks])
    assert np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))) < 0.03
    assert np.sqrt(np.mean(errors[:, 2] ** 2)) < 1.0 * DEG


def test_normalised_innovations_are_chi_square(walks):
    values = np.concatenate([r.nis for w in walks for r in w.reports])
    assert len(values) > 450
    # sightings of one frame share an error: count frames, not sightings
    frames = sum(1 for w in walks for r in w.reports if r.nis)
    low, high = band(2, frames // 2, 0.999)
    assert low < values.mean() < high
    assert np.mean(values > 13.8) < 0.004  # one in a thousand expected


@pytest.mark.parametrize("gyro", [True, False])
def test_dead_reckoning_is_consistent_and_its_covariance_grows(gyro):
    runs = [walk(seed, frames=80, landmarks=False, gyro=gyro) for seed in range(100, 110)]
    low, high = band(3, len(runs))
    assert low < np.mean([w.nees[-1] for w in runs]) < high
    assert runs[0].covariances[-1][0, 0] > runs[0].covariances[10][0, 0]


def test_the_gyro_reduces_the_heading_uncertainty():
    def heading(gyro: bool) -> float:
        runs = [walk(seed, frames=60, landmarks=False, gyro=gyro) for seed in range(3)]
        return float(np.mean([w.covariances[-1][2, 2] for w in runs]))

    assert heading(True) < 0.3 * heading(False)


def test_drift_and_gyro_bias_are_estimated():
    walker = Walker(3)
    robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
    for _ in range(160):
        odometry, imu, dt = walker.step()
        robot.predict(odometry, imu, dt)
        robot.update(walker.look())
    state = robot.state
    for entry, true, before in (
        (models.DRIFT, walker.drift, LocaliserConfig().drift_sigma_rad),
        (models.GYRO_BIAS, walker.gyro_bias, GYRO_BIAS_SIGMA_RADPS),
    ):
        sigma = math.sqrt(state.covariance[entry, entry])
        assert sigma < 0.6 * before
        assert abs(state.mean[entry] - true) < 3.5 * sigma


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("lateral_slip_m", [-0.001, 0.001])
def test_landmarks_make_lateral_slip_observable(lateral_slip_m, engine):
    """A lateral slip must not be mistaken for a heading error."""
    config = LocaliserConfig(lateral_slip_sigma_m=0.0008, engine=engine)
    learnt, errors, covariances = [], [], []
    for seed in range(8):
        walker = Walker(seed)
        walker.lateral_slip = lateral_slip_m
        robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS, config)
        for _ in range(120):
            odometry, imu, dt = walker.step()
            robot.predict(odometry, imu, dt)
            robot.update(walker.look())
        state = robot.state
        errors.append(robot.pose.mean - walker.true.vector)
        errors[-1][2] = wrap_angle(float(errors[-1][2]))
        covariances.append(robot.pose.covariance)
        learnt.append(
            (
                state.mean[models.LATERAL_SLIP],
                math.sqrt(state.covariance[models.LATERAL_SLIP, models.LATERAL_SLIP]),
            )
        )
    means, sigmas = np.array(learnt).T
    assert (sigmas < 0.8 * config.lateral_slip_sigma_m).all()
    assert (np.abs(means - lateral_slip_m) < 3.5 * sigmas).all()
    assert np.mean(np.sign(means) == np.sign(lateral_slip_m)) >= 0.75
    assert np.mean(nees(np.array(errors), np.array(covariances))) < 6.4  # 3, of eight; 99.9 % below


def test_process_noise_of_standing_differs_from_walking():
    """The soles settle while standing, which is no noise of walking."""
    config = LocaliserConfig(still_sigma_m=0.01, still_sigma_rad=0.1)
    walking = process_noise(config, 0.0, 0.5, 0.325, None)
    standing = process_noise(config, 0.0, 0.0, 0.325, None)
    assert walking[0, 0] == pytest.approx(0.5 * config.step_x_sigma_m**2)
    assert walking[2, 2] == pytest.approx(0.5 * config.step_yaw_sigma_rad**2)
    assert standing[0, 0] == pytest.approx(0.325 * 0.01**2)
    assert standing[2, 2] == pytest.approx(0.325 * 0.1**2)


def test_the_heading_wraps_without_a_jump():
    robot = PoseFilter(Gaussian(np.array([0.0, 0.0, math.pi - 0.02]), STARTING), MARKS)
    for _ in range(6):
        robot.predict(StepOdometry(Pose2(0.0, 0.0, 0.01), 0.5), None, 0.3)
    assert abs(wrap_angle(robot.pose2.yaw - (math.pi + 0.04))) < 1e-6
    assert robot.pose.covariance[2, 2] < (5 * DEG) ** 2


def test_a_prediction_agrees_with_monte_carlo():
    """Unscented against sampled, with a heading uncertainty of five degrees."""
    rng = np.random.default_rng(1)
    config = LocaliserConfig()
    robot = PoseFilter(Gaussian(np.zeros(3), np.diag([0.01, 0.01, 0.09]) ** 2), [], config)
    before = robot.state
    motion, n = Pose2(0.3, 0.05, 0.2), 20000
    cloud = rng.multivariate_normal(before.mean, before.covariance, size=n)
    moved = np.array([models.walk(s, 0.3, motion, 1.0) for s in cloud])
    moved += rng.multivariate_normal(
        np.zeros(models.WALKER_SIZE), process_noise(config, 0.0, 1.0, 0.3, None), n
    )
    robot.predict(StepOdometry(motion, 1.0), None, 0.3)
    P = robot.pose.covariance
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(robot.pose.mean, moved[:, :3].mean(axis=0), atol=4e-3)
    size = np.outer(sigma, sigma)
    np.testing.assert_allclose(P / size, np.cov(moved[:, :3].T) / size, atol=0.06)


def test_with_a_certain_heading_it_is_the_linear_kalman_filter():
    """With small angles everything is linear: the gain is P H^T S^-1."""
    P0 = np.diag([0.05, 0.03, 0.001]) ** 2
    place = np.array([[2.0, 0.0]])
    exact = LocaliserConfig(pan_offset_sigma_rad=1e-9, range_offset_sigma=1e-9)
    robot = PoseFilter(Gaussian(np.zeros(3), P0), [Landmark(0, (2.0, 0.0, 0.4), 0.16)], exact)
    R = np.diag([0.02, 0.01]) ** 2
    measured = np.array([1.98, 0.005])
    H = np.array([[-1.0, 0.0, 0.0], [0.0, -0.5, -1.0]])
    K = P0 @ H.T @ np.linalg.inv(H @ P0 @ H.T + R)
    expected = K @ (measured - models.range_bearing(np.zeros(3), place))
    robot.update([Sighting(0, measured, R)])
    np.testing.assert_allclose(robot.pose.mean, expected, atol=3e-4)
    np.testing.assert_allclose(robot.pose.covariance, P0 - K @ H @ P0, atol=1e-5)


def test_many_tags_in_one_frame_do_not_average_out_the_pan_error():
    marks = [Landmark(i, (3.0, -1.0 + 0.2 * i, 0.4), 0.16) for i in range(10)]
    robot = PoseFilter(Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 0.2]) ** 2), marks)
    P = np.diag([0.05**2, (0.4 * DEG) ** 2 + 0.0005**2])
    robot.update(
        [
            Sighting(m.identity, models.range_bearing(np.zeros(3), np.array([m.position[:2]])), P)
            for m in marks
        ]
    )
    heading = math.sqrt(robot.pose.covariance[2, 2])
    assert (
        0.49 * DEG < heading < 0.55 * DEG
    )  # the frame's 0.4 and the joint's 0.3, squared and added


def test_landmarks_that_share_their_bearing_error_are_doubted_as_seldom_as_the_test_says():
    """Four landmarks a frame, errors as claimed: 300 runs of 5 windows, each doubted with probability 1e-4."""
    doubted = 0
    for seed in range(300):
        walker = Walker(seed)
        robot = PoseFilter(
            Gaussian(walker.rng.multivariate_normal(np.zeros(3), STARTING), STARTING), MARKS
        )
        for _ in range(8):
            robot.predict(StepOdometry(Pose2(), 0.0), None, 0.3)
            robot.update(walker.look(reach_m=6.0))
            doubted += "landmarks disagree" in {one.words for one in robot.doubts()}
    assert doubted <= 3  # 0.15 expected


@pytest.mark.parametrize("off_deg", [4.0, 10.0, 40.0])
def test_a_head_that_is_turned_from_where_it_says_is_doubted_in_two_seconds(off_deg):
    for seed in range(10):
        walker = Walker(seed)
        robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
        words = []
        for k in range(26):
            odometry, imu, dt = walker.step()
            walker.pan_offset += off_deg * DEG if k == 20 else 0.0
            robot.predict(odometry, imu, dt)
            robot.update(walker.look(reach_m=6.0))
            words.append({one.words for one in robot.doubts()})
        assert not any("landmarks disagree" in one for one in words[:20])
        assert any("landmarks disagree" in one for one in words[20:])


@given(st.lists(st.tuples(st.floats(1e-4, 0.3), st.floats(1e-4, 0.3)), min_size=1, max_size=6))
def test_joint_noise_is_positive_and_keeps_the_marginals(sigmas):
    blocks = [np.diag([a * a, b * b]) for a, b in sigmas]
    R = joint_noise(blocks, 0.4 * DEG)
    np.linalg.cholesky(R)
    for i, block in enumerate(blocks):
        np.testing.assert_allclose(R[2 * i : 2 * i + 2, 2 * i : 2 * i + 2], block)


def outliers(k: int, seen: list[Sighting], rng: np.random.Generator) -> list[Sighting]:
    """Three in ten sightings are random."""
    return [
        Sighting(s.identity, np.array([rng.uniform(0.3, 4.0), rng.uniform(-1, 1)]), s.covariance)
        if rng.random() < 0.3
        else s
        for s in seen
    ]


def test_three_outliers_in_ten_are_rejected_and_counted():
    runs = [walk(seed, frames=90, spoil=outliers) for seed in range(6)]
    assert np.mean([w.nees.mean() for w in runs]) < 4.5
    errors = np.concatenate([w.errors[20:] for w in runs])
    assert np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))) < 0.05
    told = sum(r.accepted + r.rejected for w in runs for r in w.reports)
    refused = sum(r.rejected for w in runs for r in w.reports)
    assert 0.2 < refused / told < 0.4  # 3.5 deviations of the share of 280


def test_it_stays_consistent_after_ten_seconds_without_landmarks():
    def blackout(k: int, seen: list[Sighting], rng: np.random.Generator) -> list[Sighting]:
        return [] if 40 <= k < 70 else seen

    runs = [walk(seed, frames=80, spoil=blackout) for seed in range(5)]
    low, high = band(3, len(runs), 0.99)
    assert low < np.mean([w.nees[69] for w in runs]) < high
    assert low < np.mean([w.nees[-1] for w in runs]) < high


@pytest.mark.parametrize(
    "displacement", [Pose2(0.5, 0.0, 0.0), Pose2(0.8, -0.8, 0.3), Pose2(0.3, 0.8, -0.7)]
)
def test_it_recovers_from_a_kidnapping(displacement):
    for seed in range(3):
        walker = Walker(seed)
        robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
        for k in range(50):
            odometry, imu, dt = walker.step()
            if k == 30:
                walker.true = walker.true @ displacement
            robot.predict(odometry, imu, dt)
            robot.update(walker.look(reach_m=4.0))
        error = (walker.true.inverse() @ robot.pose2).vector
        assert np.hypot(*error[:2]) < 0.05
        assert abs(error[2]) < 2 * DEG


def test_wrong_sightings_that_agree_with_each_other_do_not_move_the_robot():
    places = np.array([mark.position[:2] for mark in MARKS])
    P = np.diag([0.02, 0.5 * DEG]) ** 2
    for seed in range(20):
        rng = np.random.default_rng(seed)
        robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
        for _ in range(5):
            robot.predict(StepOdometry(Pose2(), 0.0), None, 0.65)
            elsewhere = rng.uniform([-4.0, -4.0, -math.pi], [4.0, 4.0, math.pi])
            pair = rng.choice(len(MARKS), 2, replace=False)
            seen = models.range_bearing(elsewhere, places[pair]).reshape(-1, 2)
            robot.update([Sighting(int(i), one, P) for i, one in zip(pair, seen, strict=True)])
        assert nees(robot.pose.mean[None], robot.pose.covariance[None])[0] < 16.3  # 0.1 %


def test_tags_without_identity_are_associated_by_position():
    def nameless(k: int, seen: list[Sighting], rng: np.random.Generator) -> list[Sighting]:
        return [Sighting(None, s.measured, s.covariance) for s in seen]

    runs = [walk(seed, frames=90, spoil=nameless) for seed in range(3)]
    errors = np.concatenate([w.errors[20:] for w in runs])
    assert np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))) < 0.03
    assert sum(r.accepted for w in runs for r in w.reports) > 130


def test_an_identity_that_is_not_in_the_map_is_rejected():
    robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
    report = robot.update([Sighting(77, np.array([1.0, 0.0]), np.eye(2) * 1e-4)])
    assert report == UpdateReport(0, 1, [])


def test_without_odometry_the_uncertainty_grows_with_cruise_speed():
    robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
    for _ in range(30):
        robot.predict(None, None, 0.325)
    sigma = math.sqrt(robot.pose.covariance[0, 0])
    assert 0.7 < sigma < 1.05  # 10 s at 0.07 (cruise) to 0.1 m/s, in one direction


def test_estimates_are_reproducible_bit_for_bit():
    first, second = walk(5, frames=40), walk(5, frames=40)
    np.testing.assert_array_equal(first.errors, second.errors)
    np.testing.assert_array_equal(first.covariances, second.covariances)


anything = st.floats(-1e3, 1e3) | st.sampled_from([math.nan, math.inf, -math.inf, 0.0])


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.tuples(anything, anything, anything, anything),
            st.tuples(anything, st.floats(0, 10) | st.sampled_from([math.nan, -1.0])),
            st.lists(
                st.tuples(st.sampled_from([0, 1, 99, None]), anything, anything, anything),
                max_size=3,
            ),
        ),
        max_size=8,
    )
)
def test_any_input_leaves_a_finite_state_and_a_positive_covariance(history):
    robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
    for (x, y, yaw, steps), (rate, dt), sightings in history:
        robot.predict(
            StepOdometry(Pose2(x, y, yaw), steps), Imu(np.array([0, 0, rate]), GRAVITY), dt
        )
        robot.update(
            [Sighting(i, np.array([r, b]), np.diag([v, 0.01])) for i, r, b, v in sightings]
        )
        pose = robot.pose
        assert np.all(np.isfinite(pose.mean))
        np.testing.assert_array_equal(pose.covariance, pose.covariance.T)
        np.linalg.cholesky(robot.state.covariance)


def test_whitened_innovations_are_uncorrelated():
    """Range innovations of one tag straight ahead; a wrong process model would show as correlation."""
    sequences = []
    for seed in range(3):
        walker = Walker(seed)
        robot = PoseFilter(Gaussian(np.zeros(3), STARTING), MARKS)
        for _ in range(100):
            odometry, imu, dt = walker.step()
            robot.predict(odometry, imu, dt)
            seen = walker.look()
            for sighting in seen[:1]:
                mark = MARKS[sighting.identity or 0]
                expected = models.range_bearing(robot.pose.mean, np.array([mark.position[:2]]))
                gradient = np.array(mark.position[:2]) - robot.pose.mean[:2]
                gradient /= -np.linalg.norm(gradient)
                S = gradient @ robot.pose.covariance[:2, :2] @ gradient + sighting.covariance[0, 0]
                sequences.append((sighting.measured[0] - expected[0]) / math.sqrt(S))
            robot.update(seen)
    found = np.array(sequences)
    assert len(found) > 100
    assert abs(found[1:] @ found[:-1] / (found @ found)) < 2.0 * 1.96 / math.sqrt(len(found))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gyro_sigma_radps": 0.0}, r"gyro_sigma_radps=0\.0 must be positive"),
        ({"rejected_frames": 0}, "rejected_frames=0 must be at least 1"),
    ],
)
def test_impossible_settings_are_refused(change, said):
    with pytest.raises(ConfigError, match=said):
        LocaliserConfig(**change)


def test_a_start_that_is_not_finite_is_refused():
    with pytest.raises(ConfigError, match="must be a finite"):
        PoseFilter(Gaussian(np.array([0.0, math.nan, 0.0]), STARTING), MARKS)
