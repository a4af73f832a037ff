"""Walks among movers: the plain tracker against filterpy, lines of sight, and walks through the real pipeline."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from perception.obstacles.track import Detection
from perception.obstacles.tracker import TrackerConfig
from perception.primitives.gaussian import Gaussian
from perception.primitives.pose import Pose2
from sim.movers.law import MoversConfig
from sim.scene import FloorArea, MovingObject, Scene, StaticObject
from sim.shapes import Box, Cylinder
from surefoot.config.schema import Config
from surefoot.experiments.joint.prediction import DEVELOPMENT, JUDGING, config_of
from surefoot.experiments.support.in_sight import Sightlines
from surefoot.experiments.support.judged_walk import judged
from surefoot.experiments.support.plain_tracker import (
    ACCELERATION,
    SPEED_SIGMA_MPS,
    PlainTracker,
)
from surefoot.experiments.support.watched_walk import watched_walk

HERE = Gaussian(np.zeros(3), np.eye(3) * 1e-12)
COVARIANCE = np.diag([0.0004, 0.0001])


def everywhere(places):
    return np.ones(len(places), np.bool_)


def seen(*place):
    return Detection(np.array(place, float), COVARIANCE, 0.1, 0.4)


def test_the_plain_tracker_is_the_filter_of_filterpy():
    dt, rng = 0.3, np.random.default_rng(0)
    peer = KalmanFilter(4, 2)
    tracker = PlainTracker(TrackerConfig())
    for k in range(20):
        z = np.array([1.0 + 0.1 * k * dt, 0.4]) + 0.01 * rng.standard_normal(2)
        tracker.update(k * dt, [seen(*z)], HERE, everywhere)
        if k == 0:
            peer.x = np.array([z[0], z[1], 0.0, 0.0])
            peer.P = np.diag([*np.diag(COVARIANCE), SPEED_SIGMA_MPS**2, SPEED_SIGMA_MPS**2])
            peer.H, peer.R, peer.F = np.eye(2, 4), COVARIANCE, np.eye(4)
            peer.F[0, 2] = peer.F[1, 3] = dt
            peer.Q = Q_continuous_white_noise(2, dt, ACCELERATION, block_size=2, order_by_dim=False)
            continue
        peer.predict()
        peer.update(z)
    (track,) = tracker.tracks
    np.testing.assert_allclose(track.mean, peer.x, atol=1e-9)
    np.testing.assert_allclose(track.covariance, peer.P, atol=1e-9)
    assert track.moves


def test_the_plain_tracker_keeps_two_that_pass_each_other_apart_and_forgets_who_left():
    tracker = PlainTracker(TrackerConfig())
    for k in range(20):
        tracker.update(0.3 * k, [seen(0.03 * k, 0.2), seen(0.6 - 0.03 * k, -0.2)], HERE, everywhere)
    assert [track.number for track in tracker.tracks] == [1, 2]
    assert [round(track.mean[1], 1) for track in tracker.tracks] == [0.2, -0.2]
    for k in range(20, 30):
        tracker.update(0.3 * k, [], HERE, everywhere)
    assert tracker.tracks == []


def test_sight_ends_at_furniture_at_other_movers_and_at_three_metres():
    extent = (0.0, 0.0, 8.0, 4.0)
    body = (Cylinder((0.0, 0.0, 0.3), 0.1, 0.6),)
    movers = tuple(MovingObject(str(k), (1.0, 1.0), 0.0, 0.1, 1.0, body) for k in range(2))
    board = StaticObject("board", (Box((3.0, 1.0, 0.5), (0.1, 0.8, 1.0)),))
    low = StaticObject("low", (Box((2.0, 3.0, 0.1), (0.1, 0.8, 0.2)),))
    area = (FloorArea("planks/oak", extent),)
    lines = Sightlines(Scene("test", 0, extent, area, (board, low), movers, (), Pose2(), ()))
    eye = (1.0, 1.0)
    assert lines.near(eye, np.array([[2.0, 1.0], [1.0, 3.0]])).tolist() == [True, True]
    assert lines.near(eye, np.array([[3.6, 1.0], [1.0, 3.0]])).tolist() == [False, True]  # board
    assert lines.near(eye, np.array([[1.0, 2.0], [1.0, 3.0]])).tolist() == [True, False]  # behind
    assert lines.near((1.0, 3.0), np.array([[3.0, 3.0], [4.1, 3.0]])).tolist() == [True, False]


def test_a_watched_walk_knows_where_it_is_and_tracks_who_passes():
    config = Config(scene="hall", seed=101, movers=MoversConfig("stream"))
    errors, tracked = [], 0
    for one in watched_walk(config, 10.0):
        assert one.heard is not None
        errors.append(float(np.hypot(*(one.heard.robot.mean[:2] - [one.pose.x, one.pose.y]))))
        movers = np.array([row[1:3] for row in one.truth[:5]])
        tracked += sum(np.hypot(*(movers - t.position).T).min() < 0.2 for t in one.obstacles)
    assert np.mean(errors[-20:]) < 0.03
    assert tracked > 5


def test_the_same_walk_gives_the_same_judgement():
    first, second = (judged(config_of("curves", 100), 8.0) for _ in range(2))
    assert first == second
    assert first.near >= first.viewed >= first.viewed_followed
    both = first + second
    assert both.nees == pytest.approx(2.0 * first.nees)
    assert both.forecasts == tuple(2.0 * n for n in first.forecasts)


def test_no_law_is_for_development_and_for_judging():
    assert not set(DEVELOPMENT) & set(JUDGING)
    assert len(JUDGING) == 8
