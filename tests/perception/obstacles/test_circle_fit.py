"""Circle fits to parts of simulated circles with known centres."""

import math

import numpy as np
import pytest
from scipy import stats

from perception.floor.segmented_view import CUT, WHOLE
from perception.obstacles import clustering
from perception.obstacles.circle_fit import fit
from perception.obstacles.clustering import cluster

SENSOR = np.array([0.03, 0.01])
PITCH = math.radians(0.25)
NOISE_M = 0.006


def seen(distance_of, first_deg, last_deg, rng, rows=20):
    """Points at the distances of a front along the rays of a sector, each with an independent error along its ray."""
    bearing = np.arange(math.radians(first_deg), math.radians(last_deg), PITCH)
    distance = distance_of(bearing)
    bearing, distance = bearing[np.isfinite(distance)], distance[np.isfinite(distance)]
    d = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1).repeat(rows, axis=0)
    t = distance.repeat(rows) + NOISE_M * rng.standard_normal(len(d))
    return SENSOR + d * t[:, None]


def circle(centre, radius):
    def distance(bearing):
        d = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
        along = d @ (centre - SENSOR)
        inside = along**2 - ((centre - SENSOR) @ (centre - SENSOR) - radius**2)
        return np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0.0)), np.nan)

    return distance


def wall(ahead, tilt_deg):
    normal = math.radians(tilt_deg)
    return lambda bearing: ahead / np.cos(bearing - normal)


def corner(at, turned_deg, outside):
    """Two walls at a right angle; the nearer one along each ray if seen from outside."""
    x, y = np.array(at) - SENSOR
    faces = []
    for normal in (math.radians(turned_deg), math.radians(turned_deg + 90.0)):
        away = x * math.cos(normal) + y * math.sin(normal)
        faces.append(lambda bearing, a=away, n=normal: a / np.cos(bearing - n))
    pick = np.maximum if outside else np.minimum
    return lambda bearing: pick(faces[0](bearing), faces[1](bearing))


@pytest.mark.parametrize("radius", [0.08, 0.12, 0.18, 0.25])
@pytest.mark.parametrize("away", [0.35, 0.5, 0.8])
def test_the_centre_of_a_partly_visible_circle_is_consistent_with_its_covariance(radius, away):
    squares, errors = [], []
    for number in range(60):
        rng = np.random.default_rng([number, round(1e3 * radius), round(1e2 * away)])
        bearing = rng.uniform(-1.0, 1.0)
        at = SENSOR + (away + radius * 0.5) * np.array([math.cos(bearing), math.sin(bearing)])
        half = math.degrees(math.asin(radius / (away + radius * 0.5)))
        left = math.degrees(bearing) - half
        points = seen(circle(at, radius), left - 5.0, left + half * rng.uniform(1.2, 1.7), rng)
        found = fit(points, SENSOR)
        if found is None:
            continue
        e = found.centre - at
        squares.append(float(e @ np.linalg.solve(found.covariance, e)))
        errors.append((float(np.linalg.norm(e)), abs(found.radius_m - radius)))
    assert len(squares) > 20
    assert np.mean(squares) < stats.chi2.ppf(0.999, 2 * len(squares)) / len(squares)
    assert np.mean(squares) > 0.2  # nor far too cautious; 2 is exact
    assert np.quantile(errors, 0.9, axis=0) == pytest.approx((0.0, 0.0), abs=0.03)


@pytest.mark.parametrize("tilt_deg", [-60.0, -30.0, 0.0, 30.0, 60.0])
@pytest.mark.parametrize("ahead", [0.2, 0.4, 0.8])
def test_a_wall_is_not_round(ahead, tilt_deg):
    for number in range(20):
        rng = np.random.default_rng(number)
        points = seen(wall(ahead, tilt_deg), -22.0, 22.0, rng)
        assert fit(points, SENSOR) is None


@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.parametrize("turned_deg", [-80.0, -45.0, -20.0])
def test_a_corner_is_not_round(turned_deg, outside):
    for number in range(20):
        rng = np.random.default_rng(number)
        at = (rng.uniform(0.35, 0.6), rng.uniform(-0.05, 0.05))
        points = seen(corner(at, turned_deg, outside), -22.0, 22.0, rng)
        assert fit(points, SENSOR) is None


def test_too_small_a_part_gives_no_circle():
    rng = np.random.default_rng(0)
    ahead = circle(SENSOR + np.array([0.5, 0.0]), 0.18)
    assert fit(seen(ahead, -20.0, 20.0, rng), SENSOR) is not None
    assert fit(seen(ahead, -4.0, 4.0, rng), SENSOR) is None
    assert fit(seen(ahead, -20.0, 20.0, rng, rows=1), SENSOR) is None
    assert fit(np.zeros((0, 2)), SENSOR) is None


def test_flying_pixels_do_not_move_the_circle():
    rng = np.random.default_rng(0)
    points = seen(circle(SENSOR + np.array([0.5, 0.0]), 0.18), -20.0, 20.0, rng)
    clean = fit(points, SENSOR)
    flying = points.copy()
    stray = rng.random(len(points)) < 0.1
    flying[stray] += (points[stray] - SENSOR) * rng.uniform(0.1, 1.0, (int(stray.sum()), 1))
    found = fit(flying, SENSOR)
    assert clean is not None
    assert found is not None
    assert np.linalg.norm(found.centre - clean.centre) < 0.008


def upright(plan, height=0.4):
    z = np.tile(np.linspace(0.02, height, 20), len(plan) // 20)
    return np.column_stack([plan, z]), np.full(len(plan), NOISE_M)


@pytest.mark.parametrize("away", [0.35, 0.5, 0.7])
def test_a_round_object_too_close_to_be_whole_is_still_placed(away, monkeypatch):
    rng = np.random.default_rng(3)
    at = SENSOR + away * np.array([math.cos(0.3), math.sin(0.3)])
    points, sigma = upright(seen(circle(at, 0.18), -15.0, 22.0, rng))
    outer = np.arctan2(*(points[:, :2] - SENSOR).T[::-1]) > math.radians(21.0)
    edge = np.where(outer, CUT, WHOLE)
    (found,) = cluster(points, sigma, SENSOR, None, edge)
    assert found.placed
    assert found.circular
    assert not found.whole
    assert np.linalg.norm(found.centre - at) < 0.03
    assert found.radius_m == pytest.approx(0.18, abs=0.03)
    monkeypatch.setattr(clustering, "CIRCLE_MOST_M", 0.1)
    (far,) = cluster(points, sigma, SENSOR, None, edge)
    assert not far.placed


def test_a_truncated_wall_is_not_placed():
    points, sigma = upright(seen(wall(0.4, 10.0), -22.0, 22.0, np.random.default_rng(4)))
    outer = np.abs(np.arctan2(*(points[:, :2] - SENSOR).T[::-1])) > math.radians(21.0)
    edge = np.where(outer, CUT, WHOLE)
    assert not any(one.placed for one in cluster(points, sigma, SENSOR, None, edge))
