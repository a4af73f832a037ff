"""Freshness of the terrain map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid.confidence import ConfidenceConfig, ConfidenceLayer, in_polygon
from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from perception.primitives.errors import ConfigError, InputError

SMALL = GridConfig(side_m=0.75, cell_m=0.05)


def layer() -> tuple[EgocentricGrid, ConfidenceLayer]:
    grid = EgocentricGrid(SMALL, np.zeros(2))
    return grid, ConfidenceLayer(grid)


def test_a_cell_is_stale_five_seconds_after_it_left_the_view():
    # Seed 001: 150 cycles at 30 Hz from 1 to lambda_cf = 0.85.
    _, confidence = layer()
    confidence.see(np.ones((15, 15), bool))
    for _ in range(149):
        confidence.decay(1 / 30)
    assert not confidence.stale.any()
    for _ in range(2):
        confidence.decay(1 / 30)
    assert confidence.stale.all()


def test_confidence_never_falls_below_zero():
    _, confidence = layer()
    confidence.see(np.ones((15, 15), bool))
    confidence.decay(1e4)
    assert np.all(confidence.values == 0.0)


def test_confidence_scrolls_with_the_grid():
    grid, confidence = layer()
    mask = np.zeros((15, 15), bool)
    mask[7, 9] = True
    confidence.see(mask)
    grid.move(np.array([0.10, -0.05]))
    assert confidence.values[8, 7] == 1.0
    assert confidence.values.sum() == 1.0
    confidence.see(mask)  # now another place
    assert confidence.values[7, 9] == 1.0
    grid.move(np.array([5.0, 0.0]))
    assert np.all(confidence.values == 0.0)


def test_a_region_given_by_its_corners_covers_the_cells_whose_middle_it_holds():
    grid, confidence = layer()
    grid.move(np.array([0.31, 0.12]))
    confidence.see(np.array([[0.18, -0.02], [0.48, -0.02], [0.48, 0.18], [0.18, 0.18]]))
    centres = grid.centres()
    low, high = np.array([0.18, -0.02]), np.array([0.48, 0.18])
    expected = ((centres > low) & (centres < high)).all(axis=-1)
    assert expected.sum() == 6 * 4
    np.testing.assert_array_equal(confidence.values == 1.0, expected)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_points_in_a_triangle_are_mixtures_of_its_corners(seed, clockwise):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (3, 2))
    points = rng.uniform(-1, 1, (200, 2))
    weights = np.linalg.solve(
        np.vstack([corners.T, np.ones(3)]), np.vstack([points.T, np.ones(200)])
    )
    clear = np.abs(weights).min(axis=0) > 1e-9
    got = in_polygon(points, corners[::-1] if clockwise else corners)
    np.testing.assert_array_equal(got[clear], (weights >= 0).all(axis=0)[clear])


def test_bad_regions_are_refused_with_their_reason():
    _, confidence = layer()
    with pytest.raises(InputError, match=r"mask of shape \(3, 3\)"):
        confidence.see(np.zeros((3, 3), bool))
    with pytest.raises(InputError, match="at least three finite"):
        confidence.see(np.array([[0.0, 0.0], [np.inf, 1.0], [1.0, 0.0]]))
    with pytest.raises(ConfigError, match=r"loss_per_s=-0\.1"):
        ConfidenceConfig(loss_per_s=-0.1)
