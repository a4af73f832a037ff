"""The obstacle cloud: a passer-by leaves no footprint, and none lies over a free cell of the map."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid.world_map import WorldMap
from mapping.io.clouds import CloudConfig
from mapping.objects.footprints import FootprintConfig
from mapping.objects.free_cells import FreeCells, area
from mapping.objects.obstacle_cloud import ObstacleCloud
from perception.primitives.gaussian import Gaussian

POSE = Gaussian(np.array([0.5, -1.5, 1.57]), np.diag([0.01**2, 0.01**2, 0.01**2]))
CAMERA = np.array([0.5, -1.5, 0.5])


def face(rng: np.random.Generator, x0: float, x1: float) -> np.ndarray:
    """Points on an upright face at y = 0.5, as an obstacle shows them."""
    count = int(2000 * (x1 - x0))
    points = np.column_stack(
        [rng.uniform(x0, x1, count), np.full(count, 0.51), rng.uniform(0.05, 0.4, count)]
    )
    return points + rng.normal(0, 0.003, points.shape)


def walk(
    frames: list[tuple[float, float] | None], sigma_m: float = 0.005, pose: Gaussian = POSE
) -> tuple[ObstacleCloud, WorldMap]:
    """Frames of floor in front of a wall from x = 2 to 3, with something else at the given place in some of them."""
    rng = np.random.default_rng(0)
    cloud, world = ObstacleCloud(CloudConfig()), WorldMap()
    x, y = np.meshgrid(np.arange(-0.5, 3.5, 0.02), np.arange(0.0, 0.49, 0.02))
    ground = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    behind = ground + np.array([0.0, 0.5, 0.0])
    for number, place in enumerate(frames):
        floor, things = [ground, behind[behind[:, 0] < 1.9]], [face(rng, 2.0, 3.0)]
        if place is not None:
            hidden = (floor[1][:, 0] > place[0]) & (floor[1][:, 0] < place[1])
            floor[1] = floor[1][~hidden]
            things.append(face(rng, *place))
        points = np.concatenate([*floor, *things])
        is_obstacle = np.arange(len(points)) >= sum(len(part) for part in floor)
        sigma = np.full(np.count_nonzero(is_obstacle), sigma_m)
        cloud.add(points[is_obstacle], sigma, CAMERA, pose, None)
        world.update(points, is_obstacle, 0.1 * number, CAMERA)
    return cloud, world


def test_a_thing_that_came_at_the_end_has_no_footprint_and_the_wall_has():
    cloud, world = walk([None] * 24 + [(0.2, 0.6)] * 8)
    row, column = world.cell_of(np.array([0.4, 0.51]))
    assert world.probability[row, column] > 0.5  # the map shows it
    (wall,) = cloud.footprints(world, FootprintConfig())
    assert wall.outline[:, 0].min() > 1.9


def test_a_thing_that_was_always_there_has_one():
    cloud, world = walk([(0.2, 0.6)] * 16)
    found = cloud.footprints(world, FootprintConfig())
    assert len(found) == 2
    thing = min(found, key=lambda one: float(one.outline[:, 0].min()))
    assert np.ptp(thing.outline[:, 0]) == pytest.approx(0.4, abs=0.05)
    assert thing.probability > 0.9


@pytest.mark.parametrize("together", [0.0, 0.8, -0.8])  # correlation of x and heading
def test_the_deviation_of_a_side_holds_the_doubt_of_the_pose(together):
    """The error of the heading moves a face 2 m ahead, of mean offset x and y, across: by y dyaw."""
    covariance = POSE.covariance.copy()
    covariance[0, 2] = covariance[2, 0] = together * 0.01**2
    variances = []
    for P in (np.zeros((3, 3)), covariance):
        cloud, world = walk([(0.2, 0.6)] * 16, pose=Gaussian(POSE.mean, P))
        found = cloud.footprints(world, FootprintConfig())
        assert len(found) == 2
        thing = min(found, key=lambda one: float(one.outline[:, 0].min()))
        step = np.roll(thing.outline, -1, axis=0) - thing.outline
        front = int(np.argmax(np.where(thing.seen, np.linalg.norm(step, axis=1), 0.0)))
        variances.append(thing.sigma_m[front] ** 2)
    x, y = np.random.default_rng(1).uniform(0.2, 0.6, 1000) - 0.5, 2.01
    dx, dy, turn = np.random.default_rng(2).multivariate_normal(np.zeros(3), covariance, 1000).T
    true = 0.5 * np.mean((dx - y * turn) ** 2 + (dy + x * turn) ** 2)  # of one axis
    assert variances[1] - variances[0] == pytest.approx(true, rel=0.1)


def test_the_height_has_the_deviation_of_the_points():
    sure, vague = (
        min(one.sigma_height_m for one in cloud.footprints(world, FootprintConfig()))
        for cloud, world in (walk([(0.2, 0.6)] * 16, sigma_m) for sigma_m in (0.005, 0.03))
    )
    assert vague**2 - sure**2 == pytest.approx(0.03**2 - 0.005**2, rel=1e-6)


def test_no_footprint_lies_over_a_cell_that_the_saved_map_shows_free():
    cloud, world = walk([(0.2, 0.6)] * 16)
    free = FreeCells(world.known & (world.probability < 0.196), world.origin, world.cell_m)
    found = cloud.footprints(world, FootprintConfig())
    assert len(found) == 2
    for one in found:
        assert sum(abs(area(part)) for part in free.overlaps(one.outline)) == 0.0


def test_an_empty_cloud_has_no_footprints():
    assert ObstacleCloud(CloudConfig()).footprints(WorldMap(), FootprintConfig()) == []


def test_where_the_body_has_walked_lies_no_footprint():
    cloud, world = walk([(0.2, 0.6)] * 16)
    before = cloud.footprints(world, FootprintConfig())
    thing = min(before, key=lambda one: float(one.outline[:, 0].min()))
    place = thing.outline.mean(axis=0)
    cloud.stand(place)
    after = cloud.footprints(world, FootprintConfig())
    assert inside(thing.outline, place)
    assert not any(inside(one.outline, place) for one in after)


def inside(outline: np.ndarray, place: np.ndarray) -> bool:
    """Whether a ring runs round a place, by its winding."""
    x, y = (outline - place).T
    turns = np.diff(np.unwrap(np.arctan2(np.append(y, y[0]), np.append(x, x[0]))))
    return abs(float(turns.sum())) > 3.0
