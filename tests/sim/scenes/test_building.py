"""The building: twenty rooms and two corridors that a tour passes, each with tags and doorways of its own."""

from __future__ import annotations

import itertools
import math
from functools import cache

import cv2
import numpy as np
import pytest

from perception.localisation import landmarks
from sim.free_space import clearance_map
from sim.rendering.textures import _tag
from sim.scenes import catalogue
from sim.scenes.building import TOURS
from sim.scenes.flat import WALKER_RADIUS_M
from sim.shapes import Box, distance

CASES = [(0, 0.5), (1, 0.0), (2, 1.0)]


@cache
def made(seed, difficulty):
    return catalogue.load("building", seed, difficulty)


@pytest.fixture(params=CASES, ids=lambda case: f"seed{case[0]}-difficulty{case[1]}")
def scene(request):
    return made(*request.param)


@cache
def space(scene):
    return clearance_map(scene.extent, [p for t in scene.static_objects for p in t.parts])


def room_of(scene, place):
    """Number of the room that contains a place; -1 in a doorway."""
    for k, (x0, y0, x1, y1) in enumerate(scene.rooms):
        if x0 <= place[0] <= x1 and y0 <= place[1] <= y1:
            return k
    return -1


def test_twenty_rooms_and_two_corridors_have_doorways_of_a_home(scene):
    assert len(scene.rooms) == 22
    assert len(scene.doorways) == 22
    assert all(0.5 <= width <= 0.9 for _, _, width in scene.doorways)
    for a, b in itertools.combinations(scene.rooms, 2):
        assert min(a[2], b[2]) <= max(a[0], b[0]) or min(a[3], b[3]) <= max(a[1], b[1])


def test_rooms_are_joined_by_their_doorways_only(scene):
    """With boxes in the doorways every room is alone; without, all are one."""
    shut = [Box((x, y, 1.0), (width, 0.1, 2.0)) for x, y, width in scene.doorways]
    parts = [p for t in scene.static_objects if t.name == "wall" for p in t.parts]
    closed, opened = (clearance_map(scene.extent, parts + more) for more in (shut, []))
    middles = [((a + c) / 2, (b + d) / 2) for a, b, c, d in scene.rooms]
    for middle in middles:
        alone, joined = (one.reachable(middle, 0.05) for one in (closed, opened))
        assert sum(bool(alone[closed.cell(other)]) for other in middles) == 1
        assert all(joined[opened.cell(other)] for other in middles)


def test_the_tour_passes_every_room_and_can_be_walked(scene):
    free = space(scene)
    reach = free.reachable((scene.start.x, scene.start.y), WALKER_RADIUS_M)
    assert all(reach[free.cell(goal)] for goal in scene.goals)
    tour = scene.goals[: len(scene.goals) // TOURS]
    assert scene.goals == TOURS * tour
    assert {room_of(scene, goal) for goal in tour} == set(range(22))
    assert math.dist(tour[0], tour[-1]) < 3.5
    legs = zip((*tour[1:], tour[0]), tour, strict=True)
    assert 80.0 < sum(math.dist(a, b) for a, b in legs) < 150.0


def test_successive_goals_are_in_the_same_room_or_in_neighbours(scene):
    pairs = {frozenset((room_of(scene, a), room_of(scene, b))) for a, b in
             itertools.pairwise(scene.goals)}  # fmt: skip
    for pair in pairs - {frozenset((k,)) for k in range(22)}:
        a, b = (scene.rooms[k] for k in pair)
        between = [
            (x, y)
            for x, y, _ in scene.doorways
            if all(r[0] <= x <= r[2] and r[1] - 0.1 <= y <= r[3] + 0.1 for r in (a, b))
        ]
        assert len(between) >= 1


def test_people_keep_off_furniture_and_leave_the_tour_open(scene):
    free = space(scene)
    assert 2 <= len(scene.moving_objects) <= 8
    start = (scene.start.x, scene.start.y)
    for one in scene.moving_objects:
        line = np.array([one.state(float(s))[:2] for s in np.linspace(0, one.reversal_s, 40)])
        low = [p for _, p in scene.static_shapes if p.bottom_m < one.height_m]
        assert min(distance(part, line).min() for part in low) > one.radius_m
        reach = free.with_disc(tuple(line[20]), one.radius_m).reachable(start, WALKER_RADIUS_M)
        assert all(reach[free.cell(goal)] for goal in scene.goals)


def test_every_room_has_tags_and_no_number_occurs_twice(scene):
    numbers = [mark.identity for mark in scene.landmarks]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) <= 250
    rooms = [room_of(scene, mark.position[:2]) for mark in scene.landmarks]
    assert min(rooms.count(k) for k in range(22)) >= 8


def test_tags_beyond_the_fiftieth_are_read_and_the_first_fifty_are_printed_as_ever():
    small = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for identity in (0, 17, 49):
        printed = _tag(identity)[24:-24, 24:-24, 0]
        np.testing.assert_array_equal(
            printed > 128, cv2.aruco.generateImageMarker(small, identity, 144) > 128
        )
    for identity in (50, 180, 249):
        sheet = np.full((400, 400, 3), 230, np.uint8)
        tag = cv2.resize(_tag(identity), (200, 200), interpolation=cv2.INTER_AREA)
        sheet[100:300, 100:300] = tag
        assert [found for found, _ in landmarks.find_corners(sheet, many=True)] == [identity]
        assert landmarks.find_corners(sheet) == []
