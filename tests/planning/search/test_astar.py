"""The search against scipy's Dijkstra, and blocked or outside starts and goals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from perception.primitives.errors import InputError
from planning.search.astar import find_path, lattice_cost, prepare
from planning.search.potential import BODY_M, SearchConfig

CELL_M = 0.05
ORIGIN = np.array([-1.0, 2.0])


def centre(row, column):
    return ORIGIN + (np.array([column, row]) + 0.5) * CELL_M


def random_map(seed, side=40):
    """Blobs of obstacles and a corner never seen; start and goal corners mostly free."""
    rng = np.random.default_rng(seed)
    probability = rng.uniform(0.02, 0.3, (side, side))
    for row, column in rng.integers(0, side, (14, 2)):
        probability[row : row + rng.integers(1, 5), column : column + rng.integers(1, 5)] = 0.97
    unknown = np.zeros((side, side), bool)
    r, c = rng.integers(5, side, 2)
    unknown[r:, c:] = True
    return probability, unknown


def dijkstra_cost_m(ground, start, goal):
    """Least cost on the 8-neighbour graph of free cells, edges as seed 003 weighs them."""
    rows, columns = ground.price.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, w = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for row in range(rows - down):
            for column in range(max(0, -right), columns - max(0, right)):
                other = row + down, column + right
                if not (ground.blocked[row, column] or ground.blocked[other]):
                    price = (ground.price[row, column] + ground.price[other]) / 2
                    a.append(index[row, column])
                    b.append(index[other])
                    w.append(price * math.hypot(down, right))
    graph = coo_matrix((w, (a, b)), shape=(rows * columns,) * 2).tocsr()
    costs = dijkstra(graph, directed=False, indices=index[start])
    return float(costs[index[goal]]) * CELL_M


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("alpha", [0.0, 5.0])
def test_the_search_costs_what_dijkstra_costs(seed, alpha):
    probability, unknown = random_map(seed)
    config = SearchConfig(alpha=alpha)
    rng = np.random.default_rng(seed)
    ground = prepare(probability, unknown, ORIGIN, CELL_M, centre(2, 2), config)
    free = np.argwhere(~ground.blocked)
    start, goal = (tuple(int(v) for v in free[rng.integers(len(free))]) for _ in range(2))
    ground = prepare(probability, unknown, ORIGIN, CELL_M, centre(*start), config)
    if ground.blocked[start] or ground.blocked[goal]:
        pytest.skip("the free disc at the start changed the map")
    expected = dijkstra_cost_m(ground, start, goal)
    path = find_path(probability, unknown, ORIGIN, CELL_M, centre(*start), centre(*goal), config)
    if path is None:
        assert math.isinf(expected)
        return
    assert path.cost_m == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert path.cost_m == pytest.approx(lattice_cost(path.cells, ground.price) * CELL_M)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 100_000))
def test_no_path_enters_a_blocked_cell_and_shortcuts_cost_no_more(seed):
    probability, unknown = random_map(seed)
    config = SearchConfig()
    start, goal = centre(3.3, 2.8), centre(36.2, 36.9)
    path = find_path(probability, unknown, ORIGIN, CELL_M, start, goal, config)
    if path is None:
        return
    ground = prepare(probability, unknown, ORIGIN, CELL_M, start, config)
    assert not ground.blocked[path.cells[:, 0], path.cells[:, 1]].any()
    smoothed = path.ground.cost_m(path.waypoints)
    assert math.isfinite(smoothed)
    straight_ends = CELL_M * (1 + config.alpha)  # the ends move inside their cells
    assert smoothed <= path.cost_m + straight_ends
    if len(ground.solid):
        assert path.clearance_m > BODY_M - CELL_M * math.sqrt(0.5) - 1e-9


def test_a_wall_with_a_gap_gives_the_lengths_of_the_specification():
    probability = np.zeros((71, 71))
    probability[35, :60] = 1.0
    known = np.zeros((71, 71), bool)
    start, goal = centre(5, 35), centre(65, 35)
    lengths, clearances = [], []
    for alpha in (0.0, 1.0, 5.0):
        path = find_path(probability, known, ORIGIN, CELL_M, start, goal, SearchConfig(alpha=alpha))
        lengths.append(path.length_m)
        clearances.append(path.clearance_m)
    assert lengths == sorted(lengths)
    assert clearances == sorted(clearances)
    assert clearances[0] >= 0.12
    assert clearances[-1] >= 0.20


def test_the_printed_evaluation_is_never_cheaper_than_the_optimum():
    worse = 0
    for seed in range(30):
        probability, unknown = random_map(seed)
        ends = centre(2, 2), centre(37, 20)
        best = find_path(probability, unknown, ORIGIN, CELL_M, *ends, SearchConfig())
        literal = find_path(probability, unknown, ORIGIN, CELL_M, *ends, SearchConfig(literal=True))
        assert (best is None) == (literal is None)
        if best is not None:
            assert literal.cost_m >= best.cost_m - 1e-9
            worse += literal.cost_m > best.cost_m + 1e-6
    assert worse > 5  # it does lose optimality


def test_a_goal_outside_the_map_is_approached_on_its_side():
    probability = np.full((41, 41), 0.02)
    known = np.zeros((41, 41), bool)
    start, goal = centre(20, 20), centre(20, 140)
    path = find_path(probability, known, ORIGIN, CELL_M, start, goal, SearchConfig())
    assert path.cells[-1, 1] == 40
    assert float(np.hypot(*(path.goal - path.waypoints[-1]))) == pytest.approx(5.0, abs=0.03)
    assert np.hypot(*(path.waypoints[-1] - centre(20, 40))) < 0.05


def test_a_goal_outside_behind_a_wall_is_approached_over_another_side():
    probability = np.full((41, 41), 0.02)
    probability[:, 38] = 0.99
    known = np.zeros((41, 41), bool)
    path = find_path(
        probability, known, ORIGIN, CELL_M, centre(20, 20), centre(30, 140), SearchConfig()
    )
    assert path is not None
    assert path.cells[-1, 0] in (0, 40)


def test_start_and_goal_inside_obstacles_move_to_the_nearest_free_node():
    probability = np.full((41, 41), 0.02)
    probability[10, 10] = probability[30, 30] = 0.99
    known = np.zeros((41, 41), bool)
    path = find_path(
        probability, known, ORIGIN, CELL_M, centre(10, 11), centre(30, 30), SearchConfig()
    )
    for cell, obstacle in ((path.cells[0], (10, 10)), (path.cells[-1], (30, 30))):
        distance = math.dist(cell, obstacle) * CELL_M
        assert 0.16 < distance <= 0.16 + CELL_M


def test_a_start_beside_a_thin_wall_does_not_jump_to_its_other_side():
    probability = np.full((41, 41), 0.02)
    probability[20, :] = 0.99
    known = np.zeros((41, 41), bool)
    path = find_path(
        probability, known, ORIGIN, CELL_M, centre(21, 20), centre(35, 20), SearchConfig()
    )
    assert path.cells[0, 0] > 20


def test_an_enclosed_goal_has_no_path():
    probability = np.full((41, 41), 0.02)
    probability[25, 25:] = probability[25:, 25] = 0.99
    known = np.zeros((41, 41), bool)
    assert (
        find_path(probability, known, ORIGIN, CELL_M, centre(5, 5), centre(36, 36), SearchConfig())
        is None
    )


def test_a_start_outside_the_map_is_refused():
    free = np.zeros((5, 5))
    with pytest.raises(InputError, match="outside the map"):
        find_path(free, free > 1, ORIGIN, CELL_M, ORIGIN - 1, ORIGIN, SearchConfig())


def test_a_goal_that_is_not_finite_is_refused():
    free = np.zeros((5, 5))
    with pytest.raises(InputError, match="goal"):
        find_path(
            free, free > 1, ORIGIN, CELL_M, ORIGIN + 0.1, np.array([np.nan, 0.0]), SearchConfig()
        )
