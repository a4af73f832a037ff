"""Habits of moving obstacles: learnt rates, and honest covariances of obstacles that obey no law of ours."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from perception.obstacles._track_kernels import CURVING, PAUSING, STRAIGHT, TURNED
from perception.obstacles.habits import CURVES_PER_S, pushes
from perception.obstacles.track import Detection, Track, TrackConfig
from perception.primitives.gaussian import Gaussian

SURE = Gaussian(np.zeros(3), np.eye(3) * 1e-8)
STEP_S, NOISE_M, RADIUS_M = 0.3, 0.015, 0.05
SPEED_MPS = 0.1

Velocity = Callable[[float, np.ndarray, np.random.Generator], np.ndarray]
"""A law: the velocity after a time, m/s, from time, present velocity, and randomness."""


def goes_straight(t: float, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return v


def turns(t: float, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A new direction every 3 s in the mean."""
    if rng.random() > STEP_S / 3.0:
        return v
    angle = rng.uniform(-np.pi, np.pi)
    return SPEED_MPS * np.array([np.cos(angle), np.sin(angle)])


def stops(t: float, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Three seconds of walking, three of standing."""
    return np.array([SPEED_MPS * (t % 6.0 < 3.0), 0.0])


def wanders(t: float, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A random acceleration whose memory is 4 s."""
    keep = np.exp(-STEP_S / 4.0)
    return keep * v + 0.07 * np.sqrt(1.0 - keep**2) * rng.standard_normal(2)


def followed(law: Velocity, seconds: float, seed: int) -> tuple[Track, list[float]]:
    """A track of an obstacle after some seconds of a law, and its NEES of (x, y, vx, vy) in every frame."""
    rng, place, v = np.random.default_rng(seed), np.array([1.0, 0.0]), np.array([SPEED_MPS, 0.0])
    track, nees = None, []
    for k in range(round(seconds / STEP_S)):
        seen_at = place + NOISE_M * rng.standard_normal(2)
        seen = Detection(seen_at, np.eye(2) * NOISE_M**2, RADIUS_M, 0.4)
        if track is None:
            track = Track(seen, SURE, TrackConfig())
        else:
            track.predict(STEP_S, SURE)
            track.update(seen)
        nees.append(track.state.mahalanobis_squared(np.concatenate([place, v])))
        for part in range(10):  # a law changes its mind between frames too
            if part == k % 10:
                v = law(STEP_S * k, v, rng)
            place = place + v * STEP_S / 10
    assert track is not None
    return track, nees


def rates_of(law: Velocity) -> np.ndarray:
    """Mean rates that tracks learn from a law in a minute."""
    tracks = [followed(law, 60.0, seed)[0] for seed in range(6)]
    assert all(track.motion is not None for track in tracks)
    return np.mean([track.motion.rates for track in tracks], axis=0)


def test_who_turns_often_is_expected_to_turn_more_often_than_who_goes_straight():
    often, seldom = rates_of(turns)[STRAIGHT, TURNED], rates_of(goes_straight)[STRAIGHT, TURNED]
    assert often > 3.0 * seldom
    assert (
        1.0 / 15.0 < often < 1.0 / 2.0
    )  # truth: 1 / 3; small and soon repeated turns count as curves


def test_who_stops_and_goes_is_expected_to_stop_and_to_go_on():
    regular, never = rates_of(stops), rates_of(goes_straight)
    assert regular[STRAIGHT, PAUSING] > 3.0 * never[STRAIGHT, PAUSING]
    assert 1.0 / 8.0 < regular[STRAIGHT, PAUSING] < 1.0 / 2.0  # truth: 1 / 3
    assert 1.0 / 8.0 < regular[PAUSING, TURNED] < 1.0 / 1.5


def test_who_goes_straight_is_expected_to_curve_less_than_who_wanders():
    even, uneven = rates_of(goes_straight), rates_of(wanders)
    assert even[STRAIGHT, CURVING] < 0.7 * uneven[STRAIGHT, CURVING]


@pytest.mark.parametrize("law", [turns, stops, wanders])
def test_the_covariance_of_an_obstacle_under_a_law_that_no_mode_has_is_honest(law):
    """Mean NEES over 10 obstacles after they were seen for 10 s; 4 if honest, within the half and the double."""
    nees = [followed(law, 50.0, seed)[1][33:] for seed in range(10)]
    assert 2.0 < np.mean(nees) < 8.0


def test_who_is_used_to_go_fast_may_speed_up_by_as_much_when_it_has_slowed_down():
    usual = np.diag([0.08, 0.06]) ** 2
    assert pushes(usual)[CURVING] - pushes(usual)[STRAIGHT] == pytest.approx(CURVES_PER_S * 0.01)
