"""Rooms of drawn maps: their number, areas, doorways and floors are those that were drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid.rooms import find, rooms_of
from mapping.grid.world_map import WorldMap

CELL_M = 0.05


class Drawing:
    """A map of walls, furniture and floor; metres, origin (-1, 2)."""

    def __init__(self, width_m, height_m):
        self.shape = round(height_m / CELL_M), round(width_m / CELL_M)
        self.probability = np.full(self.shape, 0.02, np.float32)
        self.known = np.ones(self.shape, bool)
        self.box(0, 0, width_m, 0.1)
        self.box(0, height_m - 0.1, width_m, height_m)
        self.box(0, 0, 0.1, height_m)
        self.box(width_m - 0.1, 0, width_m, height_m)

    def box(self, x0, y0, x1, y1, probability=0.97):
        c = [round(v / CELL_M) for v in (x0, y0, x1, y1)]
        self.probability[c[1] : c[3], c[0] : c[2]] = probability

    def rooms(self):
        return find(self.probability, self.known, np.array([-1.0, 2.0]), CELL_M)


def two_rooms(door_m=0.8):
    """4 x 3 m and 3 x 3 m, a doorway of that width in the wall between them, its middle at y = 1.5 m."""
    drawn = Drawing(7.3, 3.2)
    low, high = 1.6 - door_m / 2, 1.6 + door_m / 2
    drawn.box(4.1, 0.0, 4.2, low)
    drawn.box(4.1, high, 4.2, 3.2)
    return drawn


@pytest.mark.parametrize("door_m", [0.5, 0.6, 0.7, 0.8, 0.9])
def test_two_rooms_have_their_areas_and_one_doorway_of_its_width(door_m):
    found = two_rooms(door_m).rooms()
    assert sorted(room.area_m2 for room in found.rooms) == pytest.approx([9.0, 12.0], abs=0.1)
    (door,) = found.doors
    assert door.rooms == (1, 2)
    assert (
        abs(door.width_m - door_m) <= CELL_M + 1e-9
    )  # here both jambs end at the edges of their cells
    assert door.sigma_m < 0.04
    assert math.dist(door.centre, (-1.0 + 4.15, 2.0 + 1.6)) < 0.1
    assert found.floors == ((1, 2),)


def test_widths_of_doorways_anywhere_between_the_cells_are_right_on_average_and_within_their_deviation():
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(24):
        width, middle = rng.uniform(0.55, 0.85), rng.uniform(1.2, 2.0)
        drawn = Drawing(7.3, 3.2)
        edges = np.arange(drawn.shape[0] + 1) * CELL_M
        stands = (edges[:-1] < middle - width / 2) | (edges[1:] > middle + width / 2)
        drawn.probability[stands, 82:84] = 0.97
        (door,) = drawn.rooms().doors
        errors.append((door.width_m - width) / door.sigma_m)
    assert abs(np.mean(errors)) < 3.0 / math.sqrt(len(errors))
    assert np.mean(np.square(errors)) < 1.9  # chi-square, 24 degrees: 99.9 % below 2.1


def test_a_room_without_a_doorway_is_a_floor_of_its_own():
    drawn = two_rooms()
    drawn.box(4.1, 0.0, 4.2, 3.2)
    found = drawn.rooms()
    assert len(found.rooms) == 2
    assert found.doors == ()
    assert sorted(found.floors) == [(1,), (2,)]


def test_a_wide_opening_parts_no_rooms():
    assert len(two_rooms(1.6).rooms().rooms) == 1


def test_furniture_that_leaves_a_narrow_passage_parts_no_rooms():
    drawn = Drawing(4.2, 3.2)
    drawn.box(2.0, 0.0, 2.6, 1.2)  # a table at the wall, hollow as far as the map knows
    drawn.box(1.9, 1.9, 2.6, 3.2)
    drawn.known[5:20, 42:50] = False
    drawn.known[42:60, 40:50] = False
    found = drawn.rooms()
    assert len(found.rooms) == 1
    assert found.doors == ()


def test_the_gap_between_two_things_that_stand_alone_is_no_doorway():
    drawn = Drawing(4.2, 2.2)
    drawn.box(2.0, 0.4, 2.1, 0.9)
    drawn.box(2.0, 1.3, 2.1, 1.8)
    found = drawn.rooms()
    assert len(found.rooms) == 1
    assert found.doors == ()


def test_an_opening_wider_than_a_doorway_may_be_parts_no_rooms():
    (door,) = two_rooms(0.9).rooms().doors
    assert door.width_m <= 0.95 + 1e-9
    assert two_rooms(1.0).rooms().doors == ()
    assert len(two_rooms(1.0).rooms().rooms) == 1


def test_an_open_door_leaf_hides_no_doorway():
    for swing_deg in (90.0, 105.0, 120.0):
        drawn = two_rooms(0.7)
        hinge, turn = np.array([4.2, 1.95]), math.radians(swing_deg)
        for s in np.linspace(0.0, 0.7, 40):
            x, y = hinge + s * np.array([math.sin(turn), -math.cos(turn)])
            drawn.box(x, y, x + CELL_M, y + CELL_M)
        found = drawn.rooms()
        assert len(found.rooms) == 2
        assert len(found.doors) == 1
        assert abs(found.doors[0].width_m - 0.7) < 0.1


def test_unseen_space_is_no_room_and_specks_and_small_holes_part_none():
    drawn = two_rooms()
    whole = drawn.rooms()
    drawn.known[:, 84:] = False  # the second room
    alone = drawn.rooms()
    assert len(alone.rooms) == 1
    drawn = two_rooms()
    drawn.probability[20:22, 30] = 0.9
    drawn.known[40:44, 40:44] = False
    marred = drawn.rooms()
    areas = [sorted(room.area_m2 for room in one.rooms) for one in (marred, whole)]
    assert areas[0] == pytest.approx(areas[1], abs=0.05)


def test_doubt_about_cells_widens_the_deviation_of_areas_and_widths():
    sure, doubtful = two_rooms(), two_rooms()
    doubtful.probability = np.clip(doubtful.probability, 0.25, 0.75)
    assert len(sure.rooms().rooms) == 2
    for a, b in zip(sure.rooms().rooms, doubtful.rooms().rooms, strict=True):
        cells = a.area_m2 / CELL_M**2
        assert a.sigma_m2 == pytest.approx(math.sqrt(cells * 0.02 * 0.98) * CELL_M**2, rel=1e-3)
        assert b.sigma_m2 > 2.0 * a.sigma_m2
    assert doubtful.rooms().doors[0].sigma_m > 2.0 * sure.rooms().doors[0].sigma_m


def test_outlines_enclose_the_middles_of_their_rooms():
    rooms = two_rooms().rooms().rooms
    assert len(rooms) == 2
    for room in rooms:
        x, y = room.outline.T
        around = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
        assert around == pytest.approx(room.area_m2, rel=0.08)
        low, high = room.outline.min(axis=0), room.outline.max(axis=0)
        assert (low < room.centre).all()
        assert (high > room.centre).all()


def test_turned_maps_have_the_same_rooms():
    plain = two_rooms(0.7)
    turned = Drawing(1.0, 1.0)
    turned.probability, turned.known = plain.probability.T.copy(), plain.known.T.copy()
    a, b = plain.rooms(), turned.rooms()
    assert [room.area_m2 for room in a.rooms] == pytest.approx([room.area_m2 for room in b.rooms], abs=0.1)  # fmt: skip
    assert a.doors[0].width_m == pytest.approx(b.doors[0].width_m, abs=1e-9)


def test_an_empty_map_has_no_rooms():
    found = rooms_of(WorldMap())
    assert found.rooms == ()
    assert found.doors == ()
    assert found.floors == ()
