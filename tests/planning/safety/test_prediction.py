"""What is learnt from movers that go to and fro, against the motion they are made with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from perception.primitives.gaussian import Gaussian
from perception.primitives.obstacle import Obstacle
from planning.safety.prediction import MotionPatterns, PredictionConfig

EVERY_S = 0.325


def to_and_fro(start, direction, length, speed, seconds):
    """Place and velocity, in closed form."""
    phase = (speed * seconds) % (2 * length)
    forth = phase <= length
    at = phase if forth else 2 * length - phase
    return start + at * direction, (speed if forth else -speed) * direction


def seen(place, velocity, stamp_s, track=1):
    P = np.diag([1e-4, 1e-4, 1e-5, 1e-5])
    state = Gaussian(np.concatenate([place, velocity]), P)
    return Obstacle(state, 0.10, 0.4, track, 1.0, stamp_s, 0.0)


def learn(habits, start, direction, length, speed, begin_s, end_s, track=1, noise=None):
    for stamp in np.arange(begin_s, end_s, EVERY_S):
        place, velocity = to_and_fro(start, direction, length, speed, stamp)
        if noise is not None:
            place = place + 0.02 * noise.standard_normal(2)
        habits.learn([seen(place, velocity, stamp, track)])


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-math.pi, math.pi), st.floats(0.4, 2.0), st.floats(0.03, 0.15), st.integers(0, 999)
)
def test_after_a_whole_round_the_way_is_known_for_long(angle, length, speed, seed):
    rng = np.random.default_rng(seed)
    start, direction = rng.uniform(-2, 2, 2), np.array([math.cos(angle), math.sin(angle)])
    habits, round_s = MotionPatterns(), 2 * length / speed
    learn(habits, start, direction, length, speed, 0.0, 1.2 * round_s)
    now = 1.2 * round_s
    times = np.linspace(0.0, min(round_s, 30.0), 40)
    place, velocity = to_and_fro(start, direction, length, speed, now)
    forecast = habits.forecast(seen(place, velocity, now), now, times)
    true = np.array([to_and_fro(start, direction, length, speed, now + t)[0] for t in times])
    assert np.hypot(*(forecast.places - true).T).max() < 0.08
    assert forecast.learnt.all()


def test_noise_of_two_centimetres_blurs_it_little():
    rng = np.random.default_rng(3)
    habits, start, direction = MotionPatterns(), np.array([1.0, 0.5]), np.array([0.6, 0.8])
    learn(habits, start, direction, 1.2, 0.06, 0.0, 60.0, noise=rng)
    times = np.linspace(0.0, 15.0, 30)
    place, velocity = to_and_fro(start, direction, 1.2, 0.06, 60.0)
    forecast = habits.forecast(seen(place, velocity, 60.0), 60.0, times)
    true = np.array([to_and_fro(start, direction, 1.2, 0.06, 60.0 + t)[0] for t in times])
    assert np.hypot(*(forecast.places - true).T).max() < 0.15


def test_a_speed_that_is_vague_after_a_turn_is_taken_from_the_line():
    habits, start, direction, speed = (
        MotionPatterns(),
        np.array([0.0, 1.0]),
        np.array([1.0, 0.0]),
        0.05,
    )
    learn(habits, start, direction, 1.0, speed, 0.0, 19.0)  # on the way out
    place = start + 0.98 * direction
    vague = np.diag([1e-4, 1e-4, 0.03**2, 0.03**2])
    slow = Gaussian(np.concatenate([place, -0.02 * direction]), vague)
    times = np.array([5.0])
    turned = Obstacle(slow, 0.10, 0.4, 1, 1.0, 21.0, 0.0)
    gone = place - habits.forecast(turned, 21.0, times).places[0]
    assert gone[0] == pytest.approx(5.0 * speed, rel=0.15)
    sure = Gaussian(slow.mean, np.diag([1e-4, 1e-4, 1e-8, 1e-8]))  # it really is slower today
    turned = Obstacle(sure, 0.10, 0.4, 1, 1.0, 21.0, 0.0)
    gone = place - habits.forecast(turned, 21.0, times).places[0]
    assert gone[0] == pytest.approx(5.0 * 0.02, rel=0.05)


def test_what_was_never_seen_goes_straight_on_and_may_turn_anywhere():
    times = np.linspace(0.5, 5.0, 10)
    one = seen(np.array([1.0, 2.0]), np.array([0.05, 0.0]), 3.0)
    forecast = MotionPatterns().forecast(one, 3.0, times)
    np.testing.assert_allclose(forecast.places[:, 0], 1.0 + 0.05 * times)
    assert not forecast.learnt.any()
    assert not forecast.since_seen


def test_a_track_forgotten_and_born_again_inherits_its_line():
    habits, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(habits, start, direction, 1.0, 0.08, 0.0, 30.0, track=1)
    place, velocity = to_and_fro(start, direction, 1.0, 0.08, 45.0)
    again = seen(place, velocity, 45.0, track=9)
    forecast = habits.forecast(again, 45.0, np.array([8.0]))
    true, _ = to_and_fro(start, direction, 1.0, 0.08, 53.0)
    np.testing.assert_allclose(forecast.places[0], true, atol=0.08)


def test_a_mover_lost_from_sight_is_remembered_where_its_line_leads_it():
    habits, start, direction = MotionPatterns(), np.zeros(2), np.array([0.0, 1.0])
    learn(habits, start, direction, 1.0, 0.08, 0.0, 30.0)
    (ghost,) = habits.remembered([], 45.0)
    true, _ = to_and_fro(start, direction, 1.0, 0.08, 45.0)
    np.testing.assert_allclose(habits.now(ghost, 45.0).position, true, atol=0.10)
    assert habits.remembered([], 30.0 + PredictionConfig().remembered_s + 1.0) == []


def test_what_is_followed_is_not_remembered_twice():
    habits, start, direction = MotionPatterns(), np.zeros(2), np.array([0.0, 1.0])
    learn(habits, start, direction, 1.0, 0.08, 0.0, 30.0)
    place, velocity = to_and_fro(start, direction, 1.0, 0.08, 31.0)
    assert habits.remembered([seen(place, velocity, 31.0, track=7)], 31.0) == []


def test_lost_with_its_ends_unknown_it_may_be_anywhere_on_its_line():
    habits, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(habits, start, direction, 2.0, 0.08, 0.0, 10.0)
    (line,) = habits.lost([], 20.0)
    assert line.high - line.low == pytest.approx(0.08 * 9.75, abs=0.02)
    assert habits.remembered([], 20.0) == []


def test_a_turning_point_that_is_passed_is_forgotten():
    habits, start, direction = MotionPatterns(), np.zeros(2), np.array([1.0, 0.0])
    learn(habits, start, direction, 0.6, 0.08, 0.0, 12.0)
    assert np.isfinite([habits.lines[0].turn_low, habits.lines[0].turn_high]).any()
    for k, x in enumerate(np.arange(0.3, 1.2, 0.026)):
        stamp = 12.0 + EVERY_S * k
        habits.learn([seen(np.array([x, 0.0]), np.array([0.08, 0.0]), stamp)])
    forecast = habits.forecast(
        seen(np.array([0.5, 0.0]), np.array([0.08, 0.0]), 50.0), 50.0, np.array([5.0])
    )
    assert forecast.places[0, 0] > 0.8


def test_what_stands_teaches_nothing():
    habits = MotionPatterns()
    for stamp in np.arange(0.0, 5.0, EVERY_S):
        one = seen(np.array([1.0, 0.0]), np.array([0.004, 0.0]), stamp)
        habits.learn([one])
    assert habits.lines == []


def test_a_distance_that_is_none_is_refused():
    with pytest.raises(ConfigError, match="aside_m"):
        PredictionConfig(aside_m=0.0)
