"""Tiles: a world map is the same whatever the size of its tiles, and as large as the area that was seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid import tiles
from mapping.grid.tiles import Tiles
from mapping.grid.world_map import WorldMap
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane

CAMERA = np.array([0.0, 0.0, 0.4])
LAYERS = ("probability", "known", "stay", "updated_s", "height_m", "height_variance_m2", "origin")


def walk(world, frames=40, seed=3):
    """Frames along a winding path, with things that move, come and go, marks of movers, and ageing."""
    rng = np.random.default_rng(seed)
    for k in range(frames):
        here = np.array([0.5 * k * np.cos(0.1 * k), 0.3 * k])
        points = np.column_stack([here + rng.normal(0.0, 0.7, (900, 2)), rng.normal(0, 0.003, 900)])
        raised = rng.random(900) < 0.3
        points[raised, 2] = rng.uniform(0.1, 0.5, raised.sum())
        moving = raised & (rng.random(900) < 0.5)
        world.update(
            points,
            raised,
            0.2 * k,
            np.add(CAMERA, [*here, 0.0]),
            is_moving=moving,
            sigma_m=rng.uniform(0.002, 0.02, 900),
            floor=Plane(np.array([0.0, 0.0, 1.0]), 0.4, 1e-6 * np.eye(3)),
            pose=Gaussian(np.array([*here, 0.0]), np.diag([1e-4, 1e-4, 1e-5])),
        )
        if k % 5 == 4:
            world.mark_moving(here + rng.normal(0.0, 0.5, (3, 2)), np.array([0.2, 0.3, 0.1]))
        world.age(0.2)
    return world


def test_a_map_is_the_same_whatever_the_size_of_its_tiles(monkeypatch):
    usual = walk(WorldMap())
    for side in (7, 1024):  # the latter: hardly any tiles
        monkeypatch.setattr(tiles, "TILE", side)
        other = walk(WorldMap())
        for name in LAYERS:
            np.testing.assert_array_equal(getattr(usual, name), getattr(other, name), err_msg=name)
    assert usual.known.any()
    assert not usual.known.all()


def test_walking_the_same_ground_again_needs_no_more_tiles():
    world = walk(WorldMap())
    once = len(world._tiles)
    for seed in range(4, 8):
        walk(world, seed=seed)
    assert len(world._tiles) <= once + 2  # noise of the points at the border
    extent = np.prod(world.known.shape) / tiles.TILE**2
    assert once < extent  # the corners of the rectangle around a diagonal path have none


def test_a_far_point_needs_one_tile_and_not_all_on_the_way_to_it():
    world = WorldMap()
    near = np.random.default_rng(0).uniform(0.0, 1.0, (50, 3)) * [1.0, 1.0, 0.0]
    world.update(near, np.zeros(50, bool), 1.0, CAMERA)
    once = len(world._tiles)
    far = np.concatenate([near, [[60.0, -45.0, 0.0]]])
    world.update(far, np.zeros(51, bool), 2.0, CAMERA)
    assert len(world._tiles) == once + 1
    assert world.known[tuple(world.cell_of(far[-1, :2]))]


def test_ageing_forgets_what_moved_wherever_it_was_and_nothing_else():
    world = WorldMap()
    things = np.array([[0.52, 0.52, 0.3], [20.52, -7.48, 0.3]])
    for place, moving in zip(things, (True, False), strict=True):
        world.update(
            np.tile(place, (4, 1)), np.ones(4, bool), 1.0, CAMERA, is_moving=np.full(4, moving)
        )
    for k in range(400):
        world.update(np.array([[-9.0, 9.0, 0.0]]), np.zeros(1, bool), 2.0 + k, CAMERA)
        world.age(1.0)
    mover, still = (tuple(cell) for cell in world.cell_of(things[:, :2]))
    assert not world.known[mover]
    assert world.updated_s[mover] == 0.0
    assert world.known[still]
    assert world.probability[still] > 0.5
    assert len(world._restless) == 0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-90, 90), st.integers(-90, 90), st.integers(1, 40), st.integers(1, 40)),
        min_size=1,
        max_size=6,
    )
)  # fmt: skip
def test_what_is_written_into_windows_is_read_back_as_from_one_array(windows):
    found = Tiles({"a": np.float32(-1.0), "b": np.bool_(True)})
    dense = np.full((300, 300), np.float32(-1.0))
    for k, (x, y, columns, rows) in enumerate(windows):
        values = np.full((rows, columns), np.float32(k))
        low = np.array([x, y])
        found.make(low, np.ones((rows, columns), np.bool_))
        found.write(low, {"a": values})
        dense[y + 150 : y + 150 + rows, x + 150 : x + 150 + columns] = k
    whole = found.read(np.array([-150, -150]), (300, 300))
    np.testing.assert_array_equal(whole["a"], dense)
    assert whole["b"].all()


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (3, 0)])
def test_an_empty_window_has_no_cells(shape):
    empty = Tiles({"a": np.float32(0.0)})
    assert empty.read(np.zeros(2, int), shape)["a"].shape == shape
    assert len(empty) == 0
