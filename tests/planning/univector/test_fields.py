"""The univector field: arrival, avoidance, and the printed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from planning.univector import _kernels
from planning.univector.fields import (
    PUBLISHED,
    FieldConfig,
    avoid,
    extended_radius,
    move_to_goal,
    total,
)

CONFIG = FieldConfig()
GOAL = np.array([0.0, 0.0])
ORIGIN = np.zeros((1, 2))
angles = st.floats(-math.pi, math.pi)


def follow(start, direction, step_m=0.01, limit=3000):
    """The track of a point that follows a field until it is 3 cm from the goal."""
    track = [np.array(start)]
    while np.hypot(*(track[-1] - GOAL)) > 0.03 and len(track) < limit:
        u = direction(track[-1])
        track.append(track[-1] + step_m * u / np.hypot(*u))
    return np.array(track)


@pytest.mark.parametrize("k", range(12))
def test_every_start_arrives_with_the_desired_heading(k):
    start = 2.0 * np.array([math.cos(k * math.pi / 6 + 0.1), math.sin(k * math.pi / 6 + 0.1)])
    wanted = math.pi / 6
    track = follow(start, lambda p: move_to_goal(p[None], GOAL, wanted, CONFIG)[0])
    assert np.hypot(*(track[-1] - GOAL)) <= 0.03
    heading = math.atan2(*(track[-1] - track[-2])[::-1])
    assert abs((heading - wanted + math.pi) % (2 * math.pi) - math.pi) <= math.radians(5.0)


@given(angles, st.floats(0.05, 3.0), angles)
@settings(deadline=None)
def test_the_dipole_form_without_angles_equals_the_one_with_angles(bearing, distance, wanted):
    place = distance * np.array([[math.cos(bearing), math.sin(bearing)]])
    fast = move_to_goal(place, GOAL, wanted, CONFIG)[0]
    th_rd = math.atan2(-place[0, 1], -place[0, 0])
    beta = (wanted - th_rd + math.pi) % (2 * math.pi) - math.pi
    phi = th_rd - beta if distance <= 1.0 else th_rd
    np.testing.assert_allclose(fast, [math.cos(phi), math.sin(phi)], atol=1e-9)


def test_the_printed_field_points_away_from_the_goal():
    away = move_to_goal(np.array([[2.0, 0.0]]), GOAL, 0.0, CONFIG, literal=True)[0]
    np.testing.assert_allclose(away, [1.0, 0.0], atol=1e-12)


@given(angles, st.floats(0.0, 0.79), st.floats(0.15, 0.5))
@settings(deadline=None)
def test_the_avoiding_field_is_a_unit_vector_or_zero(bearing, distance, radius):
    place = distance * np.array([[math.cos(bearing), math.sin(bearing)]])
    u = avoid(place, np.array([-3.0, 0.0]), ORIGIN, np.array([radius]), CONFIG)[0]
    size = float(np.hypot(*u))
    assert size == pytest.approx(1.0) or size == 0.0


def test_the_avoiding_field_has_no_jump_at_the_end_of_its_inner_band():
    radius, edge = np.array([0.25]), 0.25 + CONFIG.d_e_m
    for bearing in np.linspace(-1.5, 1.5, 13):
        ray = np.array([math.cos(bearing), math.sin(bearing)])
        inside, outside = avoid(
            np.array([(edge - 1e-9) * ray, (edge + 1e-9) * ray]),
            np.array([-3.0, 0.0]),
            ORIGIN,
            radius,
            CONFIG,
        )
        np.testing.assert_allclose(inside, outside, atol=1e-6)


def test_at_the_edge_of_an_obstacle_and_inside_the_field_points_outwards():
    ray = np.array([math.cos(0.4), math.sin(0.4)])
    places = np.array([0.2500001 * ray, 0.1 * ray])
    out = avoid(places, np.array([-3.0, 0.0]), ORIGIN, np.array([0.25]), CONFIG)
    np.testing.assert_allclose(out, [ray, ray], atol=1e-5)
    printed = avoid(places, np.array([-3.0, 0.0]), ORIGIN, np.array([0.25]), CONFIG, literal=True)
    np.testing.assert_allclose(printed, [ray, [0, 0]], atol=1e-5)


@pytest.mark.parametrize(("side", "sense"), [(0.05, -1.0), (-0.05, 1.0)])
def test_a_robot_right_of_the_line_to_the_goal_passes_counter_clockwise(side, sense):
    """It walks along +x to the goal; right of the line is -y, and counter-clockwise is below."""
    place = np.array([[-0.45, side]])
    u = avoid(place, np.array([2.0, 0.0]), ORIGIN, np.array([0.25]), CONFIG)[0]
    turning = place[0, 0] * u[1] - place[0, 1] * u[0]  # about the obstacle, + counter-clockwise
    assert math.copysign(1.0, turning) == sense


@given(angles, st.floats(0.3, 3.0), st.sampled_from([-1.0, 1.0]), st.floats(1e-6, 0.01))
def test_the_side_is_that_of_the_robot_however_close_to_the_line(bearing, away, side, off):
    """Line from the obstacle to the goal; left of it the robot passes clockwise."""
    along = np.array([math.cos(bearing), math.sin(bearing)])
    left = np.array([-along[1], along[0]])
    place = -0.45 * along + side * off * left
    u = avoid(place[None], away * along, ORIGIN, np.array([0.25]), CONFIG)[0]
    assert math.copysign(1.0, place[0] * u[1] - place[1] * u[0]) == -side


def test_the_series_of_a_turn_is_its_cosine_and_sine():
    for share in np.linspace(0.0, 2.0, 41):
        turn = 0.5 * math.pi * share
        found = _kernels._quarter_turns(share)
        np.testing.assert_allclose(found, [math.cos(turn), math.sin(turn)], atol=1e-11)


def test_obstacles_behind_the_robot_or_beyond_the_goal_have_no_effect():
    behind = avoid(np.array([[0.4, 0.0]]), np.array([2.0, 0.0]), ORIGIN, np.array([0.25]), CONFIG)
    np.testing.assert_array_equal(behind, 0.0)
    beyond = avoid(
        np.array([[-0.6, 0.0]]), np.array([-0.55, 0.0]), ORIGIN, np.array([0.25]), CONFIG
    )
    np.testing.assert_array_equal(beyond, 0.0)


@pytest.mark.parametrize("offset", [0.01, 0.05, 0.1, -0.07, -0.2])
def test_the_default_weights_keep_outside_the_extended_obstacle_and_the_printed_do_not(offset):
    centre, radius = np.array([[1.0, offset]]), np.array([0.25])

    def nearest(config):
        track = follow(
            (2.0, 0.0), lambda p: total(p[None], GOAL, None, centre, radius, config)[0], 0.005
        )
        assert np.hypot(*(track[-1] - GOAL)) <= 0.03
        return np.hypot(*(track - centre).T).min()

    assert nearest(CONFIG) >= 0.25
    if abs(offset) < 0.1:
        assert nearest(PUBLISHED) < 0.25


def test_one_place_gives_the_same_as_many():
    rng = np.random.default_rng(3)
    places, centres = rng.uniform(-2, 2, (200, 2)), rng.uniform(-2, 2, (9, 2))
    radii = rng.uniform(0.2, 0.4, 9)
    many = total(places, GOAL, 0.3, centres, radii, CONFIG)
    single = [total(p[None], GOAL, 0.3, centres, radii, CONFIG)[0] for p in places]
    np.testing.assert_array_equal(many, single)
    goal = move_to_goal(places, GOAL, 0.3, CONFIG)
    aside = avoid(places, GOAL, centres, radii, CONFIG)
    matters = np.hypot(*aside.T) > 0
    assert 0 < matters.sum() < 200
    expected = np.where(matters[:, None], 0.25 * goal + 0.75 * aside, goal)
    np.testing.assert_allclose(many, expected, atol=1e-12)


@given(st.floats(0.05, 0.4), st.floats(0, 0.2), st.floats(0, 2), st.floats(0.001, 0.1))
@settings(deadline=None)
def test_the_extended_radius_grows_with_each_of_its_terms(radius, speed, psi, more):
    def of(*values):
        return float(extended_radius(*(np.array([v]) for v in values), CONFIG)[0])

    assert of(radius, speed, psi) == pytest.approx(0.15 + radius + 0.5 * speed + 0.05 * psi)
    base = of(radius, speed, psi)
    assert of(radius + more, speed, psi) > base
    assert of(radius, speed + more, psi) > base
    assert of(radius, speed, psi + more) > base


def test_a_band_of_zero_width_is_refused():
    with pytest.raises(ConfigError, match="d_e_m"):
        FieldConfig(d_e_m=0.0)
