"""Voxels that depth images hit: a wall where it is, gone when it is seen through, vaguer with every motion."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.ground.obstacles import VAGUE_M, VOXEL_M, ObstacleMap
from perception.depth.points import from_depth
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose2, Pose3, head_rotation

CAMERA = Camera.from_view(120, 90, 1.2, 0.9)
MOUNTED = Pose3.from_rotation(head_rotation(0.0, 0.5), np.array([0.0, 0.0, 1.0]))
SWAY = np.diag([0.005, 0.005, 0.005, 0.01, 0.01, 0.01]) ** 2
STEP = np.diag([0.002, 0.001, 0.01, 0.002]) ** 2


def seen(wall_m: float, obstacles: ObstacleMap) -> None:
    """An image of level ground with a wall across, so far away."""
    rays = CAMERA.rays @ MOUNTED.rotation.T
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < 0.0, -1.0 / rays[..., 2], np.inf)
        wall = np.where(rays[..., 0] > 0.0, wall_m / rays[..., 0], np.inf)
    z = np.minimum(floor, wall)
    z = np.where(z < 4.0, z, np.nan).astype(np.float32)
    depth = Depth(
        z, np.where(np.isfinite(z), np.float32(0.005), np.float32(np.nan)), CAMERA, MOUNTED
    )
    obstacles.observe(from_depth(depth, 0.1, 4.0), depth, MOUNTED, SWAY)


def high(obstacles: ObstacleMap) -> np.ndarray:
    places = obstacles.voxels.places
    return places[places[:, 2] > 2 * VOXEL_M]


def test_a_wall_is_where_it_is_and_stays_there_while_the_robot_turns():
    obstacles = ObstacleMap()
    seen(1.52, obstacles)
    assert len(high(obstacles)) > 100
    assert np.abs(high(obstacles)[:, 0] - 1.52).max() <= VOXEL_M
    obstacles.move(Pose2(0.3, 0.0, np.pi / 2), 0.1, STEP)  # now on its right side, and lower
    assert np.abs(high(obstacles)[:, 1] + 1.22).max() <= VOXEL_M
    before = obstacles.voxels.places[:, 2].min()
    assert before == pytest.approx(-0.1, abs=VOXEL_M)


def test_what_is_seen_through_goes_and_what_is_seen_again_is_surer():
    obstacles = ObstacleMap()
    seen(1.2, obstacles)
    once = obstacles.voxels.probability.max()
    seen(1.2, obstacles)
    assert obstacles.voxels.probability.max() > once > 0.5
    for _ in range(6):
        seen(2.2, obstacles)
    wall = high(obstacles)
    wall = wall[
        (np.abs(wall[:, 1]) < 0.4) & (wall[:, 2] > 0.2) & (wall[:, 2] < 0.7)
    ]  # well in view
    assert np.abs(wall[:, 0] - 2.2).max() <= VOXEL_M


def test_places_get_vaguer_with_every_motion_until_they_are_forgotten():
    obstacles = ObstacleMap()
    seen(1.5, obstacles)
    rng = np.random.default_rng(0)
    sigma = np.sqrt(np.diag(STEP))
    truth = np.array([1.525, 0.025])  # of one voxel, in the frame of the body
    ends = []
    for _ in range(200):
        pose = Pose2()
        for _ in range(6):
            pose = pose @ Pose2(*(sigma[:3] * rng.standard_normal(3)))
        ends.append(pose.inverse().apply(truth) - truth)
    start = obstacles.voxels
    near = np.argmin(np.linalg.norm(start.places[:, :2] - truth, axis=1))
    first = start.variance_m2[near]
    for _ in range(6):
        obstacles.move(Pose2(), 0.0, STEP)
    grown = obstacles.voxels.variance_m2[near] - first
    assert grown == pytest.approx(np.mean(np.var(ends, axis=0)), rel=0.3)
    for _ in range(2000):
        obstacles.move(Pose2(), 0.0, STEP)
        if not len(obstacles.voxels.places):
            break
        assert obstacles.voxels.variance_m2.max() < VAGUE_M**2
    assert not len(obstacles.voxels.places)
