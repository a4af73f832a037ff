"""Classes of points in rooms where every point is known."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import Points
from perception.floor.choose import find
from perception.floor.classify import FLOOR, HOLE, OBSTACLE, OVERHANG, ClassConfig, band, classify
from perception.floor.prior import handheld_prior
from perception.primitives.errors import ConfigError
from perception.primitives.plane import Plane

LEVEL = Plane(np.array([0.0, -1.0, 0.0]), 0.4)  # a camera looking ahead, 0.4 m above the floor


def at_height(height, z=1.0, sigma=0.001):
    """Points at given heights above the floor of `LEVEL`."""
    height = np.atleast_1d(np.asarray(height, dtype=float))
    xyz = np.column_stack([np.zeros_like(height), 0.4 - height, np.full_like(height, z)])
    return Points(xyz, np.full(len(height), sigma), np.arange(len(height)))


def test_the_thresholds_are_those_of_seed_003():
    tau = 0.01 + 3.0 * 0.001 * 0.4 / 1.0
    heights = [0.0, tau - 1e-6, tau + 1e-6, 0.559, 0.561, -tau + 1e-6, -tau - 1e-6]
    expected = [FLOOR, FLOOR, OBSTACLE, OBSTACLE, OVERHANG, FLOOR, HOLE]
    np.testing.assert_array_equal(classify(at_height(heights), LEVEL), expected)


def test_the_band_grows_with_depth_noise_and_the_covariance_of_the_plane():
    near, far = at_height(0.0, 1.0, 0.002), at_height(0.0, 3.0, 0.02)
    assert band(near, LEVEL)[0] == pytest.approx(0.01 + 3 * 0.002 * 0.4 / 1.0)
    assert band(far, LEVEL)[0] == pytest.approx(0.01 + 3 * 0.02 * 0.4 / 3.0)
    tilted = Plane(LEVEL.normal, 0.4, np.diag([0.02**2, 0.02**2, 0.0]))
    lever = np.hypot(3.0, 0.0)  # the tilt moves a floor point 3 m ahead up and down
    expected = 0.01 + 3 * np.hypot(0.02 * 0.4 / 3.0, 0.02 * lever)
    assert band(far, tilted)[0] == pytest.approx(expected, rel=1e-6)


def test_the_compiled_classes_equal_those_of_numpy(look):
    room = look(0, boxes=((0.8, 1.1, -0.2, 0.2, 0.0, 0.2),))
    M = 0.01 * np.random.default_rng(0).normal(size=(3, 3))
    plane = Plane(room.floor.normal, room.floor.offset_m, M @ M.T)
    d, tau = plane.distance(room.points.xyz), band(room.points, plane)
    expected = np.select([d > 0.56, d > tau, d < -tau], [OVERHANG, OBSTACLE, HOLE], FLOOR)
    np.testing.assert_array_equal(classify(room.points, plane, ClassConfig(foot_m=0.0)), expected)


@pytest.mark.parametrize("seed", range(3))
def test_floor_and_boxes_are_separated_by_the_floor_that_is_found(look, seed):
    boxes = ((0.9, 1.2, -0.6, -0.2, 0.0, 0.12), (1.5, 1.8, 0.1, 0.6, 0.0, 0.40))
    room = look(seed, boxes=boxes, reach_m=3.0)
    found = find(room.points, handheld_prior(None), np.random.default_rng(seed))
    labels = classify(room.points, found.plane)
    is_floor = room.height < 0.005
    precision = np.mean(is_floor[labels == FLOOR])
    recall = np.mean(labels[is_floor] == FLOOR)
    assert precision >= 0.97
    assert recall >= 0.97
    tall = room.height > 0.06  # beyond every band within 3 m
    assert np.mean(labels[tall] == OBSTACLE) > 0.99


def test_invalid_thresholds_are_refused_with_a_message():
    with pytest.raises(ConfigError, match=r"base_m=-0\.01"):
        ClassConfig(base_m=-0.01)
    with pytest.raises(ConfigError, match="must exceed base_m"):
        ClassConfig(robot_height_m=0.0, base_m=0.2)


def front(distance, height, rng, count=4000):
    """Points of an upright front, seen from 0.4 m, with the noise of stereo."""
    y = 0.4 - rng.uniform(0.0, height, count)
    x = rng.uniform(-0.2, 0.2, count)
    z = np.full(count, distance)
    sigma = 0.004 * z**2
    factor = 1.0 + sigma * rng.normal(size=count) / z
    return np.column_stack([x, y, z]) * factor[:, None], sigma


def ground(nearest, farthest, rng, count=20000):
    """Points of the floor of `LEVEL` between two distances, with the same noise."""
    z = rng.uniform(nearest, farthest, count)
    sigma = 0.004 * z**2
    factor = 1.0 + sigma * rng.normal(size=count) / z
    xyz = np.column_stack([rng.uniform(-0.2, 0.2, count) * z, np.full(count, 0.4), z])
    return xyz * factor[:, None], sigma


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.5])
def test_the_foot_of_an_obstacle_is_obstacle_and_the_floor_before_it_is_floor(distance):
    rng = np.random.default_rng(0)
    (thing, thing_sigma), (floor, floor_sigma) = (
        front(distance, 0.3, rng),
        ground(0.5, distance - 0.02, rng),
    )
    points = Points(
        np.vstack([thing, floor]),
        np.concatenate([thing_sigma, floor_sigma]),
        np.arange(len(thing) + len(floor)),
    )
    plain = classify(points, LEVEL, ClassConfig(foot_m=0.0))
    labels = classify(points, LEVEL)
    is_thing = np.arange(len(labels)) < len(thing)
    feet_left = np.count_nonzero(is_thing & (labels == FLOOR))
    assert feet_left < 0.5 * np.count_nonzero(is_thing & (plain == FLOOR))
    assert np.mean(labels[~is_thing] == FLOOR) > 0.97
    np.testing.assert_array_equal(labels[plain != FLOOR], plain[plain != FLOOR])


def test_floor_under_a_table_is_floor():
    rng = np.random.default_rng(1)
    floor, sigma = ground(0.5, 2.5, rng)
    x, z = rng.uniform(-0.4, 0.4, 4000), rng.uniform(0.9, 1.6, 4000)
    top = np.column_stack([x, np.full(4000, 0.4 - 0.45), z])  # no leg reaches down
    points = Points(
        np.vstack([floor, top]), np.concatenate([sigma, np.full(4000, 0.003)]), np.arange(24000)
    )
    labels = classify(points, LEVEL)
    assert np.mean(labels[:20000] == FLOOR) > 0.99
    assert np.all(labels[20000:] == OBSTACLE)
