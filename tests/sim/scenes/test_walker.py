"""Scenes for a robot: a home as many times wider as the robot is broader, with furniture as it is."""

import math

import numpy as np
import pytest

from perception.primitives.errors import ConfigError
from sim.free_space import clearance_map
from sim.scenes import catalogue
from sim.scenes.walker import SMALL, Walker

BROAD = Walker(2.0, 1.3)


@pytest.fixture(scope="module")
def homes():
    return [catalogue.load("home", seed, walker=BROAD) for seed in range(3)]


def test_a_broad_robot_can_cross_its_home_below_all_that_is_lower_than_itself(homes):
    for scene in homes:
        parts = [p for t in scene.static_objects for p in t.parts]
        space = clearance_map(scene.extent, parts, top_m=BROAD.top_m)
        reach = space.reachable((scene.start.x, scene.start.y), 2.0 * 0.28)
        assert all(reach[space.cell(goal)] for goal in scene.goals)
        assert math.dist((scene.start.x, scene.start.y), scene.goals[0]) >= 8.0


def test_rooms_grow_with_the_robot_and_furniture_does_not(homes):
    small = catalogue.load("home", 0)
    sizes = {
        (part.size[2], min(part.size[:2]))
        for scene in homes
        for item in scene.obstacles
        for part in item.parts
        if hasattr(part, "size")
    }
    for scene in homes:
        np.testing.assert_allclose(scene.extent, np.multiply(small.extent, 2.0))
        assert {item.name.split()[0] for item in scene.obstacles} & {"sofa", "table", "chair"}
    assert max(height for height, _ in sizes) < 2.4  # as a wall, not twice as high


def test_the_smallest_robot_has_the_home_of_the_seed():
    assert catalogue.load("home", 2, walker=SMALL) == catalogue.load("home", 2)
    assert catalogue.load("home", 2, walker=BROAD) != catalogue.load("home", 2)
    assert catalogue.load("boxes", 2, walker=BROAD) == catalogue.load("boxes", 2)


def test_an_impossible_breadth_is_refused():
    with pytest.raises(ConfigError, match="a robot 100 times as broad"):
        Walker(100.0)
