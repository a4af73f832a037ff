"""The world map: its content does not depend on where it grows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.world_map import WorldMap, WorldMapConfig
from perception.primitives.errors import ConfigError, InputError


def test_it_agrees_with_a_terrain_map_that_does_not_move():
    # Start the terrain map in the middle of a world cell: then the two lattices are one.
    rng = np.random.default_rng(2)
    grid = EgocentricGrid(GridConfig(side_m=2.05), np.array([0.525, -0.275]))
    world = WorldMap()
    for k in range(40):
        points = np.array([0.525, -0.275]) + rng.uniform(-1.0, 1.0, (800, 2)) * rng.uniform(
            0.1, 1, 2
        )
        flags = rng.random(800) < 0.5
        moving = flags & (points[:, 0] > 0.8)
        grid.update(points, flags, k + 1.0, np.zeros(2), is_moving=moving)
        world.update(points, flags, k + 1.0, is_moving=moving)
    row, column = world.cell_of(grid.origin + grid.cell_m / 2)
    n = grid.config.cells
    ahead = np.s_[max(row, 0) : row + n, max(column, 0) : column + n]
    same = np.s_[max(-row, 0) :, max(-column, 0) :]
    rows, columns = world.known[ahead].shape
    np.testing.assert_array_equal(world.known[ahead], grid.known[same][:rows, :columns])
    seen = world.known[ahead]
    np.testing.assert_array_equal(
        world.probability[ahead][seen], grid.probability[same][:rows, :columns][seen]
    )
    assert world.known.sum() == grid.known.sum()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=8))
def test_its_content_does_not_depend_on_where_it_grows(places):
    world = WorldMap()
    expected: dict[tuple[int, int], float] = {}
    for k, place in enumerate(places):
        points = np.tile(np.array(place), (3, 1))
        world.update(points, np.ones(3, bool), float(k))
        cell = tuple(np.floor(np.array(place) * (1 / 0.05)).astype(int).tolist())
        odds = expected.get(cell)
        expected[cell] = np.log(0.85 / 0.15) if odds is None else min(odds + 1.73, 3.9)
    assert world.known.sum() == len(expected)
    for cell, odds in expected.items():
        row, column = world.cell_of((np.array(cell) + 0.5) * 0.05)
        assert world.probability[row, column] == pytest.approx(1 / (1 + np.exp(-odds)), abs=1e-6)


def test_empty_frames_leave_an_empty_map():
    world = WorldMap()
    world.update(np.zeros((0, 2)), np.zeros(0, bool), 1.0)
    world.update(np.full((4, 2), np.nan), np.ones(4, bool), 1.0)
    assert world.probability.shape == (0, 0)


def test_the_height_is_that_of_the_highest_static_obstacle_point_of_an_occupied_cell():
    world = WorldMap()
    points = np.tile(np.array([[0.52, 0.52]]), (4, 1))
    heights = np.array([0.1, 0.3, np.nan, 0.2])
    world.update(points, np.ones(4, bool), 1.0, heights)
    world.update(points, np.ones(4, bool), 1.5, heights + 1, is_moving=np.ones(4, bool))
    cell = tuple(world.cell_of(np.array([0.52, 0.52])))
    assert world.height_m[cell] == pytest.approx(0.3)
    for k in range(6):
        world.update(points[:1], np.zeros(1, bool), 2.0 + k, np.zeros(1))
    assert np.isnan(world.height_m[cell])


def test_heights_agree_with_numpy():
    rng = np.random.default_rng(4)
    points = rng.uniform(-1, 1, (5000, 2))
    heights = rng.uniform(0, 1, 5000)
    flags = rng.random(5000) < 0.5
    world = WorldMap()
    world.update(points, flags, 1.0, heights)
    cells = world.cell_of(points)
    twin = np.full(world.known.shape, -np.inf)
    np.maximum.at(twin, tuple(cells[flags].T), heights[flags])
    held = ~np.isnan(world.height_m)
    np.testing.assert_allclose(world.height_m[held], twin[held], rtol=1e-6)
    assert held.sum() > 300


def test_a_moving_obstacle_leaves_no_trail_on_floor_that_is_seen_again():
    # A disc walks 2 m through a seen floor; each frame shows the floor it no longer covers.
    rng = np.random.default_rng(6)
    grid, world = EgocentricGrid(GridConfig(), np.zeros(2)), WorldMap()
    for k in range(60):
        centre = np.array([-1.0 + 0.035 * k, 0.1])
        points = rng.uniform(-1.5, 1.5, (20_000, 2))
        distance = np.linalg.norm(points - centre, axis=1)
        flags = distance < 0.15
        for remember in (
            lambda *a, **b: grid.update(*a, np.zeros(2), **b),
            world.update,
        ):
            remember(points, flags, k + 1.0, is_moving=flags)
        grid.age(0.3)
        world.age(0.3)
    occupied = grid.known & (grid.probability >= 0.5)
    gap = np.linalg.norm(grid.centres() - centre, axis=-1)
    assert np.all(occupied[gap < 0.10])
    assert not np.any(occupied[gap > 0.23])  # the radius, and the diagonal of a cell
    assert (world.known & (world.probability >= 0.5)).sum() <= 60


def test_outliers_far_away_do_not_enlarge_the_map():
    world = WorldMap(WorldMapConfig(most_cells=90_000))
    near = np.random.default_rng(0).uniform(-1, 1, (300, 2))
    world.update(np.concatenate([near, [[1e7, 0.0], [0.0, -1e9]]]), np.zeros(302, bool), 1.0)
    assert world.dropped == 2
    assert world.probability.size <= 90_000
    known = world.known.sum()
    world.update(np.array([[1e6, 1e6]]), np.zeros(1, bool), 2.0)
    assert world.dropped == 3
    assert world.known.sum() == known


def test_bad_input_is_refused_with_its_reason():
    with pytest.raises(ConfigError, match=r"cell_m=0\.0 must be positive"):
        WorldMapConfig(cell_m=0.0)
    with pytest.raises(ConfigError, match="most_cells=10"):
        WorldMapConfig(most_cells=10)
    with pytest.raises(InputError, match="2 points but 1 flags or heights"):
        WorldMap().update.__wrapped__(  # without the shape check that tests add
            WorldMap(), np.zeros((2, 2)), np.zeros(1, bool), 1.0
        )


def test_depth_noise_does_not_thicken_a_wall():
    """A wall that ends 3 mm behind the edge of a cell, seen from near: hundreds of points in each of its cells."""
    rng = np.random.default_rng(3)
    thick, thin = WorldMap(WorldMapConfig(tail_share=0.0)), WorldMap()
    for stamp in range(1, 6):
        wall = np.column_stack([rng.normal(1.003, 0.002, 4000), rng.uniform(0.0, 0.5, 4000)])
        floor = np.column_stack([rng.uniform(0.5, 0.99, 500), rng.uniform(0.0, 0.5, 500)])
        for one in (thick, thin):
            is_obstacle = np.arange(4500) < 4000
            one.update(np.concatenate([wall, floor]), is_obstacle, float(stamp))
    before, behind = np.array([0.975, 0.275]), np.array([1.025, 0.275])
    assert thick.probability[tuple(thick.cell_of(before))] > 0.9
    assert thin.probability[tuple(thin.cell_of(before))] <= 0.5
    assert thin.probability[tuple(thin.cell_of(behind))] > 0.9


def test_a_thin_leg_in_front_of_a_wall_stays_in_the_map():
    """A leg has fewer points than the wall behind it, but more than noise."""
    world = WorldMap()
    wall = np.column_stack([np.full(400, 1.02), np.repeat(np.arange(0.005, 0.05, 0.005), 45)[:400]])
    leg = np.column_stack([np.full(60, 0.96), np.full(60, 0.02)])
    for stamp in (1.0, 2.0):
        world.update(np.concatenate([wall, leg]), np.ones(460, bool), stamp)
    assert world.probability[tuple(world.cell_of(np.array([0.96, 0.02])))] > 0.9
