"""The band of colliding speeds against simulated walks, and its widening against sampled tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planning.univector.collision import (
    EXACT,
    Band,
    colliding_speeds,
    contact,
    miss_deviation,
    widened_band,
)

coordinates = st.floats(-2.0, 2.0)
speeds = st.floats(-0.2, 0.2)
RADIUS = 0.28


def meets(place, velocity, speed, radius):
    """Whether the disc is entered at any time from now on, by the quadratic of the distance."""
    w = np.array([speed, 0.0]) - velocity
    t = max(float(place @ w) / max(float(w @ w), 1e-18), 0.0)
    return np.hypot(*(place - w * t)) < radius


@given(coordinates, coordinates, speeds, speeds, st.floats(-0.3, 0.3))
@settings(max_examples=300, deadline=None)
def test_a_speed_is_in_the_band_if_and_only_if_it_enters_the_disc(px, py, vx, vy, speed):
    place, velocity = np.array([px, py]), np.array([vx, vy])
    assume(np.hypot(px, py) > RADIUS + 1e-3)
    w = np.array([speed, 0.0]) - velocity
    assume(np.hypot(*w) > 1e-3)
    nearest = abs(place[0] * w[1] - place[1] * w[0]) / np.hypot(*w)
    assume(abs(nearest - RADIUS) > 1e-6)  # grazing may fall either way
    band = colliding_speeds(place, velocity, RADIUS)
    assert (band is not None and band.contains(speed)) == meets(place, velocity, speed, RADIUS)


def test_the_roots_equal_brute_force_to_a_millimetre_a_second():
    rng = np.random.default_rng(1)
    tried = np.arange(-0.5, 0.5, 5e-4)
    compared = 0
    for _ in range(60):
        place, velocity = rng.uniform(0.5, 2.0, 2) * [1, rng.choice([-1, 1])], rng.normal(0, 0.1, 2)
        hit = np.array([meets(place, velocity, speed, RADIUS) for speed in tried])
        band = colliding_speeds(place, velocity, RADIUS)
        if band is None or not (-0.45 < band.low < band.high - 2e-3 < 0.44):
            continue
        compared += 1
        assert tried[hit].min() == pytest.approx(band.low, abs=1e-3)
        assert tried[hit].max() == pytest.approx(band.high, abs=1e-3)
    assert compared > 15


@given(coordinates, coordinates, speeds, speeds)
@settings(deadline=None)
def test_at_a_root_the_robot_touches_the_disc(px, py, vx, vy):
    place, velocity = np.array([px, py]), np.array([vx, vy])
    band = colliding_speeds(place, velocity, RADIUS)
    assume(band is not None and np.hypot(px, py) > RADIUS + 0.01)
    for root in (band.low, band.high):
        apart = np.hypot(root - vx, vy)
        if not math.isfinite(root) or abs(root) > 5.0 or apart < 1e-3:
            continue  # relative rest: nothing is ever touched
        t = contact(place, velocity, root)
        touched = np.hypot(*(place + velocity * t - [root * t, 0.0]))
        assert touched == pytest.approx(RADIUS, abs=1e-5)


def test_inside_the_disc_every_speed_collides_and_far_beside_it_none():
    assert colliding_speeds(np.array([0.1, 0.1]), np.zeros(2), RADIUS) == Band(-math.inf, math.inf)
    assert colliding_speeds(np.array([1.0, 0.5]), np.zeros(2), RADIUS) is None
    straight = colliding_speeds(np.array([1.0, 0.0]), np.zeros(2), RADIUS)
    assert straight is not None
    assert straight.low == pytest.approx(0.0)
    assert straight.high == math.inf


def test_the_widened_band_contains_the_band_and_equals_it_without_covariance():
    rng = np.random.default_rng(2)
    widened = 0
    for _ in range(200):
        place, velocity = rng.uniform(-2, 2, 2), rng.normal(0, 0.08, 2)
        plain = colliding_speeds(place, velocity, RADIUS)
        assert widened_band(place, velocity, RADIUS, EXACT, 1.0, 0.15, 8.0) == plain
        P = np.diag([0.03, 0.03, 0.015, 0.015]) ** 2
        wide = widened_band(place, velocity, RADIUS, P, 1.0, 0.15, 8.0)
        if plain is None:
            continue
        assert wide is not None
        assert wide.low <= plain.low + 1e-9
        assert wide.high >= plain.high - 1e-9
        widened += wide.high - wide.low > plain.high - plain.low + 1e-3
    assert widened > 30


def test_the_deviation_of_the_miss_is_that_of_sampled_obstacles():
    rng = np.random.default_rng(3)
    place, velocity, speed = np.array([1.2, 0.5]), np.array([-0.05, -0.06]), 0.06
    A = rng.normal(0, 1, (4, 4)) * [[0.02], [0.02], [0.006], [0.006]]
    P = A @ A.T
    drawn = rng.multivariate_normal(np.concatenate([place, velocity]), P, 20000)
    w = np.array([speed, 0.0]) - drawn[:, 2:]
    misses = (drawn[:, 0] * w[:, 1] - drawn[:, 1] * w[:, 0]) / np.hypot(*w.T)
    claimed = miss_deviation(place, velocity, P, speed, 60.0)
    assert claimed == pytest.approx(float(misses.std()), rel=0.1)
