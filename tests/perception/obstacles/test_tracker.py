"""Tracks over simulated rooms: right, honest about position and motion, and not misled by half views."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from perception.filtering.consistency import band
from perception.filtering.models import spread
from perception.obstacles.track import Detection, Track, TrackConfig, relative_position
from perception.obstacles.tracker import ObstacleTracker, TrackerConfig, match
from perception.obstacles.turning import turning
from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from perception.primitives.pose import Pose2

DEG = math.pi / 180
RADIUS_M = 0.1
NOISE_M = 0.015
POSE_SIGMA = np.array([0.01, 0.01, 0.4 * DEG])
MEMORY_S = TrackConfig().view_memory_s
WANDER_M = TrackConfig().shape_per_m * RADIUS_M**2
SURE = Gaussian(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]) ** 2)


def seen_at(x: float, y: float, radius_m: float = RADIUS_M, sigma_m: float = NOISE_M) -> Detection:
    return Detection(np.array([x, y]), np.eye(2) * sigma_m**2, radius_m, 0.3)


@dataclass
class Sample:
    """One obstacle of one frame, beside its truth."""

    t: float
    mover: bool
    since_turn_s: float
    told: Obstacle
    error: np.ndarray

    @property
    def age_s(self) -> float:
        return self.told.seen_s - self.told.since_s

    @property
    def nees_place(self) -> float:
        return Gaussian(self.error[:2], self.told.state.covariance[:2, :2]).mahalanobis_squared(
            np.zeros(2)
        )


def room(seed: int, seconds: float = 35.0, movers: int = 3, standing: int = 3) -> list[Sample]:
    """A walk past things in a room; the robot's pose errs slowly, and so do half-seen shapes."""
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
        keep = math.exp(-dt / MEMORY_S)
        fresh = math.sqrt(1 - keep**2)
        pose_error = keep * pose_error + fresh * rng.normal(size=3) * POSE_SIGMA
        wander = keep * wander + fresh * rng.normal(size=(n, 2)) * WANDER_M
        true = Pose2(-1.5 + 0.03 * t, -0.2, 0.05 * math.sin(frame / 10))
        believed = Gaussian(true.vector - pose_error, np.diag(POSE_SIGMA**2))
        there = true.inverse().apply(places + wander) + rng.normal(size=(n, 2)) * NOISE_M
        detections = [seen_at(*p) for p in there if rng.random() < 0.95]
        tracker.update(t, detections, believed)
        for told in tracker.obstacles:
            i = int(np.argmin(np.linalg.norm(places - told.position, axis=1)))
            error = np.concatenate([places[i], velocity[i]]) - told.state.mean
            samples.append(Sample(t, i < movers, t - turned[i], told, error))
    return samples


@pytest.fixture(scope="module")
def rooms() -> list[list[Sample]]:
    return [room(seed) for seed in range(6)]


def test_places_err_as_much_as_their_covariances_say(rooms):
    """Each thing of a room counts once; its frames are correlated."""
    low, high = band(2, 6 * len(rooms))
    settled = [s.nees_place for r in rooms for s in r if s.age_s > 2 and s.since_turn_s > 3]
    assert low < np.mean(settled) < high


def test_velocities_of_movers_are_known_to_two_centimetres_a_second(rooms):
    moving = [s for r in rooms for s in r if s.mover and s.age_s > 4 and s.since_turn_s > 3]
    assert len(moving) > 600
    rmse = math.sqrt(np.mean([s.error[2:] @ s.error[2:] for s in moving]))
    assert rmse < 0.02
    normalised = [
        Gaussian(s.error[2:], s.told.state.covariance[2:, 2:]).mahalanobis_squared(np.zeros(2))
        for s in moving
    ]
    assert 0.4 < np.mean(normalised) < 2.6


def test_a_thing_that_stands_is_told_to_stand(rooms):
    standing = [s for r in rooms for s in r if not s.mover and s.age_s > 4]
    assert np.mean([s.told.moving > 0.5 for s in standing]) < 0.02
    assert math.sqrt(np.mean([s.told.velocity @ s.told.velocity for s in standing])) < 0.005


def test_a_thing_that_moves_is_told_to_move_also_while_it_turns(rooms):
    moving = [s for r in rooms for s in r if s.mover and s.age_s > 6]
    assert np.mean([s.told.moving > 0.5 for s in moving]) > 0.9
    turning = [s for s in moving if 0 <= s.since_turn_s < 3]
    assert np.mean([s.told.moving > 0.5 for s in turning]) > 0.85


def test_the_probability_of_moving_is_not_boastful(rooms):
    """Of things said to move with 90 % hardly any stand; of those said to stand, hardly any move."""
    told = [s for r in rooms for s in r if s.age_s > 1]
    sure = [s.mover for s in told if s.told.moving > 0.9]
    assert np.mean(sure) > 0.95
    still = [s.mover for s in told if s.told.moving < 0.1]
    assert np.mean(still) < 0.05


def test_a_reversal_is_followed_within_three_seconds(rooms):
    after = [s for r in rooms for s in r if s.mover and s.age_s > 6]
    late = [s for s in after if 2.0 <= s.since_turn_s < 3.5]
    assert len(late) > 20
    assert math.sqrt(np.mean([s.error[2:] @ s.error[2:] for s in late])) < 0.035
    assert np.mean([float(np.linalg.norm(s.error[:2])) < 0.1 for s in after]) > 0.97


def test_tracks_are_not_lost_and_born_again(rooms):
    numbers = [len({s.told.track for s in samples}) for samples in rooms]
    assert np.mean(numbers) <= 6.5  # six things; one may walk through another


def test_a_place_seen_a_hundred_times_is_no_surer_than_the_place_of_the_robot():
    sigma = 0.05
    robot = Gaussian(np.array([0.0, 0.0, 0.3]), np.diag([sigma, sigma, 0.02]) ** 2)
    tracker = ObstacleTracker()
    for k in range(100):
        tracker.update(0.3 * k, [seen_at(1.0, 0.2, sigma_m=0.005)], robot)
    (told,) = tracker.obstacles
    assert np.linalg.eigvalsh(told.state.covariance[:2, :2])[0] > (0.6 * sigma) ** 2


def test_half_seen_furniture_is_not_taken_for_a_mover():
    """Its middle is drawn toward us and comes round as we pass, or grows into the picture."""
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


def test_what_should_be_in_view_and_is_not_dies_and_what_is_hidden_lives():
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


def test_what_is_half_seen_where_a_track_is_keeps_it_and_what_is_half_seen_elsewhere_does_not():
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
        for k in range(1, 6):  # whole once, then cut off, then whole: as a turning head shows it
            tracker.update(0.3 * k, [], robot, all_of_them, [part])
        tracker.update(1.8, [whole], robot, all_of_them)
        assert len(tracker.obstacles) == alive
        assert not alive or np.linalg.norm(tracker.obstacles[0].position - thing) < 0.02


def test_a_mover_that_is_only_ever_seen_in_part_is_still_followed():
    """Close by, the border of the view cuts it for longer than a lost track lives."""
    rng = np.random.default_rng(5)
    speed, tracker = np.array([-0.02, 0.03]), ObstacleTracker()
    nees = []
    for k in range(80):
        t = 0.3 * k
        true = np.array([0.6, -0.3]) + speed * t
        if k < 15:
            noise = NOISE_M * rng.standard_normal(2)
            tracker.update(t, [seen_at(*(true + noise))], SURE)
        else:  # its lower left is hidden: what is seen is small, and off by a third of its width
            part = seen_at(*(true + np.array([0.04, 0.05])), radius_m=0.06)
            tracker.update(t, [], SURE, partly=[part])
        if k > 40:
            (told,) = tracker.obstacles
            assert told.seen_s == t
            assert np.linalg.norm(told.position - true) < 0.1
            here = Gaussian(told.position - true, told.state.covariance[:2, :2])
            nees.append(here.mahalanobis_squared(np.zeros(2)))
    assert np.mean(nees) < 4.0


def test_a_part_of_a_mover_counts_although_cut_off_furniture_lies_over_its_track_too():
    tracker = ObstacleTracker()
    for k in range(6):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    table, part = seen_at(1.1, 0.2, radius_m=0.3), seen_at(1.04, 0.0, radius_m=0.06)
    tracker.update(1.8, [], SURE, partly=[table, part])
    (told,) = tracker.obstacles
    assert told.seen_s == 1.8


def test_furniture_seen_in_part_keeps_a_track_but_does_not_teach_it():
    tracker = ObstacleTracker()
    for k in range(6):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    (before,) = tracker.obstacles
    for k in range(6, 12):
        tracker.update(0.3 * k, [], SURE, partly=[seen_at(1.15, 0.2, radius_m=0.3)])
    (after,) = tracker.obstacles
    assert after.seen_s == before.seen_s
    assert np.linalg.norm(after.position - before.position) < 0.01


def test_a_single_glimpse_is_not_believed():
    tracker = ObstacleTracker()
    tracker.update(0.0, [seen_at(1.0, 0.0)], SURE)
    assert tracker.obstacles == []
    for k in range(1, 3):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    assert [o.track for o in tracker.obstacles] == [1]


def test_the_moments_of_a_turning_speed_are_those_of_simulated_ones():
    rng = np.random.default_rng(5)
    dt, every_s, n = 0.02, 3.0, 20000
    sign, place, flips = np.ones(n), np.zeros(n), np.zeros(n)
    for _ in range(200):  # 4 s
        place += 0.5 * dt * sign
        flip = rng.random(n) < dt / every_s
        sign, flips = np.where(flip, -sign, sign), flips + flip
        place += 0.5 * dt * sign
    told = turning(4.0, every_s)
    assert told.straight == pytest.approx(np.mean(flips == 0), abs=0.02)
    place, sign = place[flips > 0], sign[flips > 0]
    assert told.move_s == pytest.approx(place.mean(), abs=0.05)
    assert told.keep == pytest.approx(sign.mean(), abs=0.03)
    np.testing.assert_allclose(told.noise, np.cov(place, sign), rtol=0.05)


def test_out_of_sight_a_mover_may_have_turned_and_its_covariance_says_so():
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
        (told,) = tracker.obstacles
        place_nees.append(
            Gaussian(told.state.mean[:2], told.state.covariance[:2, :2]).mahalanobis_squared(place)
        )
    # heavier tails than a Gaussian: either gone straight on, or all the way back
    assert 0.8 < np.mean(place_nees) < 3.0
    assert np.mean(np.array(place_nees) < 5.99) > 0.88


def test_what_stands_is_still_where_it_was_seen_last():
    rng = np.random.default_rng(3)
    tracker = ObstacleTracker(TrackerConfig(oldest_s=30.0))
    for k in range(40):
        tracker.update(
            0.3 * k, [seen_at(*(np.array([1.0, 0.2]) + rng.normal(size=2) * 0.01))], SURE
        )
    (before,) = tracker.obstacles
    for k in range(40, 100):
        tracker.update(0.3 * k, [], SURE)
    (after,) = tracker.obstacles
    assert after.moving < 0.1
    np.testing.assert_allclose(after.position, before.position, atol=4e-3)  # seen to 10 mm
    assert np.linalg.eigvalsh(after.state.covariance[:2, :2])[-1] < 0.06**2


def test_nothing_is_remembered_for_ever():
    tracker = ObstacleTracker(TrackerConfig(oldest_s=5.0))
    for k in range(5):
        tracker.update(0.3 * k, [seen_at(1.0, 0.0)], SURE)
    tracker.update(6.0, [], SURE)
    assert len(tracker.obstacles) == 1
    tracker.update(6.5, [], SURE)
    assert tracker.obstacles == []


def test_what_is_large_or_not_a_number_is_no_obstacle_to_follow():
    tracker = ObstacleTracker()
    bad = [
        seen_at(1.0, 0.0, radius_m=0.5),
        seen_at(math.nan, 0.0),
        Detection(np.array([2.0, 1.0]), np.full((2, 2), math.inf), 0.1),
    ]
    for k in range(5):
        tracker.update(0.3 * k, bad, SURE)
    assert tracker.obstacles == []


def test_two_that_pass_each_other_keep_their_numbers():
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
def test_matching_is_as_full_and_as_cheap_as_trying_everything(cost):
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


def test_a_track_begins_as_uncertain_as_it_is():
    """Sampled poses and sampled detections against the covariance at birth."""
    rng = np.random.default_rng(1)
    robot = Gaussian(np.array([1.0, -0.5, 0.7]), np.diag([0.03, 0.02, 0.03]) ** 2)
    seen = Detection(np.array([1.5, 0.4]), np.diag([0.02, 0.01]) ** 2, 0.1)
    poses = rng.multivariate_normal(robot.mean, robot.covariance, 20000)
    places = rng.multivariate_normal(seen.position, seen.covariance, 20000)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    world = poses[:, :2] + np.stack(
        [c * places[:, 0] - s * places[:, 1], s * places[:, 0] + c * places[:, 1]], axis=-1
    )
    told = Track(seen, robot, TrackConfig(shape_per_m=0.0)).state
    P = told.covariance[:2, :2]
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(told.mean[:2], world.mean(axis=0), atol=3e-3)
    np.testing.assert_allclose(np.cov(world.T) / size, P / size, atol=0.05)


def peer(track: Track, dt: float, keep: float) -> UnscentedKalmanFilter:
    """The library's filter, in the state of a track."""

    def flow(x: np.ndarray, _: float) -> np.ndarray:
        return np.concatenate([x[:2] + dt * x[2:4], x[2:4], keep * x[4:]])

    points = MerweScaledSigmaPoints(7, spread(7), 2.0, 0.0)
    twin = UnscentedKalmanFilter(7, 2, dt, relative_position, flow, points)
    twin.x, twin.P, twin.Q = track.whole.mean, track.whole.covariance, np.zeros((7, 7))
    return twin


def followed() -> Track:
    """A track of four sightings from a place that is not well known."""
    robot = Gaussian(np.array([0.2, -0.1, 0.4]), np.diag([0.02, 0.03, 0.05]) ** 2)
    track = Track(seen_at(1.0, 0.5), robot, TrackConfig())
    for k in range(4):
        track.predict(0.3, robot)
        track.update(seen_at(1.0 + 0.01 * k, 0.5))
    return track


def test_moving_on_by_matrices_is_moving_on_by_sigma_points():
    track, dt, keep = followed(), 0.3, math.exp(-0.3 / MEMORY_S)
    twin = peer(track, dt, keep)
    twin.predict()
    track.config = TrackConfig(acceleration_mps2=1e-12)
    track.radius_m = 0.0  # nothing wanders
    track.predict(dt, Gaussian(np.zeros(3), np.zeros((3, 3))))
    np.testing.assert_allclose(track.whole.mean, twin.x, atol=1e-9)
    np.testing.assert_allclose(track.whole.covariance, twin.P, atol=1e-9)
    assert math.isclose(spread(7) ** 2 * 7, 3.0)


def test_learning_is_that_of_the_library():
    track, robot = followed(), np.array([0.25, -0.08, 0.45])
    track.predict(0.3, Gaussian(robot, np.diag([0.02, 0.03, 0.05]) ** 2))
    twin = peer(track, 0.3, 1.0)
    twin.sigmas_f = twin.points_fn.sigma_points(twin.x, twin.P)
    seen = Detection(np.array([1.0, 0.47]), np.array([[4e-4, 1e-4], [1e-4, 2e-4]]), RADIUS_M)
    surprise = track.update(seen)
    twin.update(seen.position, R=seen.covariance, robot=robot)
    np.testing.assert_allclose(track.whole.mean, twin.x, atol=1e-9)
    np.testing.assert_allclose(track.whole.covariance, twin.P, atol=1e-9)
    assert math.isclose(surprise.nis, float(twin.y @ twin.SI @ twin.y), rel_tol=1e-9)


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
def test_no_history_breaks_a_covariance(history, dt):
    tracker = ObstacleTracker(TrackerConfig(hits_to_show=1))
    for k, things in enumerate(history):
        detections = [
            Detection(np.array([x, y]), np.eye(2) * v**2, r, 0.1) for x, y, r, v in things
        ]
        tracker.update(k * dt, detections, SURE)
        for told in tracker.obstacles:
            assert np.all(np.isfinite(told.state.mean))
            np.linalg.cholesky(told.state.covariance)
            assert 0.0 <= told.moving <= 1.0


def test_the_same_detections_give_the_same_bits():
    first, second = room(3, seconds=8.0), room(3, seconds=8.0)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.told.state.mean, b.told.state.mean)
        np.testing.assert_array_equal(a.told.state.covariance, b.told.state.covariance)


@pytest.mark.parametrize(
    ("kind", "change", "said"),
    [
        (TrackerConfig, {"new_per_m2": 0.0}, r"new_per_m2=0\.0 must be"),
        (TrackerConfig, {"hits_to_show": 0}, "hits_to_show=0 must be at least 1"),
        (TrackConfig, {"speed_sigma_mps": -1.0}, r"speed_sigma_mps=-1\.0 must be positive"),
        (TrackConfig, {"moving_prior": 1.0}, r"moving_prior=1\.0 must lie"),
        (TrackConfig, {"shape_per_m": -0.1}, r"shape_per_m=-0\.1 must not be negative"),
    ],
)
def test_settings_that_cannot_be_are_refused(kind, change, said):
    with pytest.raises(ConfigError, match=said):
        kind(**change)


def test_a_lost_mover_is_not_found_again_in_furniture_of_another_size():
    """It walks behind something; where it might be by now stands a wider thing, seen for the first time."""
    tracker = ObstacleTracker()
    for k in range(20):
        tracker.update(0.3 * k, [seen_at(1.0 + 0.012 * k, 0.0)], SURE)
    (mover,) = tracker.obstacles
    assert mover.moving > 0.5
    for k in range(40, 44):  # six seconds later, a hand beyond where it should be
        tracker.update(0.3 * k, [seen_at(1.0 + 0.012 * 40 + 0.15, 0.0, radius_m=0.15)], SURE)
    numbers = {o.track: o.radius_m for o in tracker.obstacles}
    assert len(numbers) == 2
    assert numbers[mover.track] == pytest.approx(RADIUS_M, abs=0.01)


def test_two_cameras_of_one_instant_tell_one_after_the_other():
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
