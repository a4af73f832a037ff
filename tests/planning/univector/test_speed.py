"""The change of speed: no contact at the returned acceleration, and the printed law."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.robot_model import DARWIN_OP
from planning.univector._collision_kernels import travelled
from planning.univector.collision import colliding_speeds, contact
from planning.univector.fields import HORIZON_S
from planning.univector.speed import (
    change,
    contact_acceleration,
    escape_acceleration,
    least_distance,
)

RADIUS, TOP = 0.28, DARWIN_OP.gait.max_speed_mps


def walked(place, velocity, speed, acceleration, seconds=8.0, dt=0.002):
    """Least distance by walking in small steps; the speed stays between standing and top speed."""
    x, least = 0.0, np.inf
    for k in range(round(seconds / dt)):
        least = min(least, np.hypot(*(place + velocity * k * dt - [x, 0.0])))
        speed_now = np.clip(speed + acceleration * k * dt, 0.0, TOP)
        x += speed_now * dt
    return least


def encounters(seed, count):
    """Movers on collision course with a robot at a random speed."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        speed = float(rng.uniform(0.02, 0.09))
        place = rng.uniform([-0.5, -1.0], [1.2, 1.0])
        velocity = rng.normal(0, 0.1, 2)
        band = colliding_speeds(place, velocity, RADIUS)
        if np.hypot(*place) > RADIUS + 0.02 and band is not None and band.contains(speed):
            found.append((place, velocity, band, speed))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_there_is_no_contact_at_the_acceleration_returned(seed):
    cases = set()
    for place, velocity, band, speed in encounters(seed, 25):
        what = change(place, velocity, RADIUS, band, speed)
        cases.add(what.case)
        assert abs(what.acceleration_mps2) <= 0.05 + 1e-12
        if what.case in ("accelerate", "decelerate", "escape"):
            assert walked(place, velocity, speed, what.acceleration_mps2) >= RADIUS - 0.003
    assert {"decelerate", "virtual"} <= cases


def test_all_cases_occur():
    cases = {change(p, v, RADIUS, band, speed).case for p, v, band, speed in encounters(9, 300)}
    assert cases == {"accelerate", "decelerate", "escape", "virtual", "clear"}


def test_the_printed_law_reaches_the_point_of_contact_at_the_time_of_contact():
    place, velocity, speed = np.array([0.8, 0.9]), np.array([0.0, -0.09]), 0.06
    band = colliding_speeds(place, velocity, RADIUS)
    assert band is not None
    assert band.contains(speed)
    for root in (band.low, band.high):
        a, t = contact_acceleration(place, velocity, speed, root), contact(place, velocity, root)
        assert speed * t + 0.5 * a * t**2 == pytest.approx(root * t)
    assert (
        contact_acceleration(place, velocity, speed, band.low)
        < 0.0
        < contact_acceleration(place, velocity, speed, band.high)
    )


def test_the_escape_reaches_the_edge_of_the_band_when_the_obstacle_does():
    place, velocity, speed = np.array([0.2, -1.0]), np.array([0.0, 0.1]), 0.03
    a = escape_acceleration(place, velocity, RADIUS, speed)
    edge = 0.2 + RADIUS  # the mover comes along y, so its band ends there
    t = 1.0 / 0.1
    assert speed * t + 0.5 * a * t**2 == pytest.approx(edge)


def test_an_obstacle_straight_ahead_needs_a_virtual_obstacle():
    place, velocity = np.array([0.9, 0.0]), np.array([-0.1, 0.0])
    band = colliding_speeds(place, velocity, RADIUS)
    assert change(place, velocity, RADIUS, band, 0.06).case == "virtual"


def test_a_speed_outside_the_band_is_kept():
    place, velocity = np.array([0.8, 0.9]), np.array([0.0, 0.09])
    band = colliding_speeds(place, velocity, RADIUS)
    assert change(place, velocity, RADIUS, band, 0.06).case == "clear"


@given(st.floats(0, 0.1), st.floats(-0.05, 0.05))
@settings(max_examples=40, deadline=None)
def test_the_distance_travelled_is_the_integral_of_the_bounded_speed(speed, acceleration):
    times = np.linspace(0, 6, 25)
    bound = 0.1 if acceleration > 0 else 0.0
    fine = np.linspace(0, 6, 6001)
    now = np.clip(speed + acceleration * fine, 0.0, 0.1)
    way = np.concatenate([[0], np.cumsum((now[1:] + now[:-1]) / 2 * (fine[1] - fine[0]))])
    found = [travelled(speed, acceleration, bound, time) for time in times]
    np.testing.assert_allclose(found, np.interp(times, fine, way), atol=1e-5)


def test_the_least_distance_is_that_of_a_simulated_walk():
    for place, velocity, _, speed in encounters(5, 10):
        for a in (-0.03, 0.0, 0.03):
            bound = TOP if a > 0.0 else 0.0
            found = least_distance(place, velocity, speed, a, bound, HORIZON_S)
            assert found == pytest.approx(walked(place, velocity, speed, a), abs=0.004)
