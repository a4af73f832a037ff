"""Potential and clearance against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError, InputError
from planning.search.potential import SearchConfig, potential, terrain

CELL_M = 0.05
CONFIG = SearchConfig()


@pytest.mark.parametrize("distance_cells", [0, 1, 3, 5, 6, 9])
def test_one_obstacle_repels_by_the_square_of_the_distance_to_the_margin(distance_cells):
    probability = np.zeros((21, 21))
    probability[10, 10] = 0.8
    distance = distance_cells * CELL_M
    expected = 0.8 * (1 - distance / 0.30) ** 2 if distance < 0.30 else 0.0
    found = potential(probability, CELL_M, CONFIG)
    assert found[10, 10 + distance_cells] == pytest.approx(expected, abs=1e-12)
    assert found[10 - distance_cells, 10] == pytest.approx(expected, abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.06, 0.5))
def test_the_potential_is_the_strongest_repulsion_of_any_cell(seed, margin):
    rng = np.random.default_rng(seed)
    probability = rng.uniform(0, 1, (9, 12)) ** 4
    config = SearchConfig(margin_m=margin)
    rows, columns = np.indices(probability.shape)
    brute = np.zeros(probability.shape)
    for row, column in np.ndindex(probability.shape):
        distance = np.hypot(rows - row, columns - column) * CELL_M
        pull = np.where(distance < margin, (1 - distance / margin) ** 2, 0.0)
        brute = np.maximum(brute, probability[row, column] * pull)
    np.testing.assert_allclose(potential(probability, CELL_M, config), brute, atol=1e-12)


def test_cells_are_blocked_up_to_the_body_radius_and_not_beyond():
    solid = np.zeros((15, 15), bool)
    solid[7, 7] = True
    rows, columns = np.indices(solid.shape)
    near = np.hypot(rows - 7, columns - 7) * CELL_M <= 0.16
    _, blocked = terrain(solid.astype(float), np.zeros_like(solid), CELL_M, CONFIG)
    np.testing.assert_array_equal(blocked, near)


def test_unseen_cells_repel_by_half_and_block_nothing():
    strength, blocked = terrain(np.ones((9, 9)), np.ones((9, 9), bool), CELL_M, CONFIG)
    np.testing.assert_allclose(strength, 0.5)
    assert not blocked.any()


def test_a_single_precision_map_gives_the_same_as_a_double():
    rng = np.random.default_rng(1)
    probability = (rng.integers(0, 257, (20, 20)) / 256).astype(np.float32)
    np.testing.assert_array_equal(
        potential(probability, CELL_M, CONFIG), potential(probability.astype(float), CELL_M, CONFIG)
    )


def test_a_map_that_holds_nan_is_refused():
    probability = np.full((5, 5), 0.1)
    probability[2, 2] = np.nan
    with pytest.raises(InputError, match="NaN"):
        terrain(probability, np.zeros((5, 5), bool), CELL_M, CONFIG)


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"margin_m": 0.0}, "margin_m"),
        ({"margin_m": 300.0}, "margin_m=300.0 must be .* at most 5"),
        ({"alpha": -1.0}, "alpha"),
        ({"p_unknown": 1.5}, "p_unknown"),
    ],
)
def test_impossible_configurations_are_named(values, word):
    with pytest.raises(ConfigError, match=word):
        SearchConfig(**values)
