"""Sides of a surface against what was seen: a wall ends where its opening begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping.ground.measured import Side
from mapping.ground.outline import believed, outlines
from mapping.ground.seen_cells import CELL_M, SeenCells, lattice
from mapping.ground.surface import Border

WALL_M = 1.0  # x of a wall across a floor, open where y is in `DOOR`
DOOR = (0.2, 1.0)


@pytest.fixture
def floor():
    cells = SeenCells()
    points = lattice(np.array([-1.0, -2.0]), np.array([2.0, 2.0]))
    behind = (points[:, 0] > WALL_M) & ~((points[:, 1] > DOOR[0]) & (points[:, 1] < DOOR[1]))
    cells.add(points[~behind])
    return cells


def line(low: float, high: float) -> Side:
    """The wall, taken to reach from one y to another."""
    place, outward = np.array([WALL_M, 0.0]), np.array([1.0, 0.0])
    return Side(Border.RISE, place, outward, (low, high), 1e-6 * np.eye(2), 0.002, 0.0)


def test_a_wall_that_was_prolonged_over_an_opening_ends_before_and_begins_after_it(floor):
    found = believed(floor, [line(-1.8, 1.8)])
    ends = sorted(one.reach for one in found)
    np.testing.assert_allclose(ends, [(-1.8, DOOR[0]), (DOOR[1], 1.8)], atol=3 * CELL_M)


def test_a_wall_is_kept_whole_and_a_line_across_the_floor_is_not(floor):
    assert [one.reach for one in believed(floor, [line(-1.8, 0.1)])] == [(-1.8, 0.1)]
    assert believed(floor, [line(0.3, 0.9)]) == []


def test_of_two_walls_beside_each_other_the_one_that_more_images_showed_is_kept(floor):
    often = replace(line(-1.8, 0.1), views=8)
    once = replace(line(-1.5, 0.0), place=np.array([WALL_M - 0.055, 0.0]))
    assert believed(floor, [once, often]) == [often]
    assert believed(floor, [often, replace(once, views=3)]) == [often, replace(once, views=3)]
    short = replace(often, reach=(-1.8, -1.2))  # it says nothing of most of the other
    assert believed(floor, [short, once]) == [short, once]
    facing = replace(once, outward=-once.outward, reach=(0.0, 1.5))
    assert len(believed(SeenCells(), [facing, often])) == 2  # both faces of a thin wall


def test_the_floor_on_both_sides_of_the_opening_is_one_polygon(floor):
    sides = believed(floor, [line(-1.8, 1.8)])
    found = outlines(floor, sides, np.zeros(2))
    assert len(found) == 1
    area = 3.0 * 4.0 - 1.0 * (4.0 - (DOOR[1] - DOOR[0]))
    x, y = found[0].corners.T
    assert (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2 == pytest.approx(area, rel=0.03)
