"""What hangs lower than the robot's head stays in the maps of a run, until it is seen to be gone.

Depth images of boxes on a floor before a wall, by exact geometry, with the camera of a small robot at 0.39 m.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from perception.depth.points import from_depth
from perception.floor import classify
from perception.floor.segmented_view import SegmentedView
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, Frame
from perception.primitives.gaussian import Gaussian
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3
from surefoot.config.schema import Config
from surefoot.run.maps import RunMaps

EYE_M = 0.39
CAMERA = Camera(160, 120, 200.0, 200.0, 79.5, 59.5)  # 33 deg high
WALL = (3.5, 3.6, -3.0, 3.0, 0.0, 2.0)


def table(top_m):
    """A top 3 cm thick and 0.6 m deep from x = 1.5 m on; its legs are out of view."""
    return (1.5, 2.1, -1.0, 1.0, top_m - 0.03, top_m)


def view(x_m, down_deg, boxes):
    """What a camera at (x, 0) sees that looks along x and down."""
    a = math.radians(down_deg)
    forward, down = (
        np.array([math.cos(a), 0.0, -math.sin(a)]),
        np.array([-math.sin(a), 0.0, -math.cos(a)]),
    )
    rotation = np.column_stack([[0.0, -1.0, 0.0], down, forward])
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1
    )
    rays = rays @ rotation.T
    eye = np.array([x_m, 0.0, EYE_M])
    with np.errstate(divide="ignore"):
        z = np.where(rays[..., 2] < 0.0, -EYE_M / rays[..., 2], np.inf)
        for box in (WALL, *boxes):
            sides = (np.array(box).reshape(3, 2) - eye[:, None]) / rays[..., None]
            enters, leaves = sides.min(axis=-1).max(axis=-1), sides.max(axis=-1).min(axis=-1)
            z = np.where((enters < leaves) & (enters > 0.0), np.minimum(z, enters), z)
    depth = Depth(z.astype(np.float32), np.full(z.shape, 0.003, np.float32), CAMERA)
    cloud = from_depth(depth, 0.15, 4.0)
    floor = Plane(np.array([0.0, -math.cos(a), -math.sin(a)]), EYE_M)
    place = Pose3.from_rotation(rotation, eye)
    upright = place.apply(cloud.xyz)
    upright[:, 2] = floor.distance(cloud.xyz)
    classes = classify.classify(cloud, floor)
    return SegmentedView("depth", depth, cloud, classes, floor, 0.5, place, upright)


class Walk:
    """Maps of a robot that looks from some place as often as told."""

    def __init__(self):
        self.maps, self.stamp_s = RunMaps(Config()), 0.0

    def look(self, times, x_m, down_deg, *boxes):
        seen = view(x_m, down_deg, boxes)
        pose = Gaussian(np.array([x_m, 0.0, 0.0]), np.diag([1e-6, 1e-6, 1e-6]))
        for _ in range(times):
            self.stamp_s += 0.2
            frame = Frame(self.stamp_s)
            self.maps.update(frame, [seen], (), pose)

    def look_from_far(self, times, *boxes):
        self.look(times, 0.0, 12.0, *boxes)

    def look_down_from_near(self, times, *boxes):
        self.look(times, 1.0, 45.0, *boxes)

    def front(self, one):
        """Probability of cells along the front edge of the table, 1.5 m ahead, in one of the maps."""
        places = np.column_stack([np.full(9, 1.501), np.linspace(-0.2, 0.2, 9)])
        return one.probability[tuple(one.cell_of(places).T)]

    def blocks(self):
        """Of each map, whether all the front blocks; it must not be undecided."""
        found = []
        for one in (self.maps.grid, self.maps.world):
            p = self.front(one)
            assert (p >= 0.5).all() or (p < 0.5).all()
            found.append(bool((p >= 0.5).all()))
        return found


@pytest.mark.parametrize("top_m", [0.30, 0.40, 0.45])
def test_floor_seen_below_a_top_from_near_does_not_free_it_and_a_look_through_its_height_does(
    top_m,
):
    walk = Walk()
    walk.look_down_from_near(20)  # free floor, before the table comes
    assert walk.blocks() == [False, False]
    walk.look_from_far(3, table(top_m))
    assert walk.blocks() == [True, True]
    walk.look_down_from_near(40, table(top_m))
    assert walk.blocks() == [True, True]
    walk.look_down_from_near(40)  # it is away, but nothing of that can be seen from here
    assert walk.blocks() == [True, True]
    walk.look_from_far(12)
    assert walk.blocks() == [False, False]


def test_floor_at_the_place_of_what_stood_frees_it_from_near():
    walk, box = Walk(), (1.5, 2.1, -1.0, 1.0, 0.0, 0.35)
    walk.look_from_far(3, box)
    assert walk.blocks() == [True, True]
    walk.look_down_from_near(12)
    assert walk.blocks() == [False, False]


def test_floor_at_the_place_of_what_moves_frees_it_though_it_hung():
    walk = Walk()
    walk.look_from_far(3, table(0.40))
    for one in (walk.maps.grid, walk.maps.world):
        one.mark_moving(np.array([[1.5, 0.0]]), np.array([0.5]))
    walk.look_down_from_near(1)
    assert walk.blocks() == [False, False]
