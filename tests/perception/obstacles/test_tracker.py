"""Tracks in simulated rooms: accuracy, consistency of position and motion, robustness to partial views."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import multivariate_normal

from perception.filtering.consistency import band
from perception.filtering.models import spread
from perception.obstacles import _track_kernels
from perception.obstacles._track_kernels import MODES, PAUSING, STILL, STRAIGHT, TURNED, Belief
from perception.obstacles.forecast import forecast
from perception.obstacles.track import (
    DRIFT_M2PS,
    DRIFT_RAD2PS,
    SHAPE_MEMORY_S,
    Detection,
    Track,
    TrackConfig,
)
from perception.obstacles.tracker import ObstacleTracker, TrackerConfig, match
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2

DEG = math.pi / 180
RADIUS_M = 0.1
NOISE_M = 0.015
POSE_SIGMA = np.array([0.01, 0.01, 0.4 * DEG])
WANDER_M = TrackConfig().shape_per_m * RADIUS_M**2
DRIFT_SIGMA = np.sqrt([DRIFT_M2PS, DRIFT_M2PS, DRIFT_RAD2PS])  # per root of a second
SURE = Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]) ** 2)


def seen_at(x: float, y: float, radius_m: float = RADIUS_M, sigma_m: float = NOISE_M) -> Detection:
    return Detection(np.array([x, y]), np.eye(2) * sigma_m**2, radius_m, 0.3)


@dataclass
class Sample:
    """One track of one frame, with its ground truth."""

    t: float
    mover: bool
    since_turn_s: float
    obstacle: Obstacle
    error: np.ndarray

    @property
    def age_s(self) -> float:
        return self.obstacle.seen_s - self.obstacle.since_s

    @property
    def nees_place(self) -> float:
        return Gaussian(self.error[:2], self.obstacle.state.covariance[:2, :2]).mahalanobis_squared(
            np.zeros(2)
        )


def room(seed: int, seconds: float = 35.0, movers: int = 3, standing: int = 3) -> list[Sample]:
    """A walk past obstacles in a room; robot pose and partly visible shapes have slowly changing errors."""
    rng = np.random.default_rng(seed)
    n = movers + standing
    while True:
        places = rng.uniform([-0.5, -1.8], [2.5, 1.8], (n, 2))
        gaps = np.linalg.norm(places[:, None] - places[None], axis=-1) + 9 * np.eye(n)
        if gaps.min() > 0.6:
            break
    headings = rng.uniform(0, 2 * math.pi, n)
    speed = np.where(np.arange(n) < movers, rng.uniform(0.03, 0.06, n), 0.0)
    velocity = speed[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    turn_at = rng.uniform(8.0, 25.0, n)
    turned = np.full(n, -1e9)
    tracker = ObstacleTracker()
    pose_error, wander = rng.normal(size=3) * POSE_SIGMA, rng.normal(size=(n, 2)) * WANDER_M
    samples: list[Sample] = []
    t, frame = 0.0, 0
    while t < seconds:
        dt = 0.2 if frame % 2 else 0.45
        t, frame = t + dt, frame + 1
        places = places + velocity * dt
        for i in range(movers):
            if t > turn_at[i]:
                velocity[i] *= -1
                turned[i], turn_at[i] = t, t + rng.uniform(15, 25)
        pose_error = corrected(
            pose_error + rng.normal(size=3) * DRIFT_SIGMA * math.sqrt(dt), dt, rng
        )
        keep = math.exp(-dt / SHAPE_MEMORY_S)
        fresh = math.sqrt(1 - keep**2)
        wander = keep * wander + fresh * rng.normal(size=(n, 2)) * WANDER_M
        true = Pose2(-1.5 + 0.03 * t, -0.2, 0.05 * math.sin(frame / 10))
        believed = Gaussian(true.vector - pose_error, np.diag(POSE_SIGMA**2))
        there = true.inverse().apply(places + wander) + rng.normal(size=(n, 2)) * NOISE_M
        detections = [seen_at(*p) for p in there if rng.random() < 0.95]
        tracker.update(t, detections, believed)
        for obstacle in tracker.obstacles:
            i = int(np.argmin(np.linalg.norm(places - obstacle.position, axis=1)))
            error = np.concatenate([places[i], velocity[i]]) - obstacle.state.mean
            samples.append(Sample(t, i < movers, t - turned[i], obstacle, error))
    return samples


def corrected(error: np.ndarray, dt: float, rng: np.random.Generator) -> np.ndarray:
    """The pose error after a measurement that brings its standard deviation back to `POSE_SIGMA`."""
    predicted = POSE_SIGMA**2 + DRIFT_SIGMA**2 * dt
    gain = 1.0 - POSE_SIGMA**2 / predicted
    noise = np.sqrt(predicted * (1.0 - gain) / gain)
    return error - gain * (error + rng.normal(size=3) * noise)


@pytest.fixture(scope="module")
def rooms() -> list[list[Sample]]:
    return [room(seed) for seed in range(6)]


def test_position_errors_match_their_covariances(rooms):
    """Each obstacle of a room counts as one sample; its frames are correlated."""
    low, high = band(2, 6 * len(rooms))
    settled = [s.nees_place for r in rooms for s in r if s.age_s > 2 and s.since_turn_s > 3]
    assert low < np.mean(settled) < high


def test_velocities_of_movers_are_accurate_to_two_centimetres_per_second(rooms):
    moving = [s for r in rooms for s in r if s.mover and s.age_s > 4 and s.since_turn_s > 3]
    assert len(moving) > 600
    rmse = math.sqrt(np.mean([s.error[2:] @ s.error[2:] for s in moving]))
    assert rmse < 0.02
    normalised = [
        Gaussian(s.error[2:], s.obstacle.state.covariance[2:, 2:]).mahalanobis_squared(np.zeros(2))
        for s in moving
    ]
    assert 0.4 < np.mean(normalised) < 2.6


def test_static_obstacles_are_reported_as_static(rooms):
    standing = [s for r in rooms for s in r if not s.mover and s.age_s > 4]
    assert np.mean([s.obstacle.moving > 0.5 for s in standing]) < 0.02
    assert math.sqrt(np.mean([s.obstacle.velocity @ s.obstacle.velocity for s in standing])) < 0.005


def test_movers_are_reported_as_moving_also_while_they_turn(rooms):
    moving = [s for r in rooms for s in r if s.mover and s.age_s > 6]
    assert np.mean([s.obstacle.moving > 0.5 for s in moving]) > 0.9
    turning = [s for s in moving if 0 <= s.since_turn_s < 3]
    assert np.mean([s.obstacle.moving > 0.5 for s in turning]) > 0.85


def test_the_probability_of_moving_is_not_overconfident(rooms):
    """Obstacles reported moving with 90 % hardly ever stand, and those with 10 % hardly ever move."""
    obstacle = [s for r in rooms for s in r if s.age_s > 1]
    sure = [s.mover for s in obstacle if s.obstacle.moving > 0.9]
    assert np.mean(sure) > 0.95
    still = [s.mover for s in obstacle if s.obstacle.moving < 0.1]
    assert np.mean(still) < 0.05


def test_a_reversal_is_tracked_within_three_seconds(rooms):
    after = [s for r in rooms for s in r if s.mover and s.age_s > 6]
    late = [s for s in after if 2.0 <= s.since_turn_s < 3.5]
    assert len(late) > 20
    assert math.sqrt(np.mean([s.error[2:] @ s.error[2:] for s in late])) < 0.035
    assert np.mean([float(np.linalg.norm(s.error[:2])) < 0.1 for s in after]) > 0.97


def test_tracks_keep_their_numbers(rooms):
    numbers = [len({s.obstacle.track for s in samples}) for samples in rooms]
    assert np.mean(numbers) <= 6.5  # six obstacles; one may walk through another


def test_a_position_seen_a_hundred_times_is_no_more_certain_than_the_pose_of_the_robot():
    sigma = 0.05
    robot = Gaussian(np.array([0.0, 0.0, 0.3]), np.diag([sigma, sigma, 0.02]) ** 2)
    tracker = ObstacleTracker()
    for k in range(100):
        tracker.update(0.3 * k, [seen_at(1.0, 0.2, sigma_m=0.005)], robot)
    (obstacle,) = tracker.obstacles
    assert np.linalg.eigvalsh(obstacle.state.covariance[:2, :2])[0] > 0.8 * sigma**2


def test_partly_visible_furniture_is_not_reported_as_moving():
    """Its visible centre is shifted towards the robot and changes as the robot passes, or as more is seen."""
    false = tracks = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        tracker = ObstacleTracker()
        places = np.array([[0.6, 0.6], [1.4, -0.7], [2.0, 0.8], [2.8, -0.6]])
        radius = rng.uniform(0.15, 0.3, len(places))
        growth = rng.uniform(0.03, 0.08, len(places))
        moved: set[int] = set()
        born: set[int] = set()
        for k in range(100):
            t = 0.325 * k
            true = Pose2(-1.0 + 0.07 * t, 0.0, 0.2 * math.sin(t / 4))
            detections = []
            for i, place in enumerate(places):
                towards = np.array([true.x, true.y]) - place
                towards = towards / np.linalg.norm(towards)
                hidden = max(growth[i] - 0.04 * max(t - 4.0 - i, 0.0), 0.0)
                middle = place + 0.3 * radius[i] * towards + hidden * np.array([0.0, 1.0])
                there = true.inverse().apply(middle) + rng.normal(size=2) * 0.01
                detections.append(seen_at(*there, float(radius[i])))
            tracker.update(t, detections, Gaussian(true.vector, np.diag(POSE_SIGMA**2)))
            born |= {o.track for o in tracker.obstacles}
            moved |= {o.track for o in tracker.obstacles if o.moving > 0.5}
        false, tracks = false + len(moved), tracks + len(born)
    assert tracks >= 12
    assert false <= 2


def test_a_missed_track_ends_if_visible_and_lives_if_occluded():
    def all_of_them(places: np.ndarray) -> np.ndarray:
        return np.ones(len(places), dtype=bool)

    def none_of_them(places: np.ndarray) -> np.ndarray:
        return np.zeros(len(places), dtype=bool)

    for visible, alive in ((all_of_them, 0), (none_of_them, 1)):
        tracker = ObstacleTracker()
        for k in range(10):
            tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE, visible)
        assert len(tracker.obstacles) == 1
        for k in range(10, 18):
            tracker.update(0.3 * k, [], SURE, visible)
        assert len(tracker.obstacles) == alive


def test_a_truncated_detection_keeps_the_track_that_it_overlaps_and_no_other():
    def all_of_them(places: np.ndarray) -> np.ndarray:
        return np.ones(len(places), dtype=bool)

    robot = Gaussian(np.array([0.4, -0.3, 0.7]), SURE.covariance)
    where = Pose2(0.4, -0.3, 0.7).inverse()
    thing = np.array([1.0, 0.2])
    for half, alive in ((np.array([1.05, 0.3]), 1), (np.array([1.5, 0.2]), 0)):
        tracker = ObstacleTracker()
        whole = seen_at(*where.apply(thing[None])[0])
        part = seen_at(*where.apply(half[None])[0], radius_m=0.08)
        tracker.update(0.0, [whole], robot, all_of_them)
        for k in range(1, 6):  # complete, then truncated, then complete: a turning head
            tracker.update(0.3 * k, [], robot, all_of_them, [part])
        tracker.update(1.8, [whole], robot, all_of_them)
        assert len(tracker.obstacles) == alive
        assert not alive or np.linalg.norm(tracker.obstacles[0].position - thing) < 0.02


def test_a_mover_that_stays_truncated_is_still_tracked():
    """Close by, it is truncated for longer than a lost track lives."""
    rng = np.random.default_rng(5)
    speed, tracker = np.array([-0.02, 0.03]), ObstacleTracker()
    nees = []
    for k in range(80):
        t = 0.3 * k
        true = np.array([0.6, -0.3]) + speed * t
        if k < 15:
            noise = NOISE_M * rng.standard_normal(2)
            tracker.update(t, [seen_at(*(true + noise))], SURE)
        else:  # its lower left is hidden: the visible part is small and off centre
            part = seen_at(*(true + np.array([0.04, 0.05])), radius_m=0.06)
            tracker.update(t, [], SURE, truncated=[part])
        if k > 40:
            (obstacle,) = tracker.obstacles
            assert obstacle.seen_s == t
            assert np.linalg.norm(obstacle.position - true) < 0.1
            here = Gaussian(obstacle.position - true, obstacle.state.covariance[:2, :2])
            nees.append(here.mahalanobis_squared(np.zeros(2)))
    assert np.mean(nees) < 4.0


def test_a_truncated_mover_updates_its_track_although_furniture_overlaps_it():
    tracker = ObstacleTracker()
    for k in range(6):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    table, part = seen_at(1.1, 0.2, radius_m=0.3), seen_at(1.04, 0.0, radius_m=0.06)
    tracker.update(1.8, [], SURE, truncated=[table, part])
    (obstacle,) = tracker.obstacles
    assert obstacle.seen_s == 1.8


def test_truncated_furniture_keeps_a_track_but_does_not_update_it():
    tracker = ObstacleTracker()
    for k in range(6):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    (before,) = tracker.obstacles
    for k in range(6, 12):
        tracker.update(0.3 * k, [], SURE, truncated=[seen_at(1.15, 0.2, radius_m=0.3)])
    (after,) = tracker.obstacles
    assert after.seen_s == before.seen_s
    assert np.linalg.norm(after.position - before.position) < 0.01


def test_a_truncated_detection_updates_only_the_nearest_track():
    """What stood at the first place is gone from view, and something else stands 0.2 m beside it."""
    tracker = ObstacleTracker()
    for k in range(6):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0, radius_m=0.2)], SURE)
    for k in range(6, 12):
        tracker.update(0.3 * k, [seen_at(1.0, 0.2, radius_m=0.2)], SURE)
    before, _ = tracker.obstacles
    tracker.update(3.6, [], SURE, truncated=[seen_at(1.0, 0.2, radius_m=0.2)])
    left, shown = tracker.obstacles
    assert left.seen_s == before.seen_s < shown.seen_s == 3.6
    assert np.linalg.norm(left.position - before.position) < 0.01


def test_a_single_detection_is_not_reported():
    tracker = ObstacleTracker()
    tracker.update(0.0, [seen_at(1.0, 0.0)], SURE)
    assert tracker.obstacles == []
    for k in range(1, 3):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    assert [o.track for o in tracker.obstacles] == [1]


def sampled_modes(belief, rates, fresh, seconds, n, rng):
    """Modes and states of n obstacles that change at random, in steps of 20 ms."""
    mode = rng.choice(MODES, n, p=belief.w)
    root = np.linalg.cholesky(belief.P)
    x = belief.x[mode] + np.einsum("nij,nj->ni", root[mode], rng.standard_normal((n, 4)))
    dt = 0.02
    for _ in range(round(seconds / dt)):
        chance = rates[mode] * dt
        pick = rng.random(n)
        after = np.where(
            pick < chance.sum(axis=1), (np.cumsum(chance, axis=1) < pick[:, None]).sum(axis=1), mode
        )
        changed = after != mode
        stands, anew = changed & (after < STRAIGHT), changed & (after == TURNED)
        x[stands, 2:] = 0.0
        x[anew, 2:] = rng.multivariate_normal(np.zeros(2), fresh, int(anew.sum()))
        mode = after
        x[:, :2] += dt * x[:, 2:]
    return mode, x


def test_a_forecast_equals_simulated_obstacles_that_stop_turn_and_go_on():
    rng = np.random.default_rng(5)
    weights = np.array([0.1, 0.2, 0.5, 0.1, 0.1])
    means = np.zeros((MODES, 4))
    means[STRAIGHT:, 2] = 0.08
    covariances = np.tile(np.diag([1e-4, 1e-4, 1e-10, 1e-10]), (MODES, 1, 1))
    covariances[STRAIGHT:, 2:, 2:] = np.eye(2) * 1e-4
    rates = followed()._rates()
    rates[STRAIGHT:, PAUSING] = rates[STRAIGHT:, TURNED] = 0.15
    rates[TURNED, STRAIGHT:] = 0.0
    belief, fresh = Belief(weights, means, covariances), np.diag([0.05, 0.03]) ** 2
    w, x, P = np.empty((1, MODES)), np.empty((1, MODES, 4)), np.empty((1, MODES, 4, 4))
    still = np.zeros(MODES)
    _track_kernels.forecast(belief, rates, fresh, still, np.array([3.0]), w, x, P)
    mode, state = sampled_modes(belief, rates, fresh, 3.0, 40000, rng)
    np.testing.assert_allclose(w[0], np.bincount(mode, minlength=MODES) / len(mode), atol=0.02)
    mean, covariance = np.empty(4), np.empty((4, 4))
    _track_kernels.merge(w[0], x[0], P[0], mean, covariance)
    np.testing.assert_allclose(mean, state.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(np.diag(covariance), state.var(axis=0), rtol=0.12)


def test_a_motion_that_is_doubted_is_forecast_to_stand_where_it_is_seen():
    tracker = ObstacleTracker()
    for k in range(30):
        tracker.update(0.3 * k, [seen_at(1.0, 0.02 * k)], SURE)
    (obstacle,) = tracker.obstacles
    found = forecast(replace(obstacle, moving=0.5), np.array([2.0]))
    assert found.probabilities[0, 0] == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(found.means[0, 0, :2], obstacle.position, atol=0.02)


@pytest.mark.parametrize("pose_sigma_m", [0.001, 0.08])
def test_a_mover_in_sight_is_one_however_unsure_the_pose_of_the_robot(pose_sigma_m):
    robot = Gaussian(np.zeros(3), np.diag([pose_sigma_m, pose_sigma_m, 0.001]) ** 2)
    rng, tracker, moving = np.random.default_rng(4), ObstacleTracker(), []
    for k in range(60):
        x, y = np.array([1.5, 0.021 * k - 0.6]) + 0.01 * rng.normal(size=2)
        tracker.update(0.3 * k, [seen_at(x, y)], robot)
        moving += [one.moving for one in tracker.obstacles]
    assert len(tracker.obstacles) == 1
    assert min(moving[25:]) > 0.9


def test_the_forecast_of_a_track_begins_at_its_state():
    tracker = ObstacleTracker()
    for k in range(30):
        tracker.update(0.3 * k, [seen_at(1.0, 0.02 * k)], SURE)
    (obstacle,) = tracker.obstacles
    found = forecast(obstacle, np.array([0.0, 2.0]))
    np.testing.assert_allclose(found.probabilities.sum(axis=1), 1.0)
    assert found.probabilities[0, 0] == pytest.approx(1.0 - obstacle.moving)
    mean, covariance = np.empty(4), np.empty((4, 4))
    now = (found.probabilities[0], found.means[0], found.covariances[0])
    _track_kernels.merge(*now, mean, covariance)
    np.testing.assert_allclose(mean, obstacle.state.mean, atol=2e-3)
    assert found.means[1, STRAIGHT, 1] == pytest.approx(0.58 + 2.0 * 0.0667, abs=0.03)


def test_the_covariance_of_an_unseen_mover_covers_turns():
    """Movers that turn at random every 20 s, seen for 8 s and lost for 4 to 16 s."""
    rng = np.random.default_rng(2)
    place_nees = []
    for _ in range(150):
        tracker = ObstacleTracker(
            TrackerConfig(largest_sigma_m=5.0, oldest_s=30.0, track=TrackConfig(shape_per_m=0.0))
        )
        heading = rng.uniform(0, 2 * math.pi)
        velocity = rng.uniform(0.03, 0.1) * np.array([math.cos(heading), math.sin(heading)])
        place = np.array([1.0, 0.0]) + rng.normal(size=2) * 0.3
        lost_s = rng.uniform(4.0, 16.0)
        for k in range(1, int((8.0 + lost_s) / 0.325)):
            t = 0.325 * k
            place = place + 0.325 * velocity
            seen = t < 8.0
            if not seen and rng.random() < 0.325 / 20.0:
                velocity = -velocity
            found = [seen_at(*(place + rng.normal(size=2) * NOISE_M))] if seen else []
            tracker.update(t, found, SURE)
        (obstacle,) = tracker.obstacles
        place_nees.append(
            Gaussian(
                obstacle.state.mean[:2], obstacle.state.covariance[:2, :2]
            ).mahalanobis_squared(place)
        )
    # heavier tails than a Gaussian: gone straight, or all the way back
    assert 0.8 < np.mean(place_nees) < 3.0
    assert np.mean(np.array(place_nees) < 5.99) > 0.88


def test_an_unseen_static_obstacle_keeps_its_position_and_the_doubt_of_it_grows_slowly():
    rng = np.random.default_rng(3)
    tracker = ObstacleTracker(TrackerConfig(oldest_s=30.0))
    for k in range(40):
        tracker.update(
            0.3 * k, [seen_at(*(np.array([1.0, 0.2]) + rng.normal(size=2) * 0.01))], SURE
        )
    (before,) = tracker.obstacles
    for k in range(40, 80):
        tracker.update(0.3 * k, [], SURE)
    (after,) = tracker.obstacles
    assert after.moving < 0.15  # it may be somebody who stood
    np.testing.assert_allclose(after.position, before.position, atol=4e-3)  # seen to 10 mm
    gone = TrackConfig().speed_sigma_mps * 12.0  # at the usual speed, since it was seen last
    assert np.linalg.eigvalsh(after.state.covariance[:2, :2])[-1] < after.moving * gone**2 + 0.01**2


def test_a_track_ends_after_its_longest_time_unseen():
    tracker = ObstacleTracker(TrackerConfig(oldest_s=5.0))
    for k in range(5):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    tracker.update(6.0, [], SURE)
    assert len(tracker.obstacles) == 1
    tracker.update(6.5, [], SURE)
    assert tracker.obstacles == []


def test_large_or_non_finite_detections_are_not_tracked():
    tracker = ObstacleTracker()
    bad = [
        seen_at(1.0, 0.0, radius_m=0.5),
        seen_at(math.nan, 0.0),
        Detection(np.array([2.0, 1.0]), np.full((2, 2), math.inf), 0.1),
    ]
    for k in range(5):
        tracker.update(0.3 * k, bad, SURE)
    assert tracker.obstacles == []


def test_two_movers_that_pass_each_other_keep_their_numbers():
    tracker = ObstacleTracker()
    rng = np.random.default_rng(0)
    for k in range(80):
        t = 0.325 * k
        a = np.array([1.0, -0.8 + 0.06 * t]) + rng.normal(size=2) * 0.01
        b = np.array([1.25, 0.8 - 0.06 * t]) + rng.normal(size=2) * 0.01
        tracker.update(t, [seen_at(*b), seen_at(*a)] if k % 2 else [seen_at(*a), seen_at(*b)], SURE)
        if k == 15:
            before = {o.track: o.velocity[1] > 0 for o in tracker.obstacles}
    after = {o.track: o.velocity[1] > 0 for o in tracker.obstacles}
    assert after == before
    assert sorted(after.values()) == [False, True]


@given(
    arrays(np.float64, st.tuples(st.integers(1, 4), st.integers(1, 4)), elements=st.floats(0, 20))
)
def test_matching_equals_an_exhaustive_search(cost):
    gate = 10.0
    found = match(cost, gate)
    n, m = cost.shape
    best = (0, 0.0)
    for size in range(1, min(n, m) + 1):
        for rows in itertools.combinations(range(n), size):
            for columns in itertools.permutations(range(m), size):
                values = [cost[r, c] for r, c in zip(rows, columns, strict=True)]
                if max(values) <= gate:
                    best = min(best, (-size, sum(values)))
    assert -len(found) == best[0]
    assert math.isclose(sum(cost[r, c] for r, c in found), best[1], abs_tol=1e-9)


def test_the_initial_covariance_of_a_track_is_that_of_samples():
    """Sampled poses and detections against the initial covariance."""
    rng = np.random.default_rng(1)
    robot = Gaussian(np.array([1.0, -0.5, 0.7]), np.diag([0.03, 0.02, 0.03]) ** 2)
    seen = Detection(np.array([1.5, 0.4]), np.diag([0.02, 0.01]) ** 2, 0.1)
    poses = rng.multivariate_normal(robot.mean, robot.covariance, 20000)
    places = rng.multivariate_normal(seen.position, seen.covariance, 20000)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    world = poses[:, :2] + np.stack(
        [c * places[:, 0] - s * places[:, 1], s * places[:, 0] + c * places[:, 1]], axis=-1
    )
    obstacle = Track(seen, robot, TrackConfig(shape_per_m=0.0)).state
    P = obstacle.covariance[:2, :2]
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(obstacle.mean[:2], world.mean(axis=0), atol=3e-3)
    np.testing.assert_allclose(np.cov(world.T) / size, P / size, atol=0.05)


def relative_position(state: np.ndarray, robot: np.ndarray) -> np.ndarray:
    """Position of the obstacle in the body frame; the true viewpoint is the robot's pose plus the error."""
    x, y = state[0] - robot[0] - state[4], state[1] - robot[1] - state[5]
    yaw = robot[2] + state[6]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * x + s * y, c * y - s * x])


def peer(track: Track, dt: float, keep: float) -> UnscentedKalmanFilter:
    """filterpy's filter, in the state of a track."""

    def flow(x: np.ndarray, _: float) -> np.ndarray:
        return np.concatenate([x[:2] + dt * x[2:4], x[2:4], keep * x[4:]])

    points = MerweScaledSigmaPoints(7, spread(7), 2.0, 0.0)
    twin = UnscentedKalmanFilter(7, 2, dt, relative_position, flow, points)
    belief = track._belief
    twin.x, twin.P = belief.x[STRAIGHT].copy(), belief.P[STRAIGHT].copy()
    twin.Q = np.zeros((7, 7))
    return twin


def followed() -> Track:
    """A track of four detections from an uncertain pose."""
    robot = Gaussian(np.array([0.2, -0.1, 0.4]), np.diag([0.02, 0.03, 0.05]) ** 2)
    track = Track(seen_at(1.0, 0.5), robot, TrackConfig())
    for k in range(4):
        track.predict(0.3, robot)
        track.update(seen_at(1.0 + 0.01 * k, 0.5))
    return track


def walked(turn_every_s: float, seed: int) -> tuple[Track, np.ndarray]:
    """The track of one that walked to and fro before the robot for 100 s, 5 s after it was last seen; and where it is."""
    rng, dt = np.random.default_rng(seed), 0.4
    x, v = np.array([2.0, 0.0]), np.array([0.0, 0.08])
    track = Track(seen_at(*x), SURE, TrackConfig())
    until = rng.exponential(turn_every_s)
    for step in range(262):
        if step * dt > until:
            v, until = -v, until + rng.exponential(turn_every_s)
        x = x + v * dt
        track.predict(dt, SURE)
        if step < 250:
            track.update(seen_at(*(x + rng.normal(0.0, NOISE_M, 2))))
    return track, x


def test_one_that_never_turned_is_expected_to_go_on_and_one_that_often_did_is_not():
    tracks = {every_s: [walked(every_s, seed) for seed in range(12)] for every_s in (7.0, 1e9)}
    along = {}
    for every_s, found in tracks.items():
        errors = [float(x[1] - track.state.mean[1]) for track, x in found]
        variances = [float(track.state.covariance[1, 1]) for track, _ in found]
        along[every_s] = np.mean(variances), np.mean(np.square(errors))
    assert along[1e9][0] < 0.6 * along[7.0][0]  # claimed
    for claimed, happened in along.values():
        assert happened < 2.0 * claimed


def test_prediction_by_matrices_equals_prediction_by_sigma_points():
    track, dt, keep = followed(), 0.3, 0.9
    twin = peer(track, dt, keep)
    twin.predict()
    belief = track._belief
    _track_kernels.drift(belief, dt, np.zeros(MODES))
    _track_kernels.look_from(belief, keep * np.eye(3), np.zeros((3, 3)))
    np.testing.assert_allclose(belief.x[STRAIGHT], twin.x, atol=1e-9)
    np.testing.assert_allclose(belief.P[STRAIGHT], twin.P, atol=1e-9)
    assert math.isclose(spread(7) ** 2 * 7, 3.0)


def test_the_update_equals_that_of_filterpy():
    track, robot = followed(), np.array([0.25, -0.08, 0.45])
    track.predict(0.3, Gaussian(robot, np.diag([0.02, 0.03, 0.05]) ** 2))
    twin = peer(track, 0.3, 1.0)
    twin.sigmas_f = twin.points_fn.sigma_points(twin.x, twin.P)
    seen = Detection(np.array([1.0, 0.47]), np.array([[4e-4, 1e-4], [1e-4, 2e-4]]), RADIUS_M)
    track.update(seen)
    twin.update(seen.position, R=seen.covariance, robot=robot)
    np.testing.assert_allclose(track._belief.x[STRAIGHT], twin.x, atol=1e-9)
    np.testing.assert_allclose(track._belief.P[STRAIGHT], twin.P, atol=1e-9)


def test_the_modes_are_weighed_by_bayes_rule():
    track = followed()
    track.predict(0.3, Gaussian(np.array([0.2, -0.1, 0.4]), np.diag([0.02, 0.03, 0.05]) ** 2))
    prior, (means, covariances) = track._belief.w.copy(), track._expectations()
    seen = seen_at(1.1, 0.45)
    likelihood = [
        0.99 * multivariate_normal(mean, covariance + seen.covariance).pdf(seen.position) + 0.01
        for mean, covariance in zip(means, covariances, strict=True)
    ]
    track.update(seen)
    expected = prior * likelihood
    np.testing.assert_allclose(track._belief.w, expected / expected.sum(), rtol=1e-9)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.lists(
            st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 0.5), st.floats(0, 1)),
            max_size=4,
        ),
        min_size=1,
        max_size=12,
    ),
    st.floats(0.0, 10.0),
)
def test_every_history_leaves_the_covariance_positive_definite(history, dt):
    tracker = ObstacleTracker(TrackerConfig(hits_to_show=1))
    for k, objects in enumerate(history):
        detections = [
            Detection(np.array([x, y]), np.eye(2) * v**2, r, 0.1) for x, y, r, v in objects
        ]
        tracker.update(k * dt, detections, SURE)
        for obstacle in tracker.obstacles:
            assert np.all(np.isfinite(obstacle.state.mean))
            np.linalg.cholesky(obstacle.state.covariance)
            assert 0.0 <= obstacle.moving <= 1.0


def test_the_same_detections_give_the_same_bits():
    first, second = room(3, seconds=8.0), room(3, seconds=8.0)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.obstacle.state.mean, b.obstacle.state.mean)
        np.testing.assert_array_equal(a.obstacle.state.covariance, b.obstacle.state.covariance)


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (TrackerConfig, {"hits_to_show": 0}, "hits_to_show=0 must be at least 1"),
        (TrackConfig, {"speed_sigma_mps": -1.0}, r"speed_sigma_mps=-1\.0 must be positive"),
        (TrackConfig, {"moving_prior": 1.0}, r"moving_prior=1\.0 must lie"),
        (TrackConfig, {"shape_per_m": -0.1}, r"shape_per_m=-0\.1 must not be negative"),
    ],
)
def test_invalid_settings_are_refused_with_a_message(kind, change, message):
    with pytest.raises(ConfigError, match=message):
        kind(**change)


def test_a_lost_mover_is_not_associated_with_furniture_of_another_size():
    """It is occluded; a wider obstacle near its predicted position is detected for the first time."""
    tracker = ObstacleTracker()
    for k in range(20):
        tracker.update(0.3 * k, [seen_at(1.0 + 0.012 * k, 0.0)], SURE)
    (mover,) = tracker.obstacles
    assert mover.moving > 0.5
    for k in range(40, 44):  # six seconds later, 0.15 m beyond the prediction
        tracker.update(0.3 * k, [seen_at(1.0 + 0.012 * 40 + 0.15, 0.0, radius_m=0.15)], SURE)
    numbers = {o.track: o.radius_m for o in tracker.obstacles}
    assert len(numbers) == 2
    assert numbers[mover.track] == pytest.approx(RADIUS_M, abs=0.01)


def test_furniture_keeps_its_track_when_a_lost_mover_may_be_there():
    """The mover is out of sight; its expected place passes the middle of the furniture."""
    tracker = ObstacleTracker()
    for k in range(20):
        tracker.update(0.3 * k, [seen_at(0.4 + 0.03 * k, 0.5)], SURE)
    (mover,) = tracker.obstacles
    thing = mover.after(2.0).position
    for k in range(20, 34):
        tracker.update(0.3 * k, [seen_at(*thing)] if k < 24 else [], SURE)
        tracks = [one.track for one in tracker.obstacles]
        assert mover.track in tracks
    tracker.update(10.2, [seen_at(*thing)], SURE)
    furniture = [one for one in tracker.obstacles if one.track != mover.track]
    assert len(furniture) == 1
    assert furniture[0].seen_s == 10.2


def test_one_leg_of_a_tracked_person_starts_no_track():
    tracker, x = ObstacleTracker(), 0.5 + 0.03 * np.arange(30)
    for k in range(20):
        tracker.update(0.3 * k, [seen_at(x[k], 0.0, radius_m=0.18)], SURE)
    for k in range(20, 25):
        tracker.update(0.3 * k, [seen_at(x[k], 0.11, radius_m=0.06)], SURE)
        assert len(tracker.obstacles) == 1
    for k in range(25, 30):
        beside = seen_at(x[k], 0.35, radius_m=0.06)
        tracker.update(0.3 * k, [seen_at(x[k], 0.0, radius_m=0.18), beside], SURE)
    assert len(tracker.obstacles) == 2


def test_two_cameras_of_one_instant_update_one_after_the_other():
    tracker = ObstacleTracker()
    robot = Gaussian(np.zeros(3), np.eye(3) * 1e-6)

    def seen(x):
        return [Detection(np.array([x, 0.0]), np.eye(2) * 1e-4, RADIUS_M)]

    tracker.update(0.0, [*seen(1.0), *seen(3.0)], robot)
    tracker.update(1.0, seen(1.0), robot)
    assert len(tracker.innovations) == 1
    tracker.update(1.0, seen(3.0), robot)
    assert len({one.identity for one in tracker.innovations}) == 2
    tracker.update(2.0, [], robot)
    assert tracker.innovations == []


@pytest.mark.parametrize(("stands", "speed_mps"), [(True, 0.0), (False, 0.08)])
def test_a_mover_that_was_lost_proves_its_motion_anew(stands, speed_mps):
    """What is seen after fifteen seconds may be a thing that stands, or the mover itself."""
    rng, dt = np.random.default_rng(4), 0.3
    track, x = Track(seen_at(2.0, 0.0), SURE, TrackConfig()), np.array([2.0, 0.0])
    for _ in range(40):
        x[1] += 0.08 * dt
        track.predict(dt, SURE)
        track.update(seen_at(*(x + rng.normal(0.0, NOISE_M, 2))))
    assert track.moving > 0.9
    for _ in range(50):
        track.predict(dt, SURE)
    x = track.state.mean[:2].copy()
    moving = []
    for _ in range(25):
        track.predict(dt, SURE)
        track.update(seen_at(*(x + rng.normal(0.0, NOISE_M, 2))))
        moving.append(track.moving)
        x[1] += speed_mps * dt
    assert moving[0] <= 0.5
    assert (max(moving) <= 0.5) == stands
    assert (moving[-1] > 0.9) != stands


def lost_for(seconds: float, rng: np.random.Generator) -> tuple[Track, np.ndarray, np.ndarray]:
    """A mover that turns at random, seen for 12 s and then lost; and where it is, and its velocity."""
    dt, track = 0.3, Track(seen_at(2.0, 0.0), SURE, TrackConfig())
    place, velocity = np.array([2.0, 0.0]), 0.12 * unit(rng.uniform(0.0, 2.0 * math.pi))
    for k in range(round((12.0 + seconds) / dt)):
        if rng.random() < dt / 15.0:
            velocity = 0.12 * unit(rng.uniform(0.0, 2.0 * math.pi))
        place = place + dt * velocity
        track.predict(dt, SURE)
        if k * dt < 12.0:
            track.update(seen_at(*(place + rng.normal(0.0, NOISE_M, 2))))
    return track, place, velocity


def unit(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


@pytest.mark.parametrize("seconds", [4.8, 7.2])
def test_a_mover_that_is_found_again_is_as_surely_known_as_claimed(seconds):
    rng, nees = np.random.default_rng(6), []
    for _ in range(120):
        track, place, velocity = lost_for(seconds, rng)
        track.update(seen_at(*(place + rng.normal(0.0, NOISE_M, 2))))
        nees.append(track.state.mahalanobis_squared(np.concatenate([place, velocity])))
    assert 2.0 < np.mean(nees) < 6.0


def test_a_thing_of_another_size_where_a_mover_was_lost_is_furniture():
    rng, still = np.random.default_rng(7), []
    for radius_m in (RADIUS_M, RADIUS_M + 0.1):
        track, place, _ = lost_for(4.8, rng)
        track.update(seen_at(*place, radius_m=radius_m))
        still.append(track.motion.probabilities[STILL])
    assert still[0] < 0.3
    assert still[1] > 0.5


def test_furniture_that_took_the_place_of_a_mover_is_furniture_after_a_while():
    """It is seen in part, with an error of a decimetre; a velocity of almost nothing explains it as well as rest."""
    rng, tracker = np.random.default_rng(9), ObstacleTracker()
    for k in range(25):
        tracker.update(0.3 * k, [seen_at(0.5 + 0.03 * k, 0.5, radius_m=0.3)], SURE)
    (mover,) = tracker.obstacles
    assert mover.moving > 0.5
    for k in range(25, 175):
        place = np.array([1.3, 0.5]) + 0.1 * rng.standard_normal(2)
        seen = Detection(place, np.eye(2) * 0.1**2, 0.3, 0.4)
        tracker.update(0.3 * k, [seen], SURE)
    (thing,) = tracker.obstacles
    assert thing.moving < 0.1


def test_what_remains_of_the_error_of_the_viewpoint_is_what_a_kalman_filter_leaves():
    rng = np.random.default_rng(8)
    for _ in range(20):
        root, drift = rng.normal(size=(3, 3)), rng.uniform(0.01, 0.3, 3)
        before = root @ root.T
        H, R = rng.normal(size=(2, 3)), np.diag(rng.uniform(0.1, 1.0, 2))
        predicted = before + np.diag(drift)
        gain = predicted @ H.T @ np.linalg.inv(H @ predicted @ H.T + R)
        left = np.eye(3) - gain @ H
        keep, fresh = _track_kernels.renewal(before, drift, left @ predicted)
        np.testing.assert_allclose(keep, left, atol=1e-9)
        expected = left @ np.diag(drift) @ left.T + gain @ R @ gain.T
        np.testing.assert_allclose(fresh, expected, atol=1e-9)
    keep, fresh = _track_kernels.renewal(before, np.zeros(3), 3.0 * before)
    np.testing.assert_allclose(keep, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(fresh, 2.0 * before, atol=1e-9)


def test_a_track_that_is_seen_in_part_three_times_out_of_four_lives():
    def everywhere(places: np.ndarray) -> np.ndarray:
        return np.ones(len(places), dtype=bool)

    tracker = ObstacleTracker()
    for k in range(5):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE, everywhere)
    (known,) = tracker.obstacles
    for k in range(5, 60):
        parts = [seen_at(1.0, 0.03, radius_m=0.08)] if k % 4 else []
        tracker.update(0.3 * k, [], SURE, everywhere, parts)
    assert [one.track for one in tracker.obstacles] == [known.track]


@pytest.mark.parametrize("per_s", [5, 30, 90])
@pytest.mark.parametrize("speed_mps", [1.4, 2.0])
def test_somebody_much_faster_than_usual_is_one_track_of_that_speed(speed_mps, per_s):
    rng, tracker = np.random.default_rng(per_s), ObstacleTracker()
    velocity, numbers = speed_mps * np.array([0.6, 0.8]), set()
    for k in range(3 * per_s):
        place = np.array([1.0, -3.0]) + velocity * k / per_s
        tracker.update(1.7e9 + k / per_s, [seen_at(*rng.normal(place, NOISE_M))], SURE)
        numbers |= {one.track for one in tracker.obstacles}
    (found,) = tracker.obstacles
    assert len(numbers) == 1
    assert found.moving > 0.9
    assert np.abs(found.velocity - velocity).max() < 0.1


def test_an_obstacle_that_is_not_seen_for_a_frame_does_not_become_the_fast_one_beside_it():
    tracker = ObstacleTracker()
    for k in range(10):
        seen = [] if k == 4 else [seen_at(1.0, 0.0)]
        seen += [seen_at(1.2, 0.1)] if k >= 4 else []
        tracker.update(0.1 * k, seen, SURE)
    assert sorted(one.position[0] for one in tracker.obstacles) == pytest.approx([1.0, 1.2])
    assert max(one.moving for one in tracker.obstacles) < 0.3
