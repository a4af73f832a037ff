"""The public tracker against straight motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import surefoot
from perception.obstacles.forecast import Forecast, forecast

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


def test_a_walker_seen_with_noisy_sizes_keeps_one_number():
    """As by a laser scanner: size and place come from the same few points, and err alike."""
    numbers = set()
    for seed in range(5):
        rng, tracker = np.random.default_rng(seed), surefoot.Tracker(speed_sigma_mps=0.7)
        for k in range(40):
            place = np.array([0.2 * k - 4.0, 2.0]) + rng.normal(0, 0.03, 2)
            radius = 0.22 + rng.normal(0, 0.03)
            found = tracker.update(0.2 * k, [place], np.eye(2) * 0.03**2, radius)
        assert len(found) == 1
        numbers.add(found[0].track)
    assert numbers == {1}


def test_a_walker_seen_by_one_leg_or_two_keeps_one_number():
    rng, tracker = np.random.default_rng(0), surefoot.Tracker(speed_sigma_mps=0.7)
    for k in range(60):
        one_leg = rng.random() < 0.5
        aside = rng.choice([-0.1, 0.1]) if one_leg else 0.0
        place = np.array([0.2 * k - 6.0, 2.0 + aside]) + rng.normal(0, 0.02, 2)
        radius, spread = (0.07, 0.1) if one_leg else (0.17, 0.03)
        found = tracker.update(0.2 * k, [place], np.eye(2) * spread**2, radius, radius_sigma_m=0.1)
    assert [track.track for track in found] == [1]


def test_what_has_left_a_visible_place_loses_its_track():
    for seen, left in ((True, 0), (False, 1)):
        tracker = surefoot.Tracker(misses_to_die=4)
        for k in range(4):
            tracker.update(0.3 * k, [(1.0, 0.5)], NOISE)
        for k in range(4, 8):
            assert len(tracker.obstacles) == 1
            tracker.update(0.3 * k, [], NOISE, visible=lambda places, s=seen: [s] * len(places))
        assert len(tracker.obstacles) == left


def test_a_wrong_answer_about_visible_places_is_refused():
    tracker = surefoot.Tracker()
    tracker.update(0.0, [(1.0, 0.5)], NOISE)
    with pytest.raises(surefoot.InputError, match=r"visible returned float64 .* expected booleans"):
        tracker.update(0.3, [], NOISE, visible=lambda places: places[:, 0])


def test_forecasts_of_people_who_turn_every_few_metres_hold_them():
    """1 m/s, a turn every 5 m; the region of 90 % two seconds ahead, after two seconds of sight."""
    rng, inside = np.random.default_rng(0), []
    for _ in range(150):
        tracker, place, times = surefoot.Tracker(speed_sigma_mps=0.7), np.zeros(2), []
        for k in range(21):
            if k == 0 or rng.random() < 0.2 / 5.0:
                angle = rng.uniform(-np.pi, np.pi)
            place = place + 0.2 * np.array([np.cos(angle), np.sin(angle)])
            times.append(place)
            if k <= 10:
                seen = place + rng.normal(0, 0.03, 2)
                found = tracker.update(0.2 * k, [seen], np.eye(2) * 0.03**2, 0.2)
        if len(found) == 1:
            inside.append(_holds(forecast(found[0], np.array([2.0])), times[20], rng))
    assert len(inside) > 130
    assert np.mean(inside) > 0.9 - 3.0 * np.sqrt(0.9 * 0.1 / len(inside))


def _holds(ahead: Forecast, place: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether the smallest region of 90 % of a mixture at its first time holds a place."""
    weights, means, P = (
        ahead.probabilities[0],
        ahead.means[0, :, :2],
        ahead.covariances[0, :, :2, :2],
    )
    parts = [multivariate_normal(m, C) for m, C in zip(means, P, strict=True)]
    drawn = rng.choice(len(weights), 400, p=weights / weights.sum())
    samples = np.array([parts[k].rvs(random_state=rng) for k in drawn])

    def density(x):
        return sum(w * part.pdf(x) for w, part in zip(weights, parts, strict=True))

    return bool(np.mean(density(samples) > density(place)) <= 0.9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stamp_s": 0.0}, "does not follow"),
        ({"positions": [(1.0, 0.0, 0.0)]}, "positions"),
        ({"positions": [(np.nan, 0.0)]}, "NaN"),
        ({"covariances": -NOISE}, "negative eigenvalue"),
        ({"radii_m": 1.0}, "max_radius_m"),
        ({"radius_sigma_m": 0.0}, "radius_sigma_m"),
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


@pytest.mark.parametrize("pause_s", [1e3, 1e5, 1e9])
def test_a_pause_of_any_length_ends_no_tracker(pause_s):
    tracker = surefoot.Tracker(hits_to_show=1, oldest_s=1e9)
    for k in range(4):
        tracker.update(0.1 * k, [(1.0, 0.0)], NOISE)
    tracker.update(pause_s, [(1.0, 0.0)], NOISE)
    assert tracker.obstacles
    for one in tracker.obstacles:
        assert np.isfinite(one.state.covariance).all()
        assert np.linalg.eigvalsh(one.state.covariance).min() > 0.0
