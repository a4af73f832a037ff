"""The flat: four rooms with passable doorways, a goal in every other room, and people in the doorways."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from sim.free_space import clearance_map
from sim.scenes import catalogue
from sim.scenes.flat import WALKER_RADIUS_M
from sim.shapes import Box, distance, outline

CASES = [(seed, difficulty) for seed in range(2) for difficulty in (0.0, 0.5, 1.0)]


@cache
def made(seed, difficulty):
    return catalogue.load("flat", seed, difficulty)


@pytest.fixture(params=CASES, ids=lambda case: f"seed{case[0]}-difficulty{case[1]}")
def scene(request):
    return made(*request.param)


def lintels(scene):
    """Parts of walls above the doorways."""
    walls = [t.parts[0] for t in scene.static_objects if t.name == "wall"]
    return [wall for wall in walls if wall.bottom_m > 1.9]


def leaves(scene):
    return [t.parts[0] for t in scene.static_objects if t.name == "door"]


def solids(scene):
    return [p for t in scene.static_objects if not t.name.startswith("tag") for p in t.parts]


def test_four_doorways_have_realistic_widths_and_are_narrower_when_harder(scene):
    assert sorted(len(group) for group in (lintels(scene), leaves(scene))) == [4, 4]
    assert all(0.5 <= max(lintel.size[:2]) <= 0.9 for lintel in lintels(scene))
    widths = [np.mean([max(p.size[:2]) for p in lintels(made(0, d))]) for d in (0.0, 0.5, 1.0)]
    assert widths[0] > widths[1] > widths[2]


def test_every_door_leaf_hangs_at_a_jamb_open_and_clear_of_walls(scene):
    x0, y0, x1, y1 = scene.extent
    standing = [
        t.parts[0] for t in scene.static_objects if t.name == "wall" and t.parts[0].bottom_m == 0.0
    ]
    for leaf in leaves(scene):
        corners = outline(leaf)
        assert (corners > [x0, y0]).all()
        assert (corners < [x1, y1]).all()
        ends = [(corners[0] + corners[3]) / 2, (corners[1] + corners[2]) / 2]
        to_wall = [min(distance(wall, end[None])[0] for wall in standing) for end in ends]
        assert min(to_wall) < 0.01
        assert max(to_wall) > 0.03
        doorway = min(lintels(scene), key=lambda p: math.dist(p.centre[:2], leaf.centre[:2]))
        closed = 0.0 if doorway.size[0] > doorway.size[1] else math.pi / 2
        turned = abs((leaf.yaw_rad - closed + math.pi / 2) % math.pi - math.pi / 2)
        assert turned > math.radians(45)


def test_start_and_goals_are_in_four_rooms(scene):
    shut = [Box((*p.centre[:2], 1.0), (*p.size[:2], 2.0)) for p in lintels(scene)]
    free = clearance_map(scene.extent, solids(scene) + shut, 0.025)
    places = [(scene.start.x, scene.start.y), *scene.goals]
    for place in places:
        reach = free.reachable(place, 0.03)
        assert [bool(reach[free.cell(other)]) for other in places].count(True) == 1


def test_every_goal_is_reachable_for_every_position_of_a_person(scene):
    free = clearance_map(scene.extent, solids(scene))
    start = (scene.start.x, scene.start.y)
    for person in scene.moving_objects:
        for s in np.linspace(0.0, person.reversal_s, 9):
            reach = free.with_disc(person.state(float(s))[:2], person.radius_m).reachable(
                start, WALKER_RADIUS_M
            )
            assert all(reach[free.cell(goal)] for goal in scene.goals)


def test_people_walk_through_doorways_without_contact(scene):
    for person in scene.moving_objects:
        line = np.array([person.state(float(s))[:2] for s in np.linspace(0, person.reversal_s, 60)])
        assert min(distance(lintel, line).min() for lintel in lintels(scene)) < 0.0
        low = [part for part in solids(scene) if part.bottom_m < person.height_m]
        assert min(distance(part, line).min() for part in low) > person.radius_m


def test_every_room_has_tags_and_there_are_at_least_thirty_landmarks(scene):
    assert len(scene.landmarks) >= 30
    middle_x = np.mean([p.centre[0] for p in lintels(scene)])
    middle_y = np.mean([p.centre[1] for p in lintels(scene)])
    quarters = [(m.position[0] > middle_x, m.position[1] > middle_y) for m in scene.landmarks]
    assert min(quarters.count((a, b)) for a in (False, True) for b in (False, True)) >= 5
