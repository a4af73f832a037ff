"""The virtual obstacle: the printed properties of eq. (11), and the velocity of the foot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError, InputError
from planning.univector.fields import FieldConfig
from planning.univector.virtual_obstacle import shrunken_radius, virtual_obstacle

CONFIG = FieldConfig()
shares = st.floats(0.0, 0.999)
convexities = st.floats(0.05, 0.95)


@given(convexities)
def test_the_curve_goes_from_the_full_radius_through_xi_to_zero(xi):
    assert shrunken_radius(1.0, 0.0, xi) == 1.0
    assert shrunken_radius(1.0, 1.0, xi) == 0.0
    assert shrunken_radius(1.0, xi, xi) == pytest.approx(xi)


@given(shares, convexities)
def test_the_curve_is_its_own_inverse_and_never_grows(share, xi):
    here = shrunken_radius(1.0, share, xi)
    assert shrunken_radius(1.0, min(here, 1.0), xi) == pytest.approx(share, abs=1e-9)
    assert shrunken_radius(1.0, min(share + 0.01, 1.0), xi) <= here


@given(shares, st.floats(0.5, 0.9), st.floats(0.01, 0.09))
def test_a_larger_xi_is_more_convex_and_one_half_is_linear(share, xi, more):
    assert shrunken_radius(0.3, share, 0.5) == pytest.approx(0.3 * (1.0 - share))
    assert shrunken_radius(0.3, share, xi + more) >= shrunken_radius(0.3, share, xi) - 1e-12


def test_it_lies_at_the_foot_of_the_perpendicular_and_moves_with_it():
    place, velocity, speed = np.array([0.9, 0.3]), np.array([-0.12, -0.05]), 0.06
    found = virtual_obstacle(place, velocity, speed, 0.3, 0.0, CONFIG)
    assert found is not None
    along = velocity / np.hypot(*velocity)
    assert float(found.place @ along) == pytest.approx(0.0, abs=1e-12)  # perpendicular to the path
    normal = np.array([-along[1], along[0]])
    assert abs(float((found.place - place) @ normal)) < 1e-12  # on the path
    assert found.radius_m <= np.hypot(*found.place) + 1e-12
    dt = 1e-4  # the foot as the robot walks on, seen from where it was; the path stays where it is
    here = np.array([speed * dt, 0.0])
    foot = place + ((here - place) @ along) * along
    np.testing.assert_allclose((foot - found.place) / dt, found.velocity, atol=1e-9)


@pytest.mark.parametrize("speed", [0.06, 0.15])
def test_exactly_head_on_it_is_that_of_a_robot_just_beside_the_path(speed):
    on, beside = (
        virtual_obstacle(np.array([0.8, y]), np.array([-speed, 0.0]), 0.06, 0.3, 0.0, CONFIG)
        for y in (0.0, -1e-3)
    )
    assert on is not None
    assert beside is not None
    assert on.weight == beside.weight > 0.5
    assert on.place[1] < 0.0 < on.radius_m  # the robot passes on its left


def test_there_is_none_behind_far_from_or_for_a_static_obstacle():
    place = np.array([0.6, 0.2])
    assert virtual_obstacle(place, np.array([0.1, 0.0]), 0.06, 0.3, 0.0, CONFIG) is None
    assert virtual_obstacle(place, np.zeros(2), 0.06, 0.3, 0.0, CONFIG) is None
    far = np.array([5.0, 0.2])
    assert virtual_obstacle(far, np.array([-0.1, 0.0]), 0.06, 0.3, 0.0, CONFIG) is None


def test_the_evaluations_make_it_reach_farther():
    place, velocity = np.array([2.0, 0.4]), np.array([-0.1, 0.0])
    calm = virtual_obstacle(place, velocity, 0.06, 0.3, 0.0, CONFIG)
    vague = virtual_obstacle(place, velocity, 0.06, 0.3, 2.0, CONFIG)
    assert calm is None
    assert vague is not None


def test_an_impossible_convexity_is_refused():
    with pytest.raises(ConfigError, match="convexity"):
        FieldConfig(convexity=1.0)
    with pytest.raises(InputError, match="convexity"):
        shrunken_radius(0.3, 0.5, 0.0)
