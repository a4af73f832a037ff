"""Shortcuts and rounded corners."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planning.search.astar import find_path, prepare
from planning.search.potential import SearchConfig
from planning.search.shortcuts import polyline_cost, rounded, shortcut, total_turning

CELL_M = 0.05


def test_a_segment_through_an_even_price_costs_its_length_times_the_price():
    price, blocked = np.full((20, 20), 3.0), np.zeros((20, 20), bool)
    begin, end = np.array([2.2, 3.1]), np.array([15.7, 11.4])
    length = float(np.hypot(*(end - begin)))
    assert polyline_cost(np.stack([begin, end]), price, blocked) == pytest.approx(3.0 * length)


def test_a_segment_through_a_slope_costs_the_price_of_its_middle():
    price = np.broadcast_to(1.0 + 0.1 * np.arange(20.0), (20, 20)).copy()
    blocked = np.zeros((20, 20), bool)
    cost = polyline_cost(np.array([[2.0, 5.0], [12.0, 5.0]]), price, blocked)
    assert cost == pytest.approx(10.0 * 1.7)


@pytest.mark.parametrize("turned", range(4))
def test_between_the_cells_the_price_is_linear_up_to_the_border_of_the_map(turned):
    """A price that is linear in both directions: the mean over a segment is that of its ends, in any direction."""
    rows, columns = np.mgrid[:16, :16]
    price, blocked = 3.0 + 0.11 * columns + 0.07 * rows, np.zeros((16, 16), bool)
    places = np.array([[0.2, 0.3], [14.9, 6.4], [14.8, 14.9], [0.1, 14.6], [7.3, 0.0]])
    middle = np.full(2, 7.5)
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turned)
    for begin in places:
        for end in places:
            ends = (np.stack([begin, end]) - middle) @ turn.T + middle
            mean = 3.0 + ends.mean(axis=0) @ [0.11, 0.07]
            length = float(np.hypot(*(end - begin)))
            assert polyline_cost(ends, price, blocked) == pytest.approx(mean * length)


def test_a_segment_into_a_blocked_cell_costs_infinitely_much():
    blocked = np.zeros((20, 20), bool)
    blocked[5, 8] = True
    assert math.isinf(
        polyline_cost(np.array([[2.0, 5.0], [12.0, 5.0]]), np.ones((20, 20)), blocked)
    )


def test_a_staircase_over_free_ground_becomes_one_straight_line():
    path = np.array([[i // 2, (i + 1) // 2] for i in range(21)], float)
    kept = shortcut(path, np.ones((20, 20)), np.zeros((20, 20), bool))
    np.testing.assert_array_equal(kept, path[[0, -1]])


def test_shortcuts_never_cost_more_and_halve_the_turning():
    before = after = 0.0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        probability = np.full((71, 71), 0.02)
        for row, column in rng.integers(8, 60, (10, 2)):
            probability[row : row + 4, column : column + 4] = 0.97
        known, config = np.zeros((71, 71), bool), SearchConfig()
        start, goal = np.array([0.125, 0.125]), np.array([3.425, 2.925])
        path = find_path(probability, known, np.zeros(2), CELL_M, start, goal, config)
        ground = prepare(probability, known, np.zeros(2), CELL_M, start, config)
        line = path.cells[:, ::-1].astype(float)
        kept = ground.to_cells(path.waypoints)
        assert polyline_cost(kept, ground.price, ground.blocked) <= (
            polyline_cost(line, ground.price, ground.blocked) + 1e-6
        )
        before += total_turning(line)
        after += total_turning(kept)
    assert after <= 0.5 * before


def test_a_rounded_corner_turns_no_sharper_than_the_radius_allows():
    corner = np.array([[2.0, 2.0], [22.0, 2.0], [22.0, 22.0]])
    radius = 6.0
    found = rounded(corner, radius, np.ones((30, 30)), np.zeros((30, 30), bool))
    np.testing.assert_array_equal(found.points[[0, -1]], corner[[0, -1]])
    middle = np.array([16.0, 8.0])
    inner = found.points[1:-1]
    np.testing.assert_allclose(np.hypot(*(inner - middle).T), radius, atol=1e-9)
    assert total_turning(found.points) == pytest.approx(math.pi / 2)
    assert (found.arcs, found.corners) == (1, 0)


def test_a_corner_stays_if_its_arc_and_its_removal_are_blocked():
    corner = np.array([[2.0, 2.0], [22.0, 2.0], [22.0, 22.0]])
    blocked = np.zeros((30, 30), bool)
    blocked[4:9, 16:20] = True
    found = rounded(corner, 10.0, np.ones((30, 30)), blocked)
    np.testing.assert_array_equal(found.points, corner)
    assert (found.arcs, found.corners) == (0, 1)


def test_a_tight_corner_is_removed_if_the_direct_segment_is_free():
    zigzag = np.array([[2.0, 2.0], [12.0, 2.0], [12.0, 3.0], [25.0, 3.0]])
    found = rounded(zigzag, 6.0, np.ones((30, 30)), np.zeros((30, 30), bool))
    assert found.corners == 0
    assert total_turning(found.points) < total_turning(zigzag) / 4


def test_an_arc_that_costs_more_than_its_corner_needs_an_allowance():
    # The inside of the corner is dear: cutting it costs more than walking round.
    corner = np.array([[2.0, 2.0], [22.0, 2.0], [22.0, 22.0]])
    rows, columns = np.indices((30, 30))
    price = 1.0 + 8.0 * np.exp(-((rows - 4.5) ** 2 + (columns - 19.5) ** 2) / 4.0)
    free = np.zeros((30, 30), bool)
    assert rounded(corner, 8.0, price, free).corners == 1
    assert rounded(corner, 8.0, price, free, allowance=30.0).corners == 0
