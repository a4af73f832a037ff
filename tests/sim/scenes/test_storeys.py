"""Two storeys: what a G1 can climb, room on both floors, and a goal upstairs that is not straight ahead."""

import numpy as np
import pytest

from sim.free_space import clearance_map
from sim.ground import Ground
from sim.robots import catalogue as robots
from sim.scenes import catalogue

SEEDS = range(6)


@pytest.fixture(scope="module")
def scenes():
    return [catalogue.load("storeys", seed) for seed in SEEDS]


def flight(scene):
    return next(item for item in scene.static_objects if item.name == "flight").parts


def test_a_g1_can_climb_the_flight(scenes):
    g1 = robots.load("g1").model
    for scene in scenes:
        treads = flight(scene)
        tops = [0.0, *(part.top_m for part in treads), max(p.top_m for p in scene.ground)]
        assert 6 <= len(tops) <= 9
        assert np.diff(tops).max() <= min(g1.steps.up_m, g1.steps.down_m)
        assert np.diff(tops) == pytest.approx(np.diff(tops)[0])
        assert all(part.size[0] > g1.foot_m[0] + 0.09 for part in treads)


def test_the_goal_is_upstairs_and_not_straight_ahead(scenes):
    for scene in scenes:
        ground = Ground(scene.ground, (0.2, 0.07))
        start, goal = np.array([scene.start.x, scene.start.y]), np.array(scene.goals[0])
        assert float(ground.height(start)) == 0.0
        assert float(ground.height(goal)) == pytest.approx(max(p.top_m for p in scene.ground))
        line = start + np.linspace(0.0, 1.0, 200)[:, None] * (goal - start)
        shapes = [p for item in scene.static_objects if not item.ground for p in item.parts]
        inside = clearance_map(scene.extent, shapes, 0.05, np.inf)
        assert min(inside.at((x, y)) for x, y in line) < 0.2  # something is in the way


def test_the_flight_is_the_only_way_up_and_wide_enough(scenes):
    for scene in scenes:
        _, y0, _, y1 = scene.extent
        first = min(part.centre[0] - part.size[0] / 2 for part in flight(scene))
        solid = [p for item in scene.static_objects if not item.ground for p in item.parts]
        across = np.column_stack([np.full(400, first + 0.05), np.linspace(y0, y1, 400)])
        space = clearance_map((first, y0, first + 0.1, y1), solid, 0.02, np.inf)
        free = [bool(space.at((x, y)) >= 0.0) for x, y in across]
        assert 1.4 < np.mean(free) * (y1 - y0) < 1.9
        assert np.count_nonzero(np.diff(np.array(free, int)) == 1) <= 1
