"""The coarse map of the way to a goal, against peers: SciPy's distances and its Dijkstra over a graph of the cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from planning.footholds._way_kernels import (
    BARRED,
    COARSE,
    GAP_M,
    RISE,
    TIGHT,
    VOID,
    estimate,
    off_way,
    spread,
    way_left,
)  # fmt: skip

CELL_M, CORNER = 0.05, np.array([-1.0, -1.5])
UP_M, DOWN_M = 0.14, 0.10
LIMITS = np.array([0.0, 0.0, 0.0, 0.0, UP_M, DOWN_M, 0.0, 0.0, math.tan(math.radians(5.0))])
COSTS = np.array([0.0, 0.0, 1.5, 2.5, 0.0])  # a metre up and a metre down
RADIUS_M, LEVEL_M = 0.22, 0.01
x_of, y_of = CORNER[:, None, None] + (np.mgrid[:COARSE, :COARSE] + 0.5)[::-1] * CELL_M
"""Middles of the cells, m, [row, column]."""


def packed(rectangles, rising=()):
    """Sides and planes of (x0, y0, x1, y1, height, slope along x); what is beyond a rising one's front is higher."""
    sides, planes = [], []
    for k, (x0, y0, x1, y1, z, slope) in enumerate(rectangles):
        ring = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        borders = np.where((np.arange(4) == 1) & (k in rising), RISE, 0)
        sides.append(np.column_stack([ring, np.roll(ring, -1, axis=0), np.full(4, 0.01), borders]))
        planes.append([4 * k, 4 * k + 4, x0, y0, z, slope, 0.0])
    return np.concatenate(sides), np.array(planes)


def way(rectangles, goal, rising=(), ground=None, beside=0.12):
    """Cost of the way from every cell."""
    ground = ground or (np.zeros((0, 0)), np.zeros((0, 0), np.bool_), np.array([0.0, 0.0, 1.0]))
    return way_left(
        *packed(rectangles, rising), np.array(goal), CORNER, CELL_M, LIMITS, COSTS, beside, RADIUS_M, LEVEL_M, *ground,
    )  # fmt: skip


def at(x, y):
    """Row and column of a place."""
    return math.floor((y - CORNER[1]) / CELL_M), math.floor((x - CORNER[0]) / CELL_M)


def by_scipy(rectangles, goal, ground, beside):
    """The same from the definition: cells are nodes, and a step between neighbours is an edge if its rise is possible."""
    height = np.full((COARSE, COARSE), np.nan)
    for x0, y0, x1, y1, z, slope in rectangles:
        there = (x_of > x0) & (x_of < x1) & (y_of > y0) & (y_of < y1) & (slope <= LIMITS[8])
        height[there] = np.fmax(height, z + slope * (x_of - x0))[there]
    known = np.pad(np.isfinite(height), (n := math.ceil(beside / CELL_M)))
    beside_all = (
        known[2 * n :, n:-n] & known[: -2 * n, n:-n] & known[n:-n, 2 * n :] & known[n:-n, : -2 * n]
    )
    price = np.where(np.isfinite(height), np.where(beside_all, 1.0, TIGHT), VOID)
    prices, blocked, (x0, y0, side) = ground
    rows, columns = ((axis - low) // side for axis, low in ((y_of, y0), (x_of, x0)))
    for row, column in np.ndindex(prices.shape):
        toll = BARRED if blocked[row, column] else min(prices[row, column], BARRED)
        price[(rows == row) & (columns == column)] *= toll
    spread(height, math.ceil(GAP_M / CELL_M))
    number = np.arange(COARSE**2).reshape(COARSE, COARSE)
    edges = []
    for down, right in np.argwhere(np.ones((3, 3))) - 1:
        if down == right == 0:
            continue
        towards = np.s_[
            max(down, 0) : COARSE + min(down, 0), max(right, 0) : COARSE + min(right, 0)
        ]
        come_from = np.s_[
            max(-down, 0) : COARSE + min(-down, 0), max(-right, 0) : COARSE + min(-right, 0)
        ]
        rise = height[towards] - height[come_from]
        cost = CELL_M * math.hypot(down, right) * np.maximum(price[towards], price[come_from])
        cost += np.nan_to_num(np.maximum(COSTS[2] * rise, -COSTS[3] * rise))
        walked = ~((rise > UP_M) | (rise < -DOWN_M))
        edges.append((cost[walked], number[towards][walked], number[come_from][walked]))
    cost, ends, begins = (np.concatenate(part) for part in zip(*edges, strict=True))
    graph = coo_array((cost, (ends, begins)), shape=(COARSE**2, COARSE**2))
    return dijkstra(graph.tocsr(), indices=number[at(*goal)]).reshape(COARSE, COARSE)


def test_the_way_costs_what_the_shortest_path_over_the_cells_costs():
    rng = np.random.default_rng(5)
    for _ in range(4):
        corners = CORNER + CELL_M * (rng.integers(0, 60, (12, 2)) + 0.3)
        ends = corners + CELL_M * rng.integers(8, 40, (12, 2))
        heights, slopes = 0.06 * rng.integers(0, 6, 12), rng.choice([0.0, 0.05, 0.2], 12)
        rectangles = np.column_stack([corners, ends, heights, slopes])
        ground = (
            np.exp(2.0 * rng.random((9, 11))),
            rng.random((9, 11)) < 0.1,
            np.array([-0.8, -0.7, 0.21]),
        )
        beside = rng.uniform(0.02, 0.25)
        goal = 0.5 * (corners[0] + ends[0])
        found = way(rectangles, goal, ground=ground, beside=beside)
        np.testing.assert_allclose(found, by_scipy(rectangles, goal, ground, beside), rtol=1e-9)


@pytest.mark.parametrize(("gap_m", "open_"), [(0.2, False), (1.0, True)])
def test_heights_hold_across_a_gap_that_a_footstep_crosses_and_no_farther(gap_m, open_):
    """Two levels that no footstep joins: what was not seen between them may hold stairs if it is wide enough."""
    beyond = 0.8 + gap_m
    left = way([(-1.0, -1.5, 0.8, 3.3, 0.0, 0.0), (beyond, -1.5, 3.8, 3.3, 0.5, 0.0)], (3.0, 0.0))
    assert np.isfinite(left[at(3.5, 1.0)])
    assert np.isfinite(left[at(0.0, 0.0)]) == open_


@pytest.mark.parametrize(
    ("rise_m", "barred"), [(None, True), (0.1, False), (0.3, True), (0.004, True)]
)
def test_a_side_of_a_floor_that_rises_bars_within_the_radius_unless_a_step_up_is_known_there(
    rise_m, barred
):
    floor, wall_x = (-1.0, -0.5, 1.0, 2.3, 0.02, 0.0), 1.0
    beyond = [] if rise_m is None else [(1.0, -0.5, 2.5, 2.3, 0.02 + rise_m, 0.0)]
    left = way([floor, *beyond], (0.0, 0.9), rising=(0,))
    for y in (0.0, 0.93, 1.8):
        price = []
        for near in (RADIUS_M - 1.5 * CELL_M, RADIUS_M + 1.5 * CELL_M):
            here, next_ = at(wall_x - near, y), at(wall_x - near - CELL_M, y)
            price.append((left[here] - left[next_]) / CELL_M)
        assert (price[0] > 0.9 * BARRED) == barred
        assert price[1] < 2.0  # the body has room


def test_a_tread_whose_end_rises_bars_nothing():
    left = way([(0.6, 0.0, 0.9, 1.0, 0.1, 0.0)], (0.75, 0.5), rising=(0,))
    assert left[at(0.85, 0.5)] < 1.0


def test_an_unknown_cell_takes_the_height_of_the_nearest_known_one():
    rng = np.random.default_rng(0)
    for share in (0.01, 0.05, 0.3):
        known = rng.random((17, 23)) < share
        height = np.where(known, rng.random(known.shape), np.nan)
        filled = height.copy()
        spread(filled, 4)
        away = distance_transform_cdt(~known, metric="taxicab")
        np.testing.assert_array_equal(np.isfinite(filled), away <= 4)
        rows, columns = np.nonzero(known)
        for row, column in np.argwhere(np.isfinite(filled)):
            distance = np.abs(rows - row) + np.abs(columns - column)
            nearest = distance == away[row, column]
            assert filled[row, column] in height[rows[nearest], columns[nearest]]


def test_the_estimate_from_between_the_cells_is_that_of_the_distance_and_never_too_small():
    rng = np.random.default_rng(2)
    goal, detour_m = np.array([0.7, 0.4]), 3.0
    left = detour_m + np.hypot(x_of - goal[0], y_of - goal[1])
    for x, y in CORNER + CELL_M * COARSE * np.append(
        rng.random((200, 2)), [[0.001, 0.999], [0.999, 0.001]], axis=0
    ):
        straight = math.hypot(goal[0] - x, goal[1] - y)
        found = estimate(left, CORNER, CELL_M, goal, x, y)
        assert straight + detour_m - 1e-9 <= found <= straight + detour_m + 0.6 * CELL_M
    for outside in (CORNER - 0.1, CORNER + np.array([0.5, 5.0])):
        away = VOID * np.linalg.norm(goal - outside)
        assert estimate(left, CORNER, CELL_M, goal, *outside) == pytest.approx(away)


def test_the_way_off_a_heading_is_the_angle_to_where_the_way_leads():
    rng = np.random.default_rng(3)
    cell, corner, goal = 0.01, np.array([0.3, -0.7]), np.array([5.0, 3.0])
    middles = corner[:, None, None] + (np.mgrid[:COARSE, :COARSE] + 0.5)[::-1] * cell
    for _ in range(60):
        bearing, yaw = rng.uniform(-np.pi, np.pi, 2) * [1.0, 2.0]
        x, y = corner + rng.uniform(0.42, 0.5, 2)  # in the map of 0.96 m
        past = np.array([x, y]) + 3.0 * np.array([np.cos(bearing), np.sin(bearing)])
        left = np.hypot(*(middles - past[:, None, None])) + 2.0
        unknown = np.full_like(left, np.inf)
        for leads, field in ((bearing, left), (math.atan2(goal[1] - y, goal[0] - x), unknown)):
            off = off_way(field, corner, cell, goal, x, y, yaw)
            assert off == pytest.approx(abs(np.angle(np.exp(1j * (leads - yaw)))), abs=0.35)
        near = np.array([x + 0.2, y])  # nearer than the way looks ahead
        off = off_way(left, corner, cell, near, x, y, yaw)
        assert off == pytest.approx(abs(np.angle(np.exp(-1j * yaw))), abs=1e-9)
