"""The geometric sensor: detections and errors against geometry and the claimed covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.sensors.geometric_sensor import GeometricSensor

TILT = math.radians(28.0)
WALLS = np.array([-3.0, -3.0, 3.0, 3.0])


def sensor(seed=0):
    return GeometricSensor(np.random.default_rng(seed))


def indices(discs, pan=0.0, colour=True):
    return {one.index for one in sensor().look(np.array(discs, float), pan, TILT, colour)}


def test_discs_ahead_are_detected_and_those_behind_are_not():
    assert indices([[1.0, 0.0, 0.1], [-1.0, 0.0, 0.1]]) == {0}
    assert indices([[1.0, 0.0, 0.1], [0.0, 1.0, 0.1]], pan=math.pi / 2) == {1}


def test_occluded_discs_are_not_detected():
    assert indices([[0.8, 0.0, 0.1], [1.6, 0.05, 0.1], [1.6, 0.9, 0.1]]) == {0, 2}


def test_the_colour_camera_has_the_wider_field_of_view():
    lateral = [[1.0, 0.7, 0.1]]  # 35 degrees off
    assert indices(lateral) == {0}
    assert indices(lateral, colour=False) == set()


def test_discs_cut_by_the_edge_of_the_view_are_not_detected():
    edge = math.radians(22.0)
    inside, cut = edge - 0.11, edge - 0.05  # a disc of 10 cm at 1 m is 0.1 rad wide to each side
    for bearing, seen in ((inside, {0}), (cut, set())):
        disc = [[math.cos(bearing), math.sin(bearing), 0.1]]
        assert indices(disc, colour=False) == seen


def test_discs_out_of_range_are_not_detected():
    assert indices([[2.8, 0.0, 0.1]]) == set()


@pytest.mark.parametrize("place", [(0.7, 0.1), (1.5, -0.9)])
def test_errors_agree_with_the_claimed_covariance(place):
    """Over many runs the normalised squared error is that of two dimensions, or less."""
    squares = []
    for seed in range(300):
        for one in sensor(seed).look(np.array([[*place, 0.1]]), 0.0, TILT, True):
            away = one.position - np.array(place)
            squares.append(float(away @ np.linalg.solve(one.covariance, away)))
    assert len(squares) == 300
    assert 0.8 < np.mean(squares) < 3.0


def test_rays_end_at_the_nearest_disc_or_wall():
    discs = np.array([[1.0, 0.0, 0.1], [2.0, 0.0, 0.1], [0.0, 2.0, 0.5]])
    rays = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2], [0.0, 0.0, math.pi]])
    distance, what = sensor().rays(discs, WALLS, rays)
    np.testing.assert_allclose(distance, [0.9, 1.5, 3.0])
    assert what.tolist() == [0, 2, -1]
