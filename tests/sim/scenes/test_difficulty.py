"""Difficulty: harder scenes have more objects and narrower passages, all are passable, and 0.5 is the usual scene."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from perception.primitives.errors import InputError
from sim.free_space import clearance_map
from sim.scenes import catalogue
from sim.scenes.difficulty import interpolated, interpolated_count, interpolated_span

SEEDS = range(3)
GRADED = ("home", "flat", "corridor", "office", "hall", "course", "fast_course", "hard_course")
SAME = ("empty_room", "boxes", "plain_room", "robots_room", "narrow_course", "avoidance_ss")
PLANNED_M = 0.15  # radius of the planning disc


load = functools.cache(catalogue.load)


@functools.cache
def space(name, seed, difficulty):
    scene = load(name, seed, difficulty)
    inside = [p for t in scene.static_objects for p in t.parts if not t.name.startswith("tag")]
    return clearance_map(scene.extent, inside)


def reaches(free, scene, radius_m):
    """Whether a disc of that radius fits at the start and reaches every goal."""
    reach = free.reachable((scene.start.x, scene.start.y), radius_m)
    return all(reach[free.cell(goal)] for goal in scene.goals)


def room(name, seed, difficulty):
    """Mean clearance over the cells that the planning disc can reach, m."""
    scene, free = load(name, seed, difficulty), space(name, seed, difficulty)
    reach = free.reachable((scene.start.x, scene.start.y), PLANNED_M)
    return float(free.clearance[reach].mean())


@pytest.mark.parametrize("difficulty", [-0.01, 1.01, float("nan")])
def test_an_invalid_difficulty_is_refused(difficulty):
    with pytest.raises(InputError, match=r"difficulty=.* must lie in \[0, 1\]"):
        catalogue.load("home", 0, difficulty)


def test_parameters_are_interpolated_linearly_between_three_values():
    assert [interpolated(d, 0.9, 0.7, 0.1) for d in (0.0, 0.5, 1.0)] == [0.9, 0.7, 0.1]
    assert interpolated(0.25, 1.0, 2.0, 6.0) == pytest.approx(1.5)
    assert interpolated(0.75, 1.0, 2.0, 6.0) == pytest.approx(4.0)
    assert interpolated_count(0.9, 1, 3, 5) == 5
    assert interpolated_span(0.75, (0.0, 1.0), (2.0, 3.0), (4.0, 7.0)) == pytest.approx((3.0, 5.0))


@pytest.mark.parametrize("name", catalogue.names())
def test_difficulty_one_half_is_the_usual_scene(name):
    assert catalogue.load(name, 3, 0.5) == catalogue.load(name, 3)


@pytest.mark.parametrize("name", SAME)
def test_scenes_of_papers_and_for_measurements_ignore_the_difficulty(name):
    assert catalogue.load(name, 2, 0.0) == catalogue.load(name, 2) == catalogue.load(name, 2, 1.0)


@pytest.mark.parametrize("name", GRADED)
def test_a_harder_scene_has_more_and_faster_objects_and_narrower_passages(name):
    easy, usual, hard = (
        [load(name, seed, difficulty) for seed in SEEDS] for difficulty in (0.0, 0.5, 1.0)
    )
    assert items(easy) <= items(usual) <= items(hard)
    rooms = [np.mean([room(name, seed, d) for seed in SEEDS]) for d in (0.0, 0.5, 1.0)]
    assert rooms[0] > rooms[1] > rooms[2]
    assert items(easy) < items(hard)
    speeds = [
        [m.speed_mps for scene in group for m in scene.moving_objects] for group in (easy, hard)
    ]
    assert name == "office" or np.mean(speeds[0]) < np.mean(speeds[1])


def items(group):
    return sum(len(scene.obstacles) + len(scene.moving_objects) for scene in group)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("difficulty", [0.0, 1.0])
@pytest.mark.parametrize("name", GRADED)
def test_start_and_goals_are_free_and_reachable_at_any_difficulty(name, difficulty, seed):
    scene, free = load(name, seed, difficulty), space(name, seed, difficulty)
    assert reaches(free, scene, PLANNED_M)
    for moving_object in scene.moving_objects:
        line = [
            moving_object.state(float(s))[:2]
            for s in np.linspace(0.0, moving_object.reversal_s, 25)
        ]
        assert min(free.at(place) for place in line) > moving_object.radius_m
