"""Sizes of obstacles in a panorama: simulated boxes, by a camera with all its errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.panorama import literal_formulas
from mapping.panorama.adjustment import Placed
from mapping.panorama.rendering import render
from mapping.panorama.segments import outline_segments
from mapping.panorama.sizes import SizeConfig, surroundings
from mapping.panorama.stitching import Panorama, StitchConfig, stitch
from mapping.panorama.views import View, view_of_depth
from perception.depth import time_of_flight
from perception.features.pictures import amplitude_picture
from perception.primitives.errors import InputError
from perception.primitives.frame import RangeView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose2, Pose3, head_rotation

rays = pytest.importorskip("sim.rendering.rays", reason="renders the views")

from sim.scene import FloorArea, Scene, StaticObject  # noqa: E402
from sim.scenes.rooms import walls  # noqa: E402
from sim.sensors.tof_camera import TofCamera, TofConfig  # noqa: E402
from sim.shapes import Box  # noqa: E402

EXTENT = (-0.8, -2.2, 3.4, 2.2)
CALIBRATED = time_of_flight.TofConfig(wiggle_m=0.004, stray_share=0.02)


def head(pan, tilt):
    rotation = head_rotation(pan, tilt)
    lever = rotation @ np.array([0.0, -0.035, 0.035])
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, 0.55]) + lever)


def views_of(boxes, seed=0, error_deg=0.0, yaws=(15.0, -15.0)):
    things = tuple(StaticObject(f"box {k}", (box,), 0.6) for k, box in enumerate(boxes))
    floor = (FloorArea("planks/pine", EXTENT),)
    room = walls(EXTENT, ("wall/white",) * 4)
    caster = rays.RayCaster(Scene("test", 0, EXTENT, floor, room + things, (), (), Pose2(), ((1.0, 0.0),)))  # fmt: skip
    caster.place([])
    rng = np.random.default_rng([seed, 7])
    camera = TofCamera(TofConfig(), rng)
    views, true = [], []
    for yaw in yaws:
        off = math.radians(error_deg) * rng.standard_normal(2)
        prior, pose = (head(math.radians(yaw) + a, 0.3 + b) for a, b in ((0.0, 0.0), off))
        range_m, amplitude = camera.measure(caster, pose)
        depth = time_of_flight.depth(
            RangeView(range_m, amplitude, camera.camera, prior), CALIBRATED
        )
        views.append(view_of_depth(depth, 5.0, amplitude_picture(amplitude), prior))
        true.append(pose)
    return views, true


def exactly(views, poses, px_per_deg=4.0):
    """The panorama of exactly known poses."""
    placed = [Placed(pose, 1e-8 * np.eye(6), "encoders", 0, np.zeros(len(poses))) for pose in poses]
    return Panorama(placed, [], render(views, placed, px_per_deg))


def box(x, y, depth, width, height, yaw=0.0):
    return Box((x + depth / 2, y, height / 2), (depth, width, height), yaw)


@pytest.fixture(scope="module")
def three():
    """Three boxes at known places, seen with known poses."""
    boxes = [
        box(1.1, 0.55, 0.2, 0.30, 0.30), box(1.3, 0.0, 0.3, 0.25, 0.40), box(0.9, -0.45, 0.2, 0.2, 0.2)
    ]  # fmt: skip
    views, true = views_of(boxes)
    return boxes, surroundings(exactly(views, true), views)


def test_obstacles_are_listed_from_left_to_right_with_their_sizes(three):
    boxes, seen = three
    assert len(seen) == 3
    for true, found in zip(boxes, seen.obstacles, strict=True):
        front = true.centre[0] - true.size[0] / 2
        assert found.distance_m == pytest.approx(front, abs=0.005)
        assert found.height_m == pytest.approx(true.size[2], abs=0.005)
        assert found.width_m == pytest.approx(true.size[1], abs=0.006)
        assert found.levels[0] == pytest.approx(front / 0.05 + 1, abs=1.2)
        assert not found.cut_top


def test_edges_lie_at_the_corners(three):
    boxes, seen = three
    true, found = boxes[1], seen.obstacles[1]
    front, half = true.centre[0] - true.size[0] / 2, true.size[1] / 2
    assert found.left_rad == pytest.approx(math.atan2(half, front), abs=math.radians(0.25))
    assert found.right_rad == pytest.approx(-math.atan2(half, front), abs=math.radians(0.25))


def test_gaps_are_the_free_widths(three):
    boxes, seen = three
    assert [(gap.left, gap.right) for gap in seen.gaps] == [(None, 0), (0, 1), (1, 2), (2, None)]
    for k, gap in enumerate(seen.gaps[1:-1]):
        left, right = boxes[k], boxes[k + 1]
        free = left.centre[1] - left.size[1] / 2 - right.centre[1] - right.size[1] / 2
        assert gap.width_m + gap.hidden_m / 3.0 == pytest.approx(free, abs=0.008)  # by seen edges
        assert abs(gap.width_m - free) < 2.0 * gap.sigma_width_m
        assert 0.0 < gap.sigma_width_m < 0.02


def test_an_occluded_edge_is_marked():
    boxes = [box(0.9, 0.0, 0.1, 0.2, 0.5), box(1.6, 0.25, 0.2, 0.6, 0.4)]
    views, true = views_of(boxes)
    behind = max(surroundings(exactly(views, true), views).obstacles, key=lambda o: o.distance_m)
    assert behind.cut_right
    assert not behind.cut_left


def test_walls_have_no_top_below_the_highest_obstacle_height():
    views, true = views_of([box(1.2, 0.0, 0.2, 0.3, 0.3), box(1.9, 0.5, 0.1, 0.4, 1.5)])
    seen = surroundings(exactly(views, true), views).obstacles
    assert [one.cut_top for one in seen if one.distance_m < 2.2] == [True, False]


def test_sizes_are_consistent_with_their_standard_deviations_under_encoder_errors():
    """Rows of boxes across two views: errors within three sigmas, and widths within 2 %."""
    inside, off = [], []
    for seed in range(6):
        width, distance = 0.7 + 0.1 * seed, 1.05 + 0.04 * seed
        views, _ = views_of([box(distance, 0.02, 0.3, width, 0.32)], seed, error_deg=0.5)
        panorama = stitch(views, np.random.default_rng(seed), StitchConfig())
        ahead = [o for o in surroundings(panorama, views).obstacles if o.left_rad > 0 > o.right_rad]
        found = min(ahead, key=lambda o: o.distance_m)
        off.append(found.width_m / width - 1.0)
        inside += [
            abs(found.width_m - width) < 3.0 * found.sigma_width_m,
            abs(found.distance_m - distance) < 3.0 * found.sigma_distance_m,
            abs(found.height_m - 0.32) < 3.0 * found.sigma_height_m,
        ]
    assert np.max(np.abs(off)) < 0.02
    assert np.mean(inside) > 0.9


def test_an_empty_room_has_no_obstacles():
    views, true = views_of([])
    assert [o for o in surroundings(exactly(views, true), views).obstacles if not o.cut_top] == []
    assert len(surroundings(Panorama([None], [], None), [View(views[0].depth, ())])) == 0


def test_a_yaw_error_does_not_add_to_the_width_of_an_obstacle_within_one_view():
    """By encoders alone, an obstacle within one view is more certain than one with an edge in each of two."""
    views, true = views_of([box(1.2, 0.35, 0.2, 0.3, 0.3), box(1.5, -0.05, 0.2, 1.3, 0.3)])
    sigma = math.radians(0.5)
    placed = [
        Placed(pose, sigma**2 * np.eye(6), "encoders", 0, sigma**2 * np.eye(2)[k])
        for k, pose in enumerate(true)
    ]
    seen = surroundings(Panorama(placed, [], render(views, placed)), views).obstacles
    narrow, wide = sorted((o for o in seen if o.distance_m < 2.0), key=lambda o: o.width_m)[-2:]
    assert narrow.sigma_width_m < 0.006
    assert wide.sigma_width_m > 0.012
    assert narrow.sigma_left_rad == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize(
    ("width_m", "short"), [(0.713, 0.036), (0.954, 0.061), (1.195, 0.091), (1.428, 0.122)]
)
def test_printed_widths_are_too_small_on_a_sphere_and_correct_on_a_plane(width_m, short):
    """At the distance of the published table; 217.8 px/rad is the camera's own resolution."""
    flat = literal_formulas.width(1.05, 217.8 * width_m / 1.05)
    assert flat == pytest.approx(width_m, rel=0.001)
    round_ = literal_formulas.width(1.05, 217.8 * 2.0 * math.atan(width_m / 2.0 / 1.05))
    assert 1.0 - round_ / width_m == pytest.approx(short, abs=0.001)


def test_literal_sizes_count_pixels():
    views, true = views_of([box(1.05, 0.0, 0.2, 0.6, 0.3)])
    panorama = exactly(views, true)
    (found,) = [o for o in surroundings(panorama, views).obstacles if o.distance_m < 2.0]
    literal = surroundings(panorama, views, config=SizeConfig(literal=True))
    (counted,) = [o for o in literal.obstacles if o.distance_m < 2.0]
    assert abs(found.width_m - 0.6) < 0.006
    assert abs(counted.width_m - 0.6) > 0.02
    assert counted.left_rad == found.left_rad


def test_literal_sizes_do_not_depend_on_the_resolution():
    views, true = views_of([box(1.05, 0.0, 0.2, 0.6, 0.3), box(1.05, 0.65, 0.2, 0.2, 0.3)])

    def sizes(px_per_deg):
        panorama = exactly(views, true, px_per_deg)
        seen = surroundings(panorama, views, config=SizeConfig(literal=True))
        near = [k for k, o in enumerate(seen.obstacles) if o.distance_m < 1.5]
        (gap,) = [g.width_m for g in seen.gaps if [g.left, g.right] == near]
        return [(seen.obstacles[k].width_m, seen.obstacles[k].height_m, gap) for k in near]

    coarse, fine = np.array(sizes(4.0)), np.array(sizes(8.0))
    assert coarse.shape == (2, 3)
    np.testing.assert_allclose(fine, coarse, atol=0.012)  # two pixels and a half


def test_the_printed_width_of_the_whole_view_is_its_field_of_view():
    across = literal_formulas.width(1.05, literal_formulas.ACROSS_PX_PER_RAD * math.radians(44.0))
    down = literal_formulas.height(1.05, literal_formulas.DOWN_PX_PER_RAD * math.radians(35.0))
    assert across == pytest.approx(2.1 * math.tan(math.radians(22.0)))
    assert down == pytest.approx(2.1 * math.tan(math.radians(17.5)))


def test_whole_obstacles_are_not_split_again_in_a_wide_panorama():
    views, true = views_of(
        [box(1.1, 0.0, 0.2, 0.3, 0.3), box(0.02, 1.0, 0.06, 0.2, 0.5)], yaws=(15.0, -15.0, 70.0)
    )
    panorama = exactly(views, true)
    (ahead,) = [o for o in surroundings(panorama, views).obstacles if abs(o.bearing_rad) < 0.2]
    found = outline_segments(panorama, [ahead], 1.65)
    assert all(abs(one.bearing_rad) > 0.2 for one in found)
    assert all(abs(one.bearing_rad) < math.radians(85.0) for one in found)


def test_an_obstacle_at_a_wall_is_split_off_at_the_concave_corner():
    """The side wall is near the robot; the box that touches it must not appear as near."""
    views, true = views_of([box(1.1, 1.25, 0.2, 1.9, 0.3)], yaws=(70.0, 45.0, 20.0, -5.0))
    found = [one for one in outline_segments(exactly(views, true), [], 1.65) if one.width_m > 0.5]
    (across,) = [one for one in found if one.right_edge_m[1] < 0.5]
    assert across.distance_m == pytest.approx(1.1, abs=0.05)
    assert across.right_edge_m[1] == pytest.approx(0.3, abs=0.03)
    assert across.width_m == pytest.approx(1.9, abs=0.1)


def test_segments_are_as_high_as_they_stand_above_the_floor_that_is_given():
    views, true = views_of([box(1.1, 0.2, 0.2, 0.3, 0.3)])
    panorama = exactly(views, true)
    for level in (0.0, 0.12):
        floor = Plane(np.array([0.0, 0.0, 1.0]), -level)
        found = outline_segments(panorama, [], 1.65, floor)
        (one,) = [o for o in found if abs(0.5 * (o.left_edge_m[1] + o.right_edge_m[1]) - 0.2) < 0.1]
        assert one.height_m == pytest.approx(0.3 - level, abs=0.02)


def test_segments_refuse_another_floor_than_that_of_the_listing():
    views, true = views_of([box(1.1, 0.2, 0.2, 0.3, 0.3), box(0.8, -0.3, 0.2, 0.3, 0.1)])
    panorama, floor = exactly(views, true), Plane(np.array([0.0, 0.0, 1.0]), -0.12)
    whole = surroundings(panorama, views, floor).obstacles
    near = [one for one in whole if one.distance_m < 1.65]
    assert len(near) == 1
    assert outline_segments(panorama, whole, 1.65, floor=floor) == []
    with pytest.raises(InputError, match="the floor and the config that surroundings was given"):
        outline_segments(panorama, whole, 1.65)
