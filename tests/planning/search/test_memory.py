"""Memory: walls beyond the local map count, as they stand in the world."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid.evidence import OCCUPIED
from mapping.grid.world_map import WorldMap
from perception.primitives.pose import Pose2
from planning.search.memory import with_memory
from planning.search.potential import SearchConfig
from planning.search.route import Route

CELL_M = 0.05
SIDE = 71
STEP_S = 0.65
HALF_M = SIDE * CELL_M / 2
CAMERA = np.array([0.0, 0.0, 0.4])
TRAP = ((2.0, 2.1, -2.25, 2.25), (-0.2, 2.1, 2.15, 2.25), (-0.2, 2.1, -2.25, -2.15))
"""Walls (x from, to, y from, to) of a U open to the left, m."""
GOAL = np.array([3.5, 0.0])


def stands(xy: np.ndarray) -> np.ndarray:
    """Whether a point is in the trap."""
    x, y = xy.T
    return np.any([(x >= a) & (x < b) & (y >= c) & (y < d) for a, b, c, d in TRAP], axis=0)


def furnished(xy: np.ndarray) -> np.ndarray:
    """The same trap of pieces of 0.7 m, as chairs and desks, too close to each other to walk between them."""
    along = np.where(np.abs(xy[:, 1]) < 2.1, xy[:, 1] + 2.2, xy[:, 0])
    return np.asarray(stands(xy) & (along % 0.8 < 0.7))


def middles(origin: np.ndarray) -> np.ndarray:
    """(n, 2) middles of the cells of a local map, row by row."""
    y, x = np.indices((SIDE, SIDE)).reshape(2, -1)
    return origin + (np.column_stack([x, y]) + 0.5) * CELL_M


def see(world: WorldMap, xy: np.ndarray, solid: np.ndarray, stamp_s: float = 0.0) -> None:
    """Look at these points, several rays each."""
    points = np.repeat(np.column_stack([xy, np.where(solid, 0.3, 0.0)]), 4, axis=0)
    world.update(points, points[:, 2] > 0.0, stamp_s, CAMERA)


def whole() -> WorldMap:
    """The trap and its surroundings, well known."""
    world = WorldMap()
    y, x = np.meshgrid(np.arange(-3.975, 4.0, CELL_M), np.arange(-1.975, 5.0, CELL_M))
    xy = np.column_stack([x.ravel(), y.ravel()])
    for k in range(8):
        see(world, xy, stands(xy), float(k))
    return world


def local(x: float, y: float, seen: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The local map round a place: the truth, or nothing seen."""
    origin = np.round(np.array([x, y]) / CELL_M) * CELL_M - HALF_M
    probability = np.where(stands(middles(origin)), 0.97, 0.02).reshape(SIDE, SIDE)
    return probability, np.full((SIDE, SIDE), not seen), origin


@pytest.mark.parametrize("solid", [stands, furnished])
def test_a_robot_leaves_a_trap_larger_than_its_local_map(solid):
    """The robot sees what is within its local map, which forgets what leaves it."""
    world, route, robot = WorldMap(), Route(SearchConfig()), Pose2(0.0, 0.0, 0.0)
    for k in range(200):
        origin = np.round(np.array([robot.x, robot.y]) / CELL_M) * CELL_M - HALF_M
        there = solid(middles(origin))
        probability = np.where(there, 0.97, 0.02).reshape(SIDE, SIDE)
        unknown = np.zeros((SIDE, SIDE), np.bool_)
        see(world, middles(origin), there, STEP_S * k)
        via = route.update(probability, unknown, origin, CELL_M, robot, GOAL, world)
        way = via - [robot.x, robot.y]
        step = way * min(1.0, 0.1 / max(float(np.hypot(*way)), 1e-9))
        robot = Pose2(robot.x + step[0], robot.y + step[1], math.atan2(*way[::-1]))
        assert not stands(np.array([[robot.x, robot.y]]))[0]
        if math.dist((robot.x, robot.y), GOAL.tolist()) < 0.1:
            break
    else:
        pytest.fail("never arrived")


@pytest.mark.parametrize("seen", [True, False])
def test_the_ground_is_as_it_stands_in_the_world_wherever_the_local_map_ends(seen):
    world = whole()
    probability, unknown, origin = with_memory(local(0.63, 0.41, seen), CELL_M, world)
    rows, columns = np.nonzero(~unknown & (probability >= OCCUPIED))
    found = origin + (np.column_stack([columns, rows]) + 0.5) * CELL_M
    y, x = np.meshgrid(np.arange(-3.0, 3.0, CELL_M), np.arange(-1.0, 3.0, CELL_M))
    truth = np.column_stack([x.ravel(), y.ravel()])
    truth = truth[stands(truth)]
    gaps = np.linalg.norm(found[:, None] - truth, axis=2)
    assert gaps.min(axis=0).max() < 1.5 * CELL_M  # every part of the walls is there
    assert gaps.min(axis=1).max() < 1.5 * CELL_M  # and nothing else


def test_what_the_local_map_has_seen_counts_more_than_memory():
    free, unknown, origin = local(2.0, 0.0, True)
    probability, _, corner = with_memory(
        (np.full_like(free, 0.02), unknown, origin), CELL_M, whole()
    )
    column, row = np.round((origin - corner) / CELL_M).astype(int)
    assert (probability[row : row + SIDE, column : column + SIDE] == 0.02).all()


def test_what_moved_is_not_remembered():
    world = whole()
    before = with_memory(local(-1.0, 0.0, True), CELL_M, world)[0].shape
    world.mark_moving(np.array([[2.0, 0.0]]), np.array([4.0]))
    probability, unknown, _ = with_memory(local(-1.0, 0.0, True), CELL_M, world)
    assert probability.shape == (SIDE, SIDE) < before
    assert not unknown.any()


def occupied(world: WorldMap) -> np.ndarray:
    """(n, 2) occupied cells round the origin, of which the local map has seen nothing, m."""
    nothing = np.ones((SIDE, SIDE)), np.ones((SIDE, SIDE), bool), np.full(2, -HALF_M)
    probability, unknown, origin = with_memory(nothing, CELL_M, world)
    rows, columns = np.nonzero(~unknown & (probability >= OCCUPIED))
    return origin + (np.column_stack([columns, rows]) + 0.5) * CELL_M


@pytest.mark.parametrize(
    ("length_m", "unseen_s", "remembered"),
    [
        (0.5, 0.0, True),
        (0.8, 50.0, True),
        (0.5, 70.0, False),
        (0.8, 70.0, False),
        (1.2, 70.0, True),
    ],
)
def test_what_is_small_enough_to_go_away_is_remembered_for_a_minute(length_m, unseen_s, remembered):
    """A row of something 2.5 m from a wall that stays."""
    world = WorldMap()
    wall = np.column_stack([np.full(121, 3.0), np.linspace(-1.5, 1.5, 121)])
    row = np.column_stack([np.full(81, 0.5), np.linspace(-length_m / 2, length_m / 2, 81)])
    xy = np.repeat(np.vstack([wall, row]), 4, axis=0)
    points = np.column_stack([xy, np.full(len(xy), 0.3)])
    for k in range(8):
        world.update(points, np.ones(len(points), bool), float(k), CAMERA)
    elsewhere = np.repeat([[5.0, 0.0, 0.0]], 4, axis=0)
    world.update(elsewhere, np.zeros(4, bool), 7.0 + unseen_s, CAMERA)
    found = occupied(world)
    assert np.any(found[:, 0] > 2.5)
    assert np.any(found[:, 0] < 1.0) == remembered


def test_where_memory_leaves_no_path_the_robot_goes_to_look_again():
    """Four remembered walls round the start, beyond what it sees now; one may have gone."""
    world = WorldMap()
    ring = [[(s, t), (t, s)] for s in (-2.5, 2.5) for t in np.arange(-2.5, 2.55, CELL_M / 2)]
    xy = np.reshape(ring, (-1, 2))
    points = np.repeat(np.column_stack([xy, np.full(len(xy), 0.3)]), 4, axis=0)
    for k in range(8):
        world.update(points, np.ones(len(points), bool), float(k), CAMERA)
    origin = np.full(2, -HALF_M)
    free, known = np.full((SIDE, SIDE), 0.02), np.zeros((SIDE, SIDE), bool)
    route = Route(SearchConfig())
    route.update(free, known, origin, CELL_M, Pose2(), np.array([4.0, 0.0]), world)
    assert route.path is not None
    np.testing.assert_allclose(route.path.waypoints[-1], [4.0, 0.0], atol=CELL_M)
