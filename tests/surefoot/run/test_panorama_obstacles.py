"""The decision of seed 004 from range pictures of its arenas, against where the cartons stand."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from mapping.panorama.obstacles import Surroundings
from mapping.panorama.segments import observed_sector, outline_segments
from mapping.panorama.sizes import surroundings
from mapping.panorama.stitching import Panorama, stitch
from perception.primitives.robot_model import DARWIN_OP
from planning.avoidance.choice import AvoidanceConfig, choose
from planning.planners.panorama_obstacles import obstacle_table
from sim.scene import Scene
from sim.scenes import catalogue
from sim.scenes.avoidance_scenes import MOTIONS
from sim.shapes import Box
from surefoot.experiments.seed_004.panorama_scenes import nine_views


@functools.cache
def _look(motion: str, seed: int) -> tuple[Scene, Panorama, Surroundings]:
    scene = catalogue.load(f"avoidance_{motion.lower()}", seed)
    rng = np.random.default_rng([seed, 17])
    views, _ = nine_views(scene, rng)
    panorama = stitch(views, rng)
    return scene, panorama, surroundings(panorama, views)


def _span(scene: Scene, name: str) -> tuple[float, float]:
    box = next(thing.parts[0] for thing in scene.static_objects if thing.name == name)
    assert isinstance(box, Box)
    return box.centre[1] + box.size[1] / 2, box.centre[1] - box.size[1] / 2


@pytest.mark.parametrize("motion", MOTIONS)
def test_each_arena_asks_for_its_motion(motion):
    _, panorama, around = _look(motion, 3)
    choice = choose(obstacle_table(panorama, around), AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    assert choice.motion == motion


@pytest.mark.parametrize("motion", ["SS", "RF", "TS"])  # in RF much hangs together with a wall
def test_the_gap_is_that_between_the_cartons(motion):
    scene, panorama, around = _look(motion, 3)
    choice = choose(obstacle_table(panorama, around), AvoidanceConfig(), DARWIN_OP)
    assert choice is not None
    carton, neighbour = _span(scene, "carton"), _span(scene, "neighbour")
    gap = neighbour[1] - carton[0] if choice.side > 0 else carton[1] - neighbour[0]
    assert choice.gap_m == pytest.approx(gap, abs=0.025)


def test_walls_that_hang_together_are_cut_where_the_outline_leaps_and_bound_the_ground():
    _, panorama, around = _look("SF", 3)
    found = outline_segments(panorama, [o for o in around.obstacles if not o.cut_top], 1.5)
    walls = [one for one in found if one.width_m < 0.1]
    assert any(one.right_edge_m[1] == pytest.approx(1.25, abs=0.03) for one in walls)
    assert any(one.left_edge_m[1] == pytest.approx(-1.25, abs=0.03) for one in walls)
    assert all(one.distance_m <= 1.5 for one in found)


def test_what_stands_beyond_the_reach_is_left_out():
    _, panorama, around = _look("SF", 3)
    things = obstacle_table(panorama, around, 1.0)
    assert np.all(things.distance_m <= 1.0)


def test_cells_that_closed_a_passage_block_it():
    _, panorama, around = _look("SF", 3)
    before = choose(obstacle_table(panorama, around), AvoidanceConfig(), DARWIN_OP)
    assert before is not None
    at = before.pivot.y_m
    closer = np.array([[1.4, at + 0.1], [1.4, at - 0.1]])
    after = choose(obstacle_table(panorama, around, closers=[closer]), AvoidanceConfig(), DARWIN_OP)
    assert after is not None
    assert (after.motion, after.side) != (before.motion, before.side)


def test_ground_is_known_as_far_aside_as_the_head_turned():
    _, panorama, _ = _look("SF", 3)
    left, right = observed_sector(panorama)
    assert np.degrees(left) == pytest.approx(82.0, abs=3.0)
    assert np.degrees(right) == pytest.approx(-82.0, abs=3.0)
