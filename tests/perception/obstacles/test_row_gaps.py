"""Tops of boxes seen at a grazing angle, by cameras of few pixels that are hardly higher."""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.obstacles.clustering import cluster

NOISE_M = 0.004
SENSOR = np.zeros(2)


def seen(boxes, height_m, pitch_rad, seed=0):
    """Points above the floor of a camera of 60 x 90 deg at the origin that looks 20 deg down; boxes are (x0, x1, y0, y1, top)."""
    rng = np.random.default_rng(seed)
    down, across = np.meshgrid(
        math.radians(20.0) + np.arange(-math.radians(30.0), math.radians(30.0), pitch_rad),
        np.arange(-math.radians(45.0), math.radians(45.0), pitch_rad),
        indexing="ij",
    )
    rays = np.stack(
        [np.cos(down) * np.cos(across), np.cos(down) * np.sin(across), -np.sin(down)], axis=-1
    ).reshape(-1, 3)
    eye = np.array([0.0, 0.0, height_m])
    away = np.full(len(rays), np.inf)
    for x0, x1, y0, y1, top in boxes:
        with np.errstate(divide="ignore"):
            ends = (np.array([[x0, y0, 0.0], [x1, y1, top]]) - eye)[:, None] / rays
        enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        hit = (enter < leave) & (enter > 0.0)
        away[hit] = np.minimum(away[hit], enter[hit])
    with np.errstate(divide="ignore"):
        floor = np.where(rays[:, 2] < 0.0, -height_m / rays[:, 2], np.inf)
    hit = away < floor
    noisy = away[hit] + NOISE_M * rng.normal(size=np.count_nonzero(hit))
    points = eye + noisy[:, None] * rays[hit]
    return points[points[:, 2] > 0.03]


def found(boxes, height_m, pitch_rad, known=True):
    points = seen(boxes, height_m, pitch_rad)
    sigma = np.full(len(points), NOISE_M)
    pitch = pitch_rad if known else 0.0
    return cluster(points, sigma, SENSOR, sensor_height_m=height_m, pitch_rad=pitch)


@pytest.mark.parametrize("pitch_rad", [1 / 130, 1 / 146, 1 / 262])
@pytest.mark.parametrize("height_m", [0.46, 0.6])
@pytest.mark.parametrize("below_m", [0.08, 0.15, 0.25])
def test_a_box_hardly_lower_than_the_camera_is_one_obstacle(pitch_rad, height_m, below_m):
    boxes = [(1.5, 2.1, -0.3, 0.3, height_m - below_m)]
    (box,) = found(boxes, height_m, pitch_rad)
    assert box.placed
    assert abs(box.centre[0] - 1.8) < 0.05
    assert abs(box.centre[1]) < 0.03
    # its last row may be nearer than its far edge, by a gap between rows
    last = pitch_rad * 2.1**2 / below_m
    assert 0.6 - last - 0.05 < box.footprint.width_m < 0.62
    assert abs(box.footprint.length_m - 0.6) < 0.05


def test_without_the_angle_between_rows_the_top_stays_in_pieces():
    boxes = [(1.5, 2.1, -0.3, 0.3, 0.31)]
    assert len(found(boxes, 0.46, 1 / 262, known=False)) > 1


@pytest.mark.parametrize("behind", [(2.2, 2.5, -0.3, 0.3, 0.42), (2.3, 2.4, -0.3, 0.3, 1.2)])
def test_what_stands_behind_a_box_and_is_higher_is_another_obstacle(behind):
    boxes = [(1.5, 2.1, -0.3, 0.3, 0.31), behind]
    near, far = found(boxes, 0.46, 1 / 146)
    assert near.centre[0] < 2.1
    assert far.centre[0] > behind[0] - 0.05


def test_few_points_of_one_height_without_a_front_are_nothing():
    rng = np.random.default_rng(1)
    points = np.column_stack(
        [rng.uniform(1.0, 3.0, 60), rng.uniform(-1.0, 1.0, 60), rng.uniform(0.035, 0.05, 60)]
    )
    sigma = np.full(60, NOISE_M)
    assert cluster(points, sigma, SENSOR, sensor_height_m=0.46, pitch_rad=1 / 146) == []
