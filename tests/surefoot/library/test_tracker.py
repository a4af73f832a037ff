"""The public tracker against straight motion."""

from __future__ import annotations

import numpy as np
import pytest

import surefoot

SIGMA_M, STEP_S = 0.01, 0.3
NOISE = np.eye(2) * SIGMA_M**2


def tracked(seed: int, velocity: tuple[float, float], frames: int = 25) -> surefoot.Obstacle:
    """A track after a straight motion from (1, 0.5), seen with noise."""
    rng = np.random.default_rng(seed)
    tracker = surefoot.Tracker()
    for k in range(frames):
        place = np.array([1.0, 0.5]) + k * STEP_S * np.array(velocity)
        found = tracker.update(k * STEP_S, [place + rng.normal(0, SIGMA_M, 2)], NOISE)
    (track,) = found
    return track


def test_a_straight_motion_is_followed_within_its_covariance():
    distances = []
    for seed in range(10):
        track = tracked(seed, (0.08, -0.04))
        assert track.moving > 0.9
        end = np.array([1.0, 0.5]) + 24 * STEP_S * np.array([0.08, -0.04])
        true = np.array([*end, 0.08, -0.04])
        distances.append(track.state.mahalanobis_squared(true))
    assert np.mean(distances) < 4.0 + 3.0 * np.sqrt(2 * 4.0 / 10)  # NEES of four numbers


def test_a_static_obstacle_seldom_seems_to_move():
    moving = [tracked(seed, (0.0, 0.0)).moving for seed in range(20)]
    assert np.mean(np.array(moving) > 0.5) <= 0.1


def test_the_pose_of_the_robot_puts_tracks_into_the_world():
    tracker = surefoot.Tracker()
    pose = surefoot.Gaussian(np.array([2.0, 1.0, np.pi / 2]), np.diag([1e-4, 1e-4, 1e-4]))
    for k in range(5):
        found = tracker.update(0.3 * k, [(1.0, 0.0)], NOISE, pose=pose)
    np.testing.assert_allclose(found[0].position, [2.0, 2.0], atol=0.02)


def test_each_obstacle_keeps_its_number():
    tracker = surefoot.Tracker(hits_to_show=2)
    for k in range(5):
        found = tracker.update(0.3 * k, [(1.0, 0.5), (1.0, -0.5)], NOISE)
    assert [track.track for track in found] == [1, 2]
    assert [track.track for track in tracker.update(1.5, [], NOISE)] == [1, 2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stamp_s": 0.0}, "does not follow"),
        ({"positions": [(1.0, 0.0, 0.0)]}, "positions"),
        ({"positions": [(np.nan, 0.0)]}, "NaN"),
        ({"covariances": -NOISE}, "negative eigenvalue"),
        ({"radii_m": 1.0}, "max_radius_m"),
    ],
)
def test_wrong_detections_are_refused(change, message):
    tracker = surefoot.Tracker()
    tracker.update(0.0, [(1.0, 0.0)], NOISE)
    given = {"stamp_s": 1.0, "positions": [(1.0, 0.0)], "covariances": NOISE, "radii_m": 0.1}
    with pytest.raises(surefoot.InputError, match=message):
        tracker.update(**{**given, **change})


def test_an_unknown_setting_is_refused_with_the_known_ones():
    with pytest.raises(surefoot.InputError, match="max_radius_m"):
        surefoot.Tracker(speed=1.0)
