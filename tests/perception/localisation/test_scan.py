"""Scans: position and normal of surfaces, and points that belong to none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.localisation.scan import SHARED_SIGMA_M, joined, scan
from perception.primitives.pose import Pose2

EYE = np.zeros(2)


def wall(
    distance_m: float, turn_rad: float = 0.0, noise_m: float = 0.0, seed: int = 0
) -> np.ndarray:
    """Points of a vertical plane, 1.6 m wide, seen from the origin: a quarter of a degree apart, 20 high."""
    rng = np.random.default_rng(seed)
    bearings = np.repeat(np.radians(np.arange(-20.0, 20.0, 0.25)), 20)
    normal = np.array([-math.cos(turn_rad), -math.sin(turn_rad)])
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    ranges = -distance_m * math.cos(turn_rad) / (rays @ normal)
    ranges = ranges + noise_m * rng.standard_normal(len(ranges))
    heights = np.tile(np.linspace(0.05, 0.45, 20), len(bearings) // 20)
    return np.column_stack([rays * ranges[:, None], heights])


@given(st.floats(0.6, 2.5), st.floats(-0.7, 0.7))
@settings(max_examples=30, deadline=None)
def test_a_wall_has_the_right_position_and_normal(distance: float, turn: float) -> None:
    points = wall(distance, turn)
    found = scan(points, np.full(len(points), 0.005), EYE)
    normal = np.array([-math.cos(turn), -math.sin(turn)])
    assert len(found) >= 15
    off = (found.points - np.array([distance, 0.0])) @ normal
    assert np.abs(off).max() < 1e-3
    assert (found.normals @ normal).min() > math.cos(math.radians(2.0))


def test_the_standard_deviation_of_many_points_agrees_with_the_errors() -> None:
    errors, claimed = [], []
    for seed in range(20):
        points = wall(2.0, 0.0, 0.005, seed)
        found = scan(points, np.full(len(points), 0.005), EYE)
        errors += list(found.points[:, 0] - 2.0)
        claimed += list(np.sqrt(found.sigmas**2 - SHARED_SIGMA_M**2))
    spread = float(np.std(errors))
    assert spread < 0.0015
    assert spread == pytest.approx(float(np.mean(claimed)), rel=0.25)


def test_the_top_of_a_table_is_not_in_the_scan() -> None:
    """The points of a horizontal surface fill no thin range interval at any bearing."""
    x, y = np.meshgrid(np.linspace(0.6, 1.6, 120), np.linspace(-0.4, 0.4, 120))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)])
    assert len(scan(points, np.full(len(points), 0.005), EYE)) == 0


def test_points_too_low_or_too_high_are_ignored() -> None:
    points = wall(1.5)
    for height in (0.0, 2.0):
        moved = points.copy()
        moved[:, 2] = height
        assert len(scan(moved, np.full(len(points), 0.005), EYE)) == 0


def test_points_that_are_not_finite_are_ignored() -> None:
    points, sigma = wall(1.5), np.full(len(wall(1.5)), 0.005)
    clean = scan(points, sigma, EYE)
    bad = np.vstack([points, [[np.nan, 0.0, 0.2], [np.inf, 1.0, 0.2], [1.0, 0.0, 0.2]]])
    found = scan(bad, np.concatenate([sigma, [0.005, 0.005, 0.0]]), EYE)
    assert np.array_equal(found.points, clean.points)


def test_no_points_give_an_empty_scan() -> None:
    assert len(scan(np.zeros((0, 3)), np.zeros(0), EYE)) == 0
    assert len(joined([])) == 0


def test_a_scan_is_transformed_by_a_pose() -> None:
    points = wall(1.5)
    one = scan(points, np.full(len(points), 0.005), EYE)
    both = joined([one, one]).at(Pose2(1.0, 2.0, math.pi / 2))
    assert len(both) == 2 * len(one)
    assert np.allclose(both.points[: len(one), 1], 2.0 + one.points[:, 0])
    assert np.allclose(both.normals[: len(one), 1], one.normals[:, 0])
