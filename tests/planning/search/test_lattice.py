"""The lattice search against other implementations of Dijkstra, with widely varying costs."""

from __future__ import annotations

import math

import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.primitives.errors import ConfigError
from planning.search.astar import cheapest, find_path, lattice_cost, prepare
from planning.search.potential import BODY_M, SearchConfig, potential, repulsion

CELL_M = 0.05


def graph_of(price: np.ndarray, blocked: np.ndarray) -> networkx.Graph:
    """Free nodes and their eight neighbours, edges as seed 003 weighs them."""
    graph = networkx.Graph()
    rows, columns = price.shape
    for row, column in np.argwhere(~blocked).tolist():
        graph.add_node((row, column))
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            other = row + down, column + right
            if 0 <= other[0] < rows and 0 <= other[1] < columns and not blocked[other]:
                length = math.hypot(down, right)
                mean = (price[row, column] + price[other]) / 2
                graph.add_edge((row, column), other, weight=length * mean)
    return graph


def rough(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Prices that leap by factors of up to a hundred from node to node, and a third of them shut."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 14, 2))
    price = np.exp(rng.uniform(0.0, rng.choice([0.1, 1.0, 4.6]), shape))
    return price, rng.random(shape) < rng.choice([0.0, 0.3])


@settings(max_examples=120, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_any_prices_give_networkx_cost_and_a_real_path(seed):
    price, blocked = rough(seed)
    rng = np.random.default_rng(seed)
    start, goal = (tuple(int(rng.integers(n)) for n in price.shape) for _ in range(2))
    cells = cheapest(price, blocked, start, goal)
    graph = graph_of(price, blocked)
    reachable = start in graph and goal in graph and networkx.has_path(graph, start, goal)
    assert (cells is not None) == reachable
    if cells is None:
        return
    assert tuple(cells[0]) == start
    assert tuple(cells[-1]) == goal
    assert not blocked[tuple(cells.T)].any()
    assert np.abs(np.diff(cells, axis=0)).max(initial=1) == 1
    best = networkx.dijkstra_path_length(graph, start, goal)
    assert lattice_cost(cells, price) == pytest.approx(best, rel=1e-12, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1.0, 50.0))
def test_scaling_all_costs_keeps_the_cheapest_path(seed, factor):
    price, blocked = rough(seed)
    start, goal = (0, 0), (price.shape[0] - 1, price.shape[1] - 1)
    once, more = (cheapest(p, blocked, start, goal) for p in (price, factor * price))
    assert (once is None) == (more is None)
    if once is not None and more is not None:
        a, b = lattice_cost(once, price), lattice_cost(more, price)
        assert a == pytest.approx(b, rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_there_and_back_cost_the_same(seed):
    price, blocked = rough(seed)
    start, goal = (0, 0), (price.shape[0] - 1, price.shape[1] - 1)
    there, back = cheapest(price, blocked, start, goal), cheapest(price, blocked, goal, start)
    assert (there is None) == (back is None)
    if there is not None and back is not None:
        a, b = lattice_cost(there, price), lattice_cost(back, price)
        assert a == pytest.approx(b, rel=1e-12)


def test_a_path_to_the_start_is_one_node():
    cells = cheapest(np.ones((5, 5)), np.zeros((5, 5), bool), (2, 3), (2, 3))
    np.testing.assert_array_equal(cells, [[2, 3]])


def test_a_blocked_end_has_no_path():
    blocked = np.zeros((5, 5), bool)
    blocked[2, 3] = True
    assert cheapest(np.ones((5, 5)), blocked, (2, 3), (0, 0)) is None
    assert cheapest(np.ones((5, 5)), blocked, (0, 0), (2, 3)) is None


@pytest.mark.parametrize("seed", range(12))
def test_a_goal_outside_the_map_is_approached_at_the_border_cell_of_least_total(seed):
    rng = np.random.default_rng(seed)
    probability = np.full((30, 30), 0.02)
    for row, column in rng.integers(0, 30, (5, 2)):
        probability[row : row + 3, column : column + 3] = 0.9
    probability[10:20, 10:20] = 0.02
    nothing, config = np.zeros((30, 30), bool), SearchConfig()
    start, goal = np.array([0.76, 0.74]), np.array([2.5, rng.uniform(0.1, 1.4)])
    path = find_path(probability, nothing, np.zeros(2), CELL_M, start, goal, config)
    ground = prepare(probability, nothing, np.zeros(2), CELL_M, start, config)
    reached = networkx.single_source_dijkstra_path_length(
        graph_of(ground.price, ground.blocked), (14, 15)
    )
    total = {
        row: reached[row, 29] * CELL_M + math.dist(((29.5) * CELL_M, (row + 0.5) * CELL_M), goal)
        for row in range(30)
        if (row, 29) in reached
    }
    assert path is not None
    row, column = path.cells[-1]
    assert column == 29
    assert total[row] == pytest.approx(min(total.values()), rel=1e-9)


def test_khatibs_form_has_the_values_of_the_specification_times_the_radius_squared():
    # 1344 per m^2 on the cell itself, 0.4 at 5 cm from the margin.
    config = SearchConfig(form="khatib")
    on, near, beyond = repulsion(np.array([0.0, 0.25, 0.30]), CELL_M, config) / BODY_M**2
    assert on == pytest.approx(1344, abs=1)
    assert near == pytest.approx(0.44, abs=0.01)
    assert beyond == 0.0


def test_both_forms_are_equal_at_the_body_radius_and_khatibs_is_steeper():
    smooth, khatib = SearchConfig(), SearchConfig(form="khatib")
    at = np.array([BODY_M])
    assert repulsion(at, CELL_M, smooth) == pytest.approx(repulsion(at, CELL_M, khatib))
    assert repulsion(at - 0.05, CELL_M, khatib) > repulsion(at - 0.05, CELL_M, smooth)
    assert repulsion(at + 0.05, CELL_M, khatib) < repulsion(at + 0.05, CELL_M, smooth)


def test_khatibs_potential_is_the_strongest_repulsion_of_any_cell():
    rng = np.random.default_rng(4)
    probability = rng.uniform(0, 1, (9, 12)) ** 4
    config = SearchConfig(form="khatib")
    rows, columns = np.indices(probability.shape)
    brute = np.zeros(probability.shape)
    for row, column in np.ndindex(probability.shape):
        distance = np.hypot(rows - row, columns - column) * CELL_M
        strength = 0.16 * (1 / np.maximum(distance, CELL_M / 2) - 1 / 0.3)
        brute = np.maximum(brute, probability[row, column] * np.maximum(strength, 0.0) ** 2)
    np.testing.assert_allclose(potential(probability, CELL_M, config), brute, atol=1e-12)


def test_an_unknown_form_is_named():
    with pytest.raises(ConfigError, match="form='steep' is unknown"):
        SearchConfig(form="steep")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(-40, 40), st.integers(-40, 40))
def test_the_origin_of_the_map_does_not_change_the_path(seed, right, up):
    rng = np.random.default_rng(seed)
    probability = np.full((40, 40), 0.02)
    for row, column in rng.integers(8, 32, (5, 2)):
        probability[row : row + 3, column : column + 3] = 0.97
    nothing, config = np.zeros((40, 40), bool), SearchConfig()
    ends = (np.array([[3, 3], [36, 35]]) + 0.5) * CELL_M
    moved = np.array([right, up]) * CELL_M
    here = find_path(probability, nothing, np.zeros(2), CELL_M, ends[0], ends[1], config)
    there = find_path(probability, nothing, moved, CELL_M, ends[0] + moved, ends[1] + moved, config)
    assert (here is None) == (there is None)
    if here is not None and there is not None:
        assert here.cost_m == pytest.approx(there.cost_m, rel=1e-9)
        np.testing.assert_array_equal(here.cells, there.cells)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_curve_costs_no_more_than_the_lattice_path_and_respects_the_turning_radius(seed):
    rng = np.random.default_rng(seed)
    probability = np.full((60, 60), 0.02)
    for row, column in rng.integers(8, 50, (8, 2)):
        probability[row : row + 4, column : column + 3] = 0.97
    nothing, config = np.zeros((60, 60), bool), SearchConfig()
    ends = (np.array([[4, 4], [55, 53]]) + 0.5) * CELL_M
    path = find_path(probability, nothing, np.zeros(2), CELL_M, ends[0], ends[1], config)
    if path is None:
        return
    ground = prepare(probability, nothing, np.zeros(2), CELL_M, ends[0], config)
    line = (path.cells[:, ::-1] + 0.5) * CELL_M
    assert ground.cost_m(path.curve) <= ground.cost_m(line) + 1e-9
    np.testing.assert_allclose(path.curve[[0, -1]], path.waypoints[[0, -1]], atol=1e-12)
    sharp = 0
    for a, b, c in zip(path.curve[:-2], path.curve[1:-1], path.curve[2:], strict=True):
        u, v = b - a, c - b
        turn = abs(math.atan2(u[0] * v[1] - u[1] * v[0], float(u @ v)))
        radius = math.dist(a, c) / (2 * math.sin(turn)) if turn > 1e-9 else math.inf
        sharp += turn >= 0.02 and radius < path.turn_radius_m * (1 - 1e-6)
    assert sharp <= path.corners


def test_extreme_costs_neither_fill_the_memory_nor_change_the_path():
    price = np.ones((20, 20))
    price[10, 1:] = 1e12
    price[11, 1:] = np.inf
    cells = cheapest(price, np.zeros((20, 20), bool), (0, 19), (19, 19))
    assert cells is not None
    assert (cells[:, 1].min(), lattice_cost(cells, price) < 50) == (0, True)
