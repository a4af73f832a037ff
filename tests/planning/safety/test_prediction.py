"""Motion patterns learnt from obstacles that go back and forth, against the true motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.safety import _prediction_kernels
from planning.safety.prediction import DRIFT_MPS, REMEMBERED_S, MotionPatterns

EVERY_S = 0.325


def back_and_forth(start, direction, length, speed, seconds):
    """Place and velocity, in closed form."""
    phase = (speed * seconds) % (2 * length)
    forth = phase <= length
    at = phase if forth else 2 * length - phase
    return start + at * direction, (speed if forth else -speed) * direction


def seen(place, velocity, stamp_s, track=1):
    P = np.diag([1e-4, 1e-4, 1e-5, 1e-5])
    state = Gaussian(np.concatenate([place, velocity]), P)
    return Obstacle(state, 0.10, 0.4, track, 1.0, stamp_s, 0.0)


def learn(patterns, start, direction, length, speed, begin_s, end_s, track=1, noise=None):
    for stamp in np.arange(begin_s, end_s, EVERY_S):
        place, velocity = back_and_forth(start, direction, length, speed, stamp)
        if noise is not None:
            place = place + 0.02 * noise.standard_normal(2)
        patterns.update([seen(place, velocity, stamp, track)])


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-math.pi, math.pi), st.floats(0.4, 2.0), st.floats(0.03, 0.15), st.integers(0, 999)
)
def test_after_one_period_the_path_is_predicted_for_30_s(angle, length, speed, seed):
    rng = np.random.default_rng(seed)
    start, direction = rng.uniform(-2, 2, 2), np.array([math.cos(angle), math.sin(angle)])
    patterns, round_s = MotionPatterns(), 2 * length / speed
    learn(patterns, start, direction, length, speed, 0.0, 1.2 * round_s)
    now = 1.2 * round_s
    times = np.linspace(0.0, min(round_s, 30.0), 40)
    place, velocity = back_and_forth(start, direction, length, speed, now)
    forecast = patterns.forecast(seen(place, velocity, now), now, times)
    true = np.array([back_and_forth(start, direction, length, speed, now + t)[0] for t in times])
    assert np.hypot(*(forecast.places - true).T).max() < 0.08
    assert forecast.since_seen


def test_noise_of_two_centimetres_leaves_the_forecast_within_15():
    rng = np.random.default_rng(3)
    patterns, start, direction = MotionPatterns(), np.array([1.0, 0.5]), np.array([0.6, 0.8])
    learn(patterns, start, direction, 1.2, 0.06, 0.0, 60.0, noise=rng)
    times = np.linspace(0.0, 15.0, 30)
    place, velocity = back_and_forth(start, direction, 1.2, 0.06, 60.0)
    forecast = patterns.forecast(seen(place, velocity, 60.0), 60.0, times)
    true = np.array([back_and_forth(start, direction, 1.2, 0.06, 60.0 + t)[0] for t in times])
    assert np.hypot(*(forecast.places - true).T).max() < 0.15


def test_an_uncertain_speed_after_a_reversal_is_replaced_by_that_of_the_line():
    patterns, start, direction, speed = (
        MotionPatterns(),
        np.array([0.0, 1.0]),
        np.array([1.0, 0.0]),
        0.05,
    )
    learn(patterns, start, direction, 1.0, speed, 0.0, 19.0)  # on the way out
    place = start + 0.98 * direction
    vague = np.diag([1e-4, 1e-4, 0.03**2, 0.03**2])
    slow = Gaussian(np.concatenate([place, -0.02 * direction]), vague)
    times = np.array([5.0])
    turned = Obstacle(slow, 0.10, 0.4, 1, 1.0, 21.0, 0.0)
    gone = place - patterns.forecast(turned, 21.0, times).places[0]
    assert gone[0] == pytest.approx(5.0 * speed, rel=0.15)
    sure = Gaussian(slow.mean, np.diag([1e-4, 1e-4, 1e-8, 1e-8]))  # the track is certain and slower
    turned = Obstacle(sure, 0.10, 0.4, 1, 1.0, 21.0, 0.0)
    gone = place - patterns.forecast(turned, 21.0, times).places[0]
    assert gone[0] == pytest.approx(5.0 * 0.02, rel=0.05)


def test_without_a_line_the_forecast_is_straight_and_its_path_unknown():
    times = np.linspace(0.5, 5.0, 10)
    one = seen(np.array([1.0, 2.0]), np.array([0.05, 0.0]), 3.0)
    forecast = MotionPatterns().forecast(one, 3.0, times)
    np.testing.assert_allclose(forecast.places[:, 0], 1.0 + 0.05 * times)
    assert not forecast.since_seen


def test_a_new_track_on_a_known_line_inherits_it():
    patterns, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(patterns, start, direction, 1.0, 0.08, 0.0, 30.0, track=1)
    place, velocity = back_and_forth(start, direction, 1.0, 0.08, 45.0)
    again = seen(place, velocity, 45.0, track=9)
    forecast = patterns.forecast(again, 45.0, np.array([8.0]))
    true, _ = back_and_forth(start, direction, 1.0, 0.08, 53.0)
    np.testing.assert_allclose(forecast.places[0], true, atol=0.08)


def test_an_obstacle_out_of_sight_is_predicted_along_its_line():
    patterns, start, direction = MotionPatterns(), np.zeros(2), np.array([0.0, 1.0])
    learn(patterns, start, direction, 1.0, 0.08, 0.0, 30.0)
    (remembered,) = patterns.remembered([], 45.0)
    true, _ = back_and_forth(start, direction, 1.0, 0.08, 45.0)
    np.testing.assert_allclose(patterns.propagated(remembered, 45.0).position, true, atol=0.10)
    assert patterns.remembered([], 30.0 + REMEMBERED_S + 1.0) == []


def test_the_doubt_of_a_remembered_obstacle_grows_along_its_line_only():
    patterns, direction = MotionPatterns(), np.array([0.6, 0.8])
    learn(patterns, np.zeros(2), direction, 1.0, 0.08, 0.0, 30.0)
    across = np.array([-0.8, 0.6])
    for later_s in (5.0, 25.0):
        (remembered,) = patterns.remembered([], 30.0 + later_s)
        P = remembered.state.covariance[:2, :2]
        unseen_s = 30.0 + later_s - remembered.seen_s
        along_m = math.hypot(0.05, 0.05 + DRIFT_MPS * unseen_s)
        assert math.sqrt(direction @ P @ direction) == pytest.approx(along_m, rel=1e-3)
        assert math.sqrt(across @ P @ across) == pytest.approx(0.05, rel=0.02)


def test_an_obstacle_with_a_track_is_not_remembered_twice():
    patterns, start, direction = MotionPatterns(), np.zeros(2), np.array([0.0, 1.0])
    learn(patterns, start, direction, 1.0, 0.08, 0.0, 30.0)
    place, velocity = back_and_forth(start, direction, 1.0, 0.08, 31.0)
    assert patterns.remembered([seen(place, velocity, 31.0, track=7)], 31.0) == []


def test_an_obstacle_on_a_line_with_an_unknown_end_is_not_remembered():
    patterns, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(patterns, start, direction, 2.0, 0.08, 0.0, 10.0)
    assert len(patterns.lines) == 1
    assert patterns.remembered([], 20.0) == []


def test_a_turning_point_is_removed_once_passed():
    patterns, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(patterns, start, direction, 0.6, 0.08, 0.0, 12.0)
    assert np.isfinite([patterns.lines[0].turn_low, patterns.lines[0].turn_high]).any()
    for k, x in enumerate(np.arange(0.3, 1.2, 0.026)):
        stamp = 12.0 + EVERY_S * k
        patterns.update([seen(np.array([x, 0.0]), np.array([0.08, 0.0]), stamp)])
    forecast = patterns.forecast(
        seen(np.array([0.5, 0.0]), np.array([0.08, 0.0]), 50.0), 50.0, np.array([5.0])
    )
    assert forecast.places[0, 0] > 0.8


def test_a_static_obstacle_creates_no_line():
    patterns = MotionPatterns()
    for stamp in np.arange(0.0, 5.0, EVERY_S):
        one = seen(np.array([1.0, 0.0]), np.array([0.004, 0.0]), stamp)
        patterns.update([one])
    assert patterns.lines == []


NAN = math.nan
ON_THE_LINE = [  # at the sighting, turning points; then where and in which sense after 1, 4.2 and 9 m
    (0.5, (NAN, NAN), (1.5, 4.7, 9.5), (1, 1, 1)),
    (0.5, (NAN, 2.0), (1.5, -0.7, -5.5), (1, -1, -1)),
    (0.5, (-1.0, NAN), (1.5, 4.7, 9.5), (1, 1, 1)),
    (2.5, (NAN, 2.0), (1.5, -1.7, -6.5), (-1, -1, -1)),  # seen beyond the turn: it turns there
    (0.5, (0.0, 2.0), (1.5, 0.7, 1.5), (1, 1, 1)),
    (2.5, (0.0, 2.0), (1.0, 1.8, 1.0), (-1, -1, -1)),
]


@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize(("start", "turns", "true", "senses"), ON_THE_LINE)
def test_an_obstacle_turns_where_the_turning_points_are(start, turns, true, senses, mirror):
    if mirror < 0.0:
        turns = (-turns[1], -turns[0])
    direction, speed, times = np.array([0.6, 0.8]), 0.5, np.array([2.0, 8.4, 18.0])
    places, velocities = np.empty((3, 2)), np.empty((3, 2))
    aside, at = np.array([-0.08, 0.06]), mirror * start  # it stays on its parallel to the line
    _prediction_kernels.back_and_forth(
        at * direction + aside, mirror, speed, times, direction, at, turns, places, velocities
    )
    np.testing.assert_allclose(places, mirror * np.outer(true, direction) + aside, atol=1e-9)
    np.testing.assert_allclose(velocities, mirror * speed * np.outer(senses, direction), atol=1e-9)
