"""Truncation: a post before a wall, at every border of the view."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import Points, from_depth
from perception.depth.reach import ReachConfig
from perception.floor.classify import OBSTACLE
from perception.floor.segmented_view import (
    CUT,
    WHOLE,
    SegmentedView,
    Sight,
    lowermost,
    sees_through,
    truncated,
    uppermost,
)
from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

WIDE = Camera(160, 120, 80.0, 80.0, 79.5, 59.5)
NARROW = Camera(160, 120, 200.0, 200.0, 79.5, 59.5)
REACH = ReachConfig(0.15, 3.0, 1)


def post(camera, bearing_m, z_m, half_m=0.1, baseline_m=0.0, blank=False):
    """A view along x of a flat post, half as wide as `half_m`, its middle `bearing_m` to the right."""
    across = (np.arange(camera.width) - camera.cx) / camera.fx
    row = np.where(np.abs(across * z_m - bearing_m) < half_m, z_m, 2.5)
    if baseline_m:  # the right image shows nothing of the left border
        row[np.arange(camera.width) < camera.fx * baseline_m / row] = np.nan
    if blank:
        row[:] = np.nan
    z = np.repeat(row[None], camera.height, axis=0).astype(np.float32)
    depth = Depth(z, np.full_like(z, 0.01), camera, baseline_m=baseline_m)
    cloud = from_depth(depth, REACH.nearest_m, REACH.farthest_m, REACH.stride)
    classes = np.full(len(cloud), OBSTACLE, dtype=np.int8)
    floor = Plane(np.array([0.0, -1.0, 0.0]), 0.4)
    return SegmentedView("stereo", depth, cloud, classes, floor, None, Pose3(), cloud.xyz.copy())


def is_whole(view, others=()):
    front = view.points.xyz[:, 2] < 1.5
    assert front.any()
    return bool((truncated(view, view.points.of(front), REACH, others) == WHOLE).all())


def test_a_post_is_truncated_at_either_side_of_the_image_but_not_in_the_middle():
    assert is_whole(post(WIDE, 0.0, 0.6))
    assert not is_whole(post(WIDE, 0.6, 0.6))
    assert not is_whole(post(WIDE, -0.6, 0.6))


def test_a_stereo_pair_truncates_at_the_left_border_of_its_right_image():
    """Nearer than 0.5 m the band without a match is wider than the image border."""
    middle = -0.36
    assert is_whole(post(WIDE, middle, 0.5))
    assert not is_whole(post(WIDE, middle, 0.5, baseline_m=0.06))
    assert is_whole(post(WIDE, -middle, 0.5, baseline_m=0.06))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wider_view_with_depth_beyond_the_border_removes_the_truncation(side):
    near = post(NARROW, side * 0.18, 0.5)
    assert not is_whole(near)
    assert is_whole(near, [post(WIDE, side * 0.18, 0.5)])
    assert not is_whole(near, [post(WIDE, side * 0.18, 0.5, blank=True)])


@pytest.mark.parametrize("stride", [1, 2, 7])
def test_what_reaches_the_lower_border_is_lowermost_unless_another_view_sees_below(stride):
    near, reach = post(NARROW, 0.0, 0.5), ReachConfig(0.15, 3.0, stride)
    cloud = from_depth(near.depth, reach.nearest_m, reach.farthest_m, stride)
    row = cloud.pixels // NARROW.width
    found = lowermost(near, cloud, reach)
    assert found[row == row.max()].all()
    assert not found[row < 110].any()
    assert not lowermost(near, cloud, reach, [post(WIDE, 0.0, 0.5)]).any()
    assert (lowermost(near, cloud, reach, [post(WIDE, 0.0, 0.5, blank=True)]) == found).all()


def test_points_at_the_nearest_depth_are_truncated():
    assert is_whole(post(WIDE, 0.0, 0.25, half_m=0.05))
    assert not is_whole(post(WIDE, 0.0, 0.16, half_m=0.05))


def test_a_partly_occluded_object_is_truncated():
    view = post(WIDE, 0.0, 0.9)
    front = post(WIDE, 0.15, 0.4)
    z = np.fmin(view.depth.z, front.depth.z)
    depth = Depth(z, np.full_like(z, 0.01), WIDE)
    cloud = from_depth(depth, REACH.nearest_m, REACH.farthest_m, REACH.stride)
    both = SegmentedView(
        "tof", depth, cloud, view.classes, view.floor, None, Pose3(), cloud.xyz.copy()
    )
    behind = np.abs(cloud.xyz[:, 2] - 0.9) < 0.01
    assert behind.any()
    before = np.abs(cloud.xyz[:, 2] - 0.4) < 0.01
    assert (truncated(both, cloud.of(behind), REACH) == CUT).any()
    assert (truncated(both, cloud.of(before), REACH) == WHOLE).all()
    beside = truncated(both, cloud, REACH)
    ended = beside >= 0
    assert ended.any()
    assert behind[ended].any()
    assert before[beside[ended & behind]].all()
    assert not before[ended].any()


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("aside_px", [0.0, 0.5, 1.0])
def test_a_round_object_is_not_cut_by_its_own_front_whichever_pixels_are_used(stride, aside_px):
    """A column of radius 0.5 m: at both edges the surface recedes by more than the step of an occlusion."""
    camera = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
    middle, radius = np.array([aside_px * 2.5 / camera.fx, 2.5]), 0.5
    rays = np.stack([(np.arange(640) - camera.cx) / camera.fx, np.ones(640)])
    along = middle @ rays
    squared = (rays**2).sum(axis=0)
    root = np.sqrt(np.maximum(along**2 - squared * (middle @ middle - radius**2), 0.0))
    row = np.where(root > 0.0, (along - root) / squared, np.nan)
    z = np.repeat(row[None], 480, axis=0).astype(np.float32)
    depth = Depth(z, np.full_like(z, 0.01), camera)
    cloud = from_depth(depth, 0.3, 3.5, stride)
    floor = Plane(np.array([0.0, -1.0, 0.0]), 0.9)
    classes = np.full(len(cloud), OBSTACLE, dtype=np.int8)
    view = SegmentedView("depth", depth, cloud, classes, floor, None, Pose3(), cloud.xyz.copy())
    beside = truncated(view, cloud, ReachConfig(0.3, 3.5, stride))
    assert (beside >= 0).any()
    assert not (beside == CUT).any()


def test_a_sight_sees_through_places_before_the_measured_depth_and_not_behind_or_at_it():
    """A post 0.2 m wide at 1 m before a wall at 2.5 m."""
    sight = Sight([post(WIDE, 0.0, 1.0)])

    def at(x: float, z: float) -> np.ndarray:
        return np.array([[x, 0.0, z]] * 3)

    assert sight(at(0.0, 1.0)) == (0, 3)  # its front
    assert sight(at(0.0, 1.5)) == (0, 0)  # hidden by it
    assert sight(at(0.3, 1.0)) == (3, 0)  # beside it
    assert sight(at(0.11, 1.0)) == (0, 3)  # within an error of the pose of its edge
    assert sight(at(0.3, 2.5)) == (0, 3)  # the wall
    assert sight(at(5.0, 1.0)) == (0, 0)  # outside the image


def test_an_image_sees_through_the_places_that_a_sight_finds_free():
    """The camera 0.4 m above the floor of a map in which it is at height 0: heights count from the floor."""
    view = post(WIDE, 0.0, 1.0)
    places = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.5], [0.3, 0.0, 1.0], [0.3, 0.0, 3.0]])
    above_floor = places + np.array([0.0, 0.0, 0.4])
    through = sees_through(view.depth, Pose3(), 0.4, above_floor)
    assert through.tolist() == [False, True, True, False]
    free = [Sight([view])(place[None])[0] == 1 for place in places]
    assert through.tolist() == free


def test_a_place_beside_the_view_of_a_lens_that_folds_is_not_visible():
    folding = (-0.3728755, 0.2037299, 2.219027e-3, 1.383707e-3, -0.07233722)  # KITTI, raw
    lens = Camera(1392, 512, 984.2, 980.8, 690.0, 233.2, folding)
    z = np.full((lens.height, lens.width), 4.0, np.float32)
    depth = Depth(z, np.full_like(z, 0.01), lens)
    level = Pose3.from_rotation(head_rotation(0.0, np.radians(10)), np.array([0, 0, 0.8]))
    floor = Plane(np.array([0.0, -1.0, 0.0]), 0.8)
    none = Points(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    view = SegmentedView("depth", depth, none, np.zeros(0, np.int8), floor, None, level, none.xyz)
    bearings = np.radians(np.arange(0, 88))
    visible = Sight([view]).visible(1.5 * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1))
    assert visible[:35].all()
    assert not visible[45:].any()  # the row of the knees ends at 39 deg


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_camera_on_its_side_or_upside_down_sees_the_same_borders(turns):
    """A scene and its image turned by quarter turns: the same points are cut at the same sides."""
    upright = post(WIDE, 0.6, 0.6)
    z = np.fmin(upright.depth.z, post(WIDE, -0.2, 0.9).depth.z)
    z[:10] = 2.0  # a lintel at the top
    views, found = [], []
    for k in (0, turns):
        image = np.ascontiguousarray(np.rot90(z, -k))  # what was up is at the right, down, left
        height, width = image.shape
        lens = Camera(width, height, 80.0, 80.0, (width - 1) / 2, (height - 1) / 2)
        depth = Depth(image, np.full_like(image, 0.01), lens)
        cloud = from_depth(depth, REACH.nearest_m, REACH.farthest_m, REACH.stride)
        up = [(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)][k]
        floor = Plane(np.array([*up, 0.0]), 0.4)
        classes = np.full(len(cloud), OBSTACLE, np.int8)
        views.append(
            SegmentedView("tof", depth, cloud, classes, floor, None, Pose3(), cloud.xyz.copy())
        )
    for view in views:
        kinds = truncated(view, view.points, REACH)
        marks = (kinds == CUT, kinds >= 0, uppermost(view, view.points))
        for mark in (*marks, lowermost(view, view.points, REACH)):
            image = np.zeros(view.depth.z.size, bool)
            image[view.points.pixels] = mark
            found.append(image.reshape(view.depth.z.shape))
    for straight, turned in zip(found[:4], found[4:], strict=True):
        assert straight.any()
        np.testing.assert_array_equal(np.rot90(turned, turns), straight)
