"""Evidence of motion: places left and entered, proof against noise, the velocity that all share."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.obstacles.record import DISPLACED_FRAMES, Record, Snapshot
from perception.obstacles.track import SHAPE_MEMORY_S, UNSURE, Detection, Track, TrackConfig
from perception.obstacles.tracker import ObstacleTracker
from perception.primitives.gaussian import Gaussian

SURE = Gaussian(np.zeros(3), np.eye(3) * 1e-8)
RADIUS_M = 0.1
FRONT = np.array([[0.0, y, 0.2] for y in (-0.03, -0.01, 0.01, 0.03)])


def seen_at(x: float, y: float, sigma_m: float = 0.01, surface: bool = True) -> Detection:
    points = FRONT + np.array([x - RADIUS_M, y, 0.0]) if surface else np.zeros((0, 3))
    return Detection(np.array([x, y]), np.eye(2) * sigma_m**2, RADIUS_M, 0.3, points)


def sight_of(y: float):
    """A frame in which only the obstacle at `y` hides something: everything beside it is seen through."""

    def through(points: np.ndarray) -> tuple[int, int]:
        filled = np.abs(points[:, 1] - y) < RADIUS_M
        return int(np.sum(~filled)), int(np.sum(filled))

    return through


def follow(velocity: float, sight, seconds: float = 8.0) -> float:
    """Largest probability of moving of an obstacle at (1, velocity t); sight(t) is what a frame sees through."""
    tracker, most = ObstacleTracker(), 0.0
    for k in range(round(seconds / 0.2)):
        t = 0.2 * k
        tracker.update(t, [seen_at(1.0, velocity * t)], SURE, through=sight(t))
        most = max([most, *(one.moving for one in tracker.obstacles)])
    return most


def test_an_obstacle_that_leaves_its_place_is_moving():
    assert follow(0.06, lambda t: sight_of(0.06 * t)) > 0.9


def test_a_centre_that_wanders_along_an_obstacle_that_stays_is_not_claimed_to_move():
    """Every place of it remains filled: a long thing of which another part is seen."""
    assert follow(0.06, lambda t: lambda points: (0, len(points))) == UNSURE


def test_places_that_no_frame_shows_leave_the_motion_unsure():
    assert follow(0.06, lambda t: lambda points: (0, 0)) == UNSURE


def test_without_surface_points_the_filter_alone_decides():
    tracker = ObstacleTracker()
    for k in range(40):
        tracker.update(0.2 * k, [seen_at(1.0, 0.012 * k, surface=False)], SURE)
    (one,) = tracker.obstacles
    assert one.moving > 0.9


def test_one_frame_with_a_wrong_pose_is_no_proof_and_a_long_gap_begins_anew():
    track = Track(seen_at(1.0, 0.0), SURE, TrackConfig(moving_prior=0.9))
    for k in range(1, 12):  # a filter that is convinced
        track.predict(0.2, SURE)
        track.update(seen_at(1.0, 0.02 * k))
    assert track.moving > 0.9
    record = Record(track, 1, 0.0, 0.0)
    record.compare(Snapshot.of(seen_at(1.0, 0.0), 0.0, SURE, sight_of(0.0)))
    record.compare(Snapshot.of(seen_at(1.0, 0.3), 0.2, SURE, sight_of(0.3)))
    assert (record.displaced, record.moving) == (1, UNSURE)
    record.compare(Snapshot.of(seen_at(1.0, 0.6), 1.0 + SHAPE_MEMORY_S, SURE, sight_of(0.6)))
    assert record.displaced == 1 < DISPLACED_FRAMES
    record.compare(Snapshot.of(seen_at(1.0, 0.9), 1.2 + SHAPE_MEMORY_S, SURE, sight_of(0.9)))
    assert record.moving > 0.9


@pytest.mark.parametrize("dt", [0.033, 0.1, 0.3])
def test_noise_alone_is_rarely_claimed_to_move(dt):
    """25 frames of a static obstacle, 1 to 2 cm of noise, without surface points."""
    rng, runs, claims = np.random.default_rng(7), 60, 0
    for run in range(runs):
        sigma, tracker = 0.01 + 0.01 * run / runs, ObstacleTracker()
        for k in range(25):
            x, y = np.array([1.5, 0.2]) + sigma * rng.standard_normal(2)
            tracker.update(dt * k, [seen_at(x, y, sigma, surface=False)], SURE)
        claims += any(one.moving > UNSURE for one in tracker.obstacles)
    assert claims <= 4  # expected 1.2 at 2 %; more than 4 in 1 of 100 experiments


def test_an_obstacle_that_shrinks_as_far_as_its_centre_moves_has_not_moved():
    """One edge stays: the visible part of a static thing becomes smaller."""
    tracker = ObstacleTracker()
    for k in range(30):
        radius = 0.3 - 0.004 * k
        centre = np.array([1.5, 0.3 - radius])
        tracker.update(0.2 * k, [Detection(centre, np.eye(2) * 0.01**2, radius, 0.3)], SURE)
    assert max(one.moving for one in tracker.obstacles) <= UNSURE


def test_a_velocity_that_all_obstacles_share_is_that_of_the_camera_and_a_third_one_is_not():
    places = np.array([[1.0, -0.8], [1.5, 0.2], [2.0, 1.0], [1.2, 0.9]])
    for own, movers in ((0.0, 0), (-0.08, 1)):
        tracker = ObstacleTracker()
        for k in range(40):
            t = 0.2 * k
            drift = np.array([0.0, 0.05 * t])
            shift = np.tile(drift, (4, 1))
            shift[3, 0] = own * t
            seen = [seen_at(*place, surface=False) for place in places + shift]
            tracker.update(t, seen, SURE)
        claimed = [one for one in tracker.obstacles if one.moving > UNSURE]
        assert len(claimed) == movers
        assert all(math.dist(one.position, places[3] + shift[3]) < 0.05 for one in claimed)


def test_obstacles_that_go_different_ways_are_not_taken_for_a_wrong_pose():
    starts, claimed = np.array([[1.0, -0.8], [1.5, 0.2], [2.0, 1.0]]), []
    for seed in range(5):
        rng, tracker = np.random.default_rng(seed), ObstacleTracker()
        angles = rng.uniform(-math.pi, math.pi) + np.array([0.0, 1.5, -1.5])
        velocities = 0.04 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        for k in range(60):
            places = starts + 0.25 * k * velocities + 0.015 * rng.standard_normal((3, 2))
            seen = [seen_at(*place, 0.015, surface=False) for place in places]
            tracker.update(0.25 * k, seen, SURE)
            if k > 40:
                claimed += [one.moving > UNSURE for one in tracker.obstacles]
    assert np.mean(claimed) > 0.95
