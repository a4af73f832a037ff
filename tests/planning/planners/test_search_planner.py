"""The default planner on maps of which a part was never seen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapping.grid.egocentric_grid import EgocentricGrid, GridConfig
from mapping.grid.world_map import WorldMap
from perception.estimate import Estimate
from perception.primitives.gaussian import Gaussian
from planning.planners.search_planner import SearchPlanner, _as_ground
from planning.planners.settings import PlanningConfig
from planning.world_model import WorldModel

FREE, OCCUPIED, UNSEEN = -3.0, 3.0, np.inf  # log odds


def grid_of(log_odds):
    """A grid round the origin with this content."""
    empty = EgocentricGrid(GridConfig(), np.zeros(2))
    content = empty.snapshot()
    content["log_odds"] = log_odds(*np.moveaxis(empty.centres(), -1, 0)).astype(np.float32)
    return EgocentricGrid.restored(GridConfig(), content)


def test_unseen_ground_at_the_feet_of_the_walls_is_no_obstacle_in_a_corridor_twice_as_wide_as_the_robot():
    """Faces 0.3 m to both sides; of the ground nearer than 0.45 m only the middle is seen."""

    def corridor(x, y):
        aside = np.abs(y)
        inside = np.where((np.hypot(x, y) < 0.45) & (aside > 0.16), UNSEEN, FREE)
        return np.where(aside > 0.325, UNSEEN, np.where(aside > 0.275, OCCUPIED, inside))

    config = PlanningConfig()
    config = replace(config, gaze=replace(config.gaze, mode="fixed"))
    planner = SearchPlanner(config, [(1.5, 0.02)])
    pose = Gaussian(np.array([0.0, 0.02, 0.0]), np.eye(3) * 1e-6)
    decision = planner.decide(WorldModel(Estimate(1.0, pose), grid_of(corridor)))
    assert decision.why == "walk"
    assert decision.walk.forward_m > 0.04


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_no_step_may_touch_unseen_cells_behind_a_face_and_those_before_it_any_may(slope, turns):
    """A face through (0.7, 0); the ground before it is seen but for a blind spot that reaches the face."""

    def wall(x, y):
        for _ in range(turns):
            x, y = y, -x
        depth = x + slope * y - 0.7
        blind = np.hypot(x - 0.6, y) < 0.15
        before = np.where(blind, UNSEEN, FREE)
        return np.where(depth > 0.05, UNSEEN, np.where(depth > 0.0, OCCUPIED, before)), blind, depth

    grid = grid_of(lambda x, y: wall(x, y)[0])
    _, blind, depth = wall(*np.moveaxis(grid.centres(), -1, 0))
    solid = _as_ground(grid)[2]
    middle = np.hypot(*np.moveaxis(grid.centres(), -1, 0)) < 1.0
    behind = depth / np.hypot(1.0, slope)  # m
    assert not solid[blind & (depth <= 0.0)].any()
    assert solid[middle & ~_near(blind) & (depth > 0.05) & (behind < 0.10)].all()
    assert not solid[behind > 0.25].any()


def test_what_the_grid_has_forgotten_stands_there_until_it_is_seen_to_be_gone():
    """A bin of 0.2 m at (1.0, 0), looked at and then unseen for so long that the grid has forgotten it."""

    def bin_there(xy):
        return (np.abs(xy - [1.0, 0.0]) < 0.1).all(axis=-1)

    world = WorldMap()
    y, x = np.meshgrid(np.arange(-0.475, 0.5, 0.05), np.arange(0.525, 1.5, 0.05))
    xy = np.column_stack([x.ravel(), y.ravel()])
    points = np.repeat(np.column_stack([xy, np.where(bin_there(xy), 0.3, 0.0)]), 4, axis=0)
    for k in range(8):
        world.update(points, points[:, 2] > 0.0, float(k), np.array([0.0, 0.0, 0.4]))
    forgotten = grid_of(lambda x, y: np.full(x.shape, UNSEEN))
    solid = _as_ground(forgotten, world)[2]
    there = bin_there(forgotten.centres())
    assert solid[there].all()
    assert not solid[~_near(there)].any()
    assert not _as_ground(forgotten)[2].any()
    seen_to_be_gone = grid_of(lambda x, y: np.full(x.shape, FREE))
    assert not _as_ground(seen_to_be_gone, world)[2].any()


@pytest.mark.parametrize("seed", range(4))
def test_before_a_goal_beside_the_robot_its_circle_is_small_wherever_it_stands(seed):
    """A goal 0.2 m away at 60 deg: half as wide as it is far is a step of 0.1 m times the turn (`footsteps.footstep`)."""
    config = PlanningConfig()
    field = replace(config.univector, velocity_change=False)
    config = replace(config, gaze=replace(config.gaze, mode="fixed"), univector=field)
    x, y, yaw = np.random.default_rng(seed).uniform(-0.4, 0.4, 3)
    way = yaw + math.radians(60.0)
    goal = (x + 0.2 * math.cos(way), y + 0.2 * math.sin(way))
    pose = Gaussian(np.array([x, y, yaw]), np.eye(3) * 1e-6)
    grid = grid_of(lambda x, y: np.full(x.shape, FREE))
    walk = SearchPlanner(config, [goal]).decide(WorldModel(Estimate(1.0, pose), grid)).walk
    assert walk.turn_rad == pytest.approx(math.radians(14.0))
    assert walk.forward_m == pytest.approx(0.1 * math.radians(14.0))


def _near(cells):
    """These cells, and those within 0.3 m along both axes."""
    return np.any(
        [np.roll(cells, (row, column), (0, 1)) for row in range(-6, 7) for column in range(-6, 7)],
        axis=0,
    )
