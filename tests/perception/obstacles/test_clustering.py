"""Clusters of cylinders, boxes, walls and people, seen from one side."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from scipy import stats

from perception.depth.points import from_depth
from perception.depth.structured_light import depth as structured_light
from perception.floor.choose import find
from perception.floor.classify import FLOOR, classify
from perception.floor.levelling import camera_above_floor
from perception.floor.prior import handheld_prior
from perception.floor.segmented_view import CUT, WHOLE
from perception.obstacles.clustering import ClusterConfig, cluster
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import DepthView
from perception.primitives.pose import Pose3, head_rotation

SENSOR = np.array([0.03, 0.0])
KINECT = Camera(320, 240, 262.5, 262.5, 159.5, 119.5)
PITCH = math.radians(0.25)  # between pixels: SR-4000, and every second pixel of a Kinect


def rays():
    """Directions of the image columns, on the ground plane."""
    angles = np.arange(-0.5, 0.5, PITCH)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def raised(plan, height, distance):
    """Every ground point as a vertical column of points at pixel density."""
    step = PITCH * np.maximum(distance, 0.1)
    columns = [np.arange(0.02, height, s) for s in step]
    xy = np.repeat(plan, [len(c) for c in columns], axis=0)
    return np.column_stack([xy, np.concatenate(columns)]) if len(xy) else np.zeros((0, 3))


def see_cylinder(centre, radius, height, rng, noise=0.006):
    """Visible side of a cylinder and the standard deviation of its points."""
    d = rays()
    offset = SENSOR - centre
    b = d @ offset
    inside = b**2 - (offset @ offset - radius**2)
    t = -b - np.sqrt(np.maximum(inside, 0.0))
    hit = inside > 0
    return noisy(d[hit], t[hit], height, rng, noise)


def see_box(x, y, height, rng, noise=0.006):
    """Visible sides of an upright box with sides along the axes."""
    d = rays()
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (np.array([x[0], y[0]]) - SENSOR) / d
        high = (np.array([x[1], y[1]]) - SENSOR) / d
    enter, leave = np.minimum(low, high).max(axis=1), np.maximum(low, high).min(axis=1)
    hit = (enter < leave) & (enter > 0)
    return noisy(d[hit], enter[hit], height, rng, noise)


def noisy(d, t, height, rng, noise):
    """Points along rays, each with its own error along the ray."""
    xyz = raised(np.column_stack([d, t]), height, t)
    xyz, t = np.column_stack([xyz[:, :2], xyz[:, 3]]), xyz[:, 2]
    t = t + noise * rng.normal(size=len(t))
    xyz[:, :2] = SENSOR + xyz[:, :2] * t[:, None]
    return xyz, np.full(len(xyz), noise)


def see_from_above(camera, sensor_m, pitch_rad, box, stride=1, noise_per_m=0.003):
    """Points of a box at least 3 cm above the floor, by a pinhole camera pitched down; their deviations and rows.

    Args:
        camera: Its intrinsics.
        sensor_m: Its height; it stands at the origin and looks along x.
        pitch_rad: Downwards.
        box: (2, 3), lower and upper corner.
        stride: Every n-th row and column is used.
        noise_per_m: Deviation along the ray over depth.
    """
    T = Pose3.from_rotation(head_rotation(0.0, pitch_rad), np.array([0.0, 0.0, sensor_m]))
    rays = camera.rays[::stride, ::stride].reshape(-1, 3) @ T.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.asarray(box)[:, None] - T.position) / rays
    z, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    hit = (z <= leave) & (z > 0.0)
    sigma = noise_per_m * z[hit]
    z = z[hit] + sigma * np.random.default_rng(0).normal(size=len(sigma))
    points = T.position + rays[hit] * z[:, None]
    rises = points[:, 2] > 0.03
    row = np.flatnonzero(hit) // camera.rays[0, ::stride].shape[0] * stride
    return points[rises], sigma[rises], row[rises]


def lifted(points, height):
    """The same points, raised."""
    return points + np.array([0.0, 0.0, height])


def test_a_truncated_cluster_is_not_whole():
    points, sigma = see_cylinder(np.array([1.5, 0.0]), 0.10, 0.4, np.random.default_rng(0))
    left = np.where(points[:, 1] > 0.07, CUT, WHOLE)
    (found,) = cluster(points, sigma, SENSOR, None, left)
    (other,) = cluster(points, sigma, SENSOR, None, np.full(len(points), WHOLE))
    assert not found.whole
    assert other.whole


def test_an_object_is_truncated_by_a_nearer_object_but_not_by_its_own_front():
    rng = np.random.default_rng(0)
    near, sigma_near = see_cylinder(np.array([0.8, 0.3]), 0.06, 0.4, rng)
    far, sigma_far = see_cylinder(np.array([1.5, 0.0]), 0.10, 0.4, rng)
    points, sigma = np.concatenate([near, far]), np.concatenate([sigma_near, sigma_far])
    is_far = np.arange(len(points)) >= len(near)
    left = is_far & (points[:, 1] > 0.07)
    for hider, whole in ((0, False), (len(points) - 1, True)):
        found = cluster(points, sigma, SENSOR, None, np.where(left, hider, WHOLE))
        assert [one.whole for one in found] == [True, whole]


@pytest.mark.parametrize("distance", [0.5, 1.0, 1.5, 2.2])
@pytest.mark.parametrize("bearing", [-0.3, 0.0, 0.25])
def test_the_centre_of_a_cylinder_lies_behind_its_visible_side(distance, bearing):
    rng = np.random.default_rng(0)
    centre = SENSOR + distance * np.array([math.cos(bearing), math.sin(bearing)])
    points, sigma = see_cylinder(centre, 0.10, 0.4, rng)
    (found,) = cluster(points, sigma, SENSOR)
    assert np.linalg.norm(found.centre - centre) < 0.012
    assert abs(found.radius_m - 0.10) < 0.02
    assert abs(found.height_m - 0.4) < 0.03
    assert found.points > 0.98 * len(points)  # a few at the edge are alone in their cell


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.2])
def test_the_ends_that_have_no_depth_belong_to_the_object(distance):
    rim_rad = 0.012
    centre = SENSOR + np.array([distance, 0.0])
    half = math.asin(0.10 / distance) - rim_rad
    points, sigma = see_cylinder(centre, 0.10, 0.4, np.random.default_rng(0))
    seen = np.abs(np.arctan2(*(points[:, :2] - SENSOR).T[::-1])) < half
    (found,) = cluster(points[seen], sigma[seen], SENSOR, rim_rad=rim_rad)
    assert np.linalg.norm(found.centre - centre) < 0.012
    assert abs(found.radius_m - 0.10) < 0.01


@pytest.mark.parametrize("rim_rad", [0.0, 0.006])
def test_an_object_of_one_column_of_pixels_is_as_wide_as_its_rims(rim_rad):
    column = np.column_stack([np.full(60, 1.5), np.zeros(60), np.linspace(0.02, 0.5, 60)])
    (found,) = cluster(column, np.full(60, 0.005), np.zeros(2), rim_rad=rim_rad)
    assert found.radius_m == pytest.approx(1.5 * rim_rad, abs=0.001)
    np.testing.assert_allclose(found.centre, [1.5 + found.radius_m, 0.0], atol=0.001)


def test_the_covariance_of_the_centre_covers_its_error():
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(150):
        distance, bearing = rng.uniform(0.5, 2.5), rng.uniform(-0.35, 0.35)
        centre = SENSOR + distance * np.array([math.cos(bearing), math.sin(bearing)])
        points, sigma = see_cylinder(centre, rng.uniform(0.06, 0.15), 0.4, rng)
        common = 0.008 * rng.normal(size=2)  # error common to all points
        points[:, :2] += common
        (found,) = cluster(points, sigma, SENSOR)
        e = found.centre - centre
        squares.append(e @ np.linalg.solve(found.covariance, e))
    assert np.mean(squares) < stats.chi2.ppf(0.999, 2 * len(squares)) / len(
        squares
    )  # not overconfident
    assert np.mean(squares) > 0.4  # nor far too cautious; 2 is exact


def test_a_box_is_covered_by_its_disc_and_measured_by_its_rectangle():
    rng = np.random.default_rng(2)
    points, sigma = see_box((1.0, 1.3), (-0.2, 0.2), 0.3, rng)
    (found,) = cluster(points, sigma, SENSOR)
    length, width, yaw = found.footprint
    assert abs(length - 0.4) < 0.03
    assert abs(abs(yaw) - math.pi / 2) < 0.1
    assert width < 0.06  # the front alone is seen; noise adds four deviations on either side
    front = np.array([[1.0, -0.2], [1.0, 0.2]])
    assert np.all(np.linalg.norm(front - found.centre, axis=1) < found.radius_m + 0.03)


def test_few_points_on_a_top_give_the_middle_between_its_edges():
    """A narrow object far away, seen from above: two points at every depth."""
    x, y = np.meshgrid(np.arange(3.36, 3.65, 0.02), [-0.02, 0.02])
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.3)])
    (found,) = cluster(points, np.full(len(points), 0.01), SENSOR, sensor_height_m=1.5)
    np.testing.assert_allclose(found.centre, [3.5, 0.0], atol=0.01)


@pytest.mark.parametrize("sensor_m", [0.7, 1.6, 2.5])
@pytest.mark.parametrize("ahead_m", [0.4, 0.8, 1.8])
def test_a_box_before_the_feet_of_a_tall_robot_is_one_cluster(sensor_m, ahead_m):
    """Pixels lie as densely as their range, not their distance on the floor, tells."""
    box = np.array([[ahead_m, -0.2, 0.0], [ahead_m + 0.3, 0.2, 0.35]])
    pitch = math.atan2(sensor_m - 0.175, ahead_m + 0.15)
    points, sigma, _ = see_from_above(KINECT, sensor_m, pitch, box, stride=2)
    (found,) = cluster(
        points, sigma, np.zeros(2), sensor_height_m=sensor_m, pitch_rad=2.0 / KINECT.fy
    )
    assert found.points > 0.97 * len(points)
    error = found.centre - box[:, :2].mean(axis=0)
    assert error @ np.linalg.solve(found.covariance, error) < 4.0
    assert found.radius_m == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize(
    ("sensor_m", "pitch_deg", "ahead_m", "whole"),
    [
        (1.6, 35.0, 1.3, True),  # floor is seen before it
        (1.6, 25.0, 1.3, True),  # the foot of its front is cut
        (1.6, 25.0, 1.0, False),  # only the farther part of its top is seen
        (1.6, 25.0, 0.9, False),
        (
            0.46,
            10.0,
            0.5,
            True,
        ),  # a small robot before it: the front is cut at a third of its height
    ],
)
def test_a_box_whose_front_is_below_the_image_is_truncated(sensor_m, pitch_deg, ahead_m, whole):
    box = np.array([[ahead_m, -0.2, 0.0], [ahead_m + 0.3, 0.2, 0.35]])
    points, sigma, row = see_from_above(KINECT, sensor_m, math.radians(pitch_deg), box, stride=2)
    (found,) = cluster(
        points,
        sigma,
        np.zeros(2),
        lowermost=row >= 236,
        sensor_height_m=sensor_m,
        pitch_rad=2.0 / KINECT.fy,
    )
    assert found.placed == whole
    error = found.centre - box[:, :2].mean(axis=0)
    assert error @ np.linalg.solve(found.covariance, error) < 4.0
    assert math.sqrt(found.covariance[1, 1]) < 0.05  # its sides are seen


@pytest.mark.parametrize("columns", [64, 80, 100, 160, 320])
@pytest.mark.parametrize("ahead_m", [0.7, 1.0, 1.3, 1.7, 2.2, 2.6])
def test_the_coarser_an_image_the_less_is_known_of_the_far_edge_of_a_top(columns, ahead_m):
    """A camera at 0.7 m, pitched 25 degrees, before a box 0.3 m deep; few rows of pixels meet its top."""
    f = 0.82 * columns
    camera = Camera(columns, columns * 3 // 4, f, f, (columns - 1) / 2, (columns * 3 // 4 - 1) / 2)
    box = np.array([[ahead_m, -0.2, 0.0], [ahead_m + 0.3, 0.2, 0.35]])
    points, sigma, _ = see_from_above(camera, 0.7, math.radians(25.0), box)
    (found,) = cluster(points, sigma, np.zeros(2), sensor_height_m=0.7, pitch_rad=1.0 / f)
    error = found.centre - box[:, :2].mean(axis=0)
    assert error @ np.linalg.solve(found.covariance, error) < 4.0
    assert found.radius_m == pytest.approx(0.25, abs=0.05)


def test_separate_objects_are_separate_clusters_and_the_nearest_comes_first():
    rng = np.random.default_rng(3)
    seen = [
        see_cylinder(SENSOR + np.array(c), 0.10, 0.4, rng)
        for c in ((2.0, -0.5), (1.2, 0.3), (1.6, 0.0))
    ]
    points, sigma = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    found = cluster(points, sigma, SENSOR)
    assert [round(float(np.hypot(*(c.centre - SENSOR))), 1) for c in found] == [1.2, 1.6, 2.1]


def test_a_wall_is_one_long_cluster():
    rng = np.random.default_rng(4)
    points, sigma = see_box((2.0, 2.1), (-2.0, 2.0), 0.5, rng)
    (found,) = cluster(points, sigma, SENSOR)
    assert found.footprint.length_m > 1.8
    assert found.radius_m > 0.9


def test_people_who_touch_are_split_by_their_heads():
    rng = np.random.default_rng(5)
    parts = []
    for y in (-0.22, 0.22):
        parts.append(see_cylinder(np.array([2.0, y]), 0.225, 1.4, rng))
        head, sigma = see_cylinder(np.array([2.0, y]), 0.09, 0.3, rng)
        parts.append((lifted(head, 1.4), sigma))
    points, sigma = (np.concatenate(column) for column in zip(*parts, strict=True))
    found = cluster(points, sigma, SENSOR)
    assert len(found) == 2
    assert sorted(round(float(c.centre[1]), 1) for c in found) == [-0.2, 0.2]


def test_stray_points_and_shelves_give_no_clusters():
    rng = np.random.default_rng(6)
    points, sigma = see_cylinder(np.array([1.5, 0.0]), 0.10, 0.4, rng)
    stray = np.column_stack(
        [rng.uniform(0.5, 3.0, 40), rng.uniform(-1, 1, 40), rng.uniform(0, 0.5, 40)]
    )
    shelf, shelf_sigma = see_box((1.0, 1.3), (0.4, 0.8), 0.2, rng)
    everything = np.concatenate([points, stray, lifted(shelf, 0.7)])
    found = cluster(everything, np.concatenate([sigma, np.full(40, 0.01), shelf_sigma]), SENSOR)
    assert len(found) == 1
    assert np.linalg.norm(found[0].centre - [1.5, 0.0]) < 0.03


def test_a_hole_gives_no_cluster():
    rng = np.random.default_rng(7)
    points, sigma = see_box((1.0, 1.3), (0.2, 0.6), 0.3, rng)
    assert cluster(lifted(points, -0.4), sigma, SENSOR) == []


def test_the_order_of_the_points_does_not_matter():
    rng = np.random.default_rng(8)
    points, sigma = see_cylinder(np.array([1.5, 0.2]), 0.10, 0.2, rng)
    order = rng.permutation(len(points))
    (one,), (other,) = cluster(points, sigma, SENSOR), cluster(points[order], sigma[order], SENSOR)
    np.testing.assert_allclose(one.centre, other.centre, atol=2e-3)
    assert one.points == other.points


def test_five_people_give_five_clusters(recordings):
    import open3d as o3d

    cloud = o3d.io.read_point_cloud(str(recordings / "pcl_kinect" / "five_people.pcd"))
    z = np.asarray(cloud.points)[:, 2].reshape(480, 640).astype(np.float32)
    camera = Camera(640, 480, 525.0, 525.0, 319.5, 239.5)
    points = from_depth(structured_light(DepthView(z, camera)), 0.3, 4.0, 2)
    floor = find(points, handheld_prior(None), np.random.default_rng(0)).plane
    rising = classify(points, floor) != FLOOR
    upright = camera_above_floor(floor).apply(points.xyz[rising])
    upright[:, 2] = floor.distance(points.xyz[rising])
    low = upright[:, 2] < 2.2
    found = cluster(upright[low], points.sigma[rising][low], np.zeros(2))
    people = [c for c in found if 1.4 < c.height_m < 2.0]
    assert len(people) == 5
    assert all(0.15 < c.radius_m < 0.35 for c in people)
    assert len(found) <= 9  # and pieces of a desk and of a wall


def test_no_or_too_few_points_give_no_clusters():
    assert cluster(np.zeros((0, 3)), np.zeros(0), SENSOR) == []
    assert cluster(np.ones((3, 3)), np.full(3, 0.01), SENSOR) == []


def test_invalid_input_is_refused_with_a_message():
    with pytest.raises(InputError, match="must be finite"):
        cluster(np.full((3, 3), np.nan), np.ones(3), SENSOR)
    with pytest.raises(ConfigError, match=r"cell_m=0\.0"):
        ClusterConfig(cell_m=0.0)


def test_the_rectangle_equals_that_of_opencv():
    rng = np.random.default_rng(9)
    points, sigma = see_box((1.0, 1.2), (-0.2, 0.2), 0.2, rng)
    (found,) = cluster(points, sigma, SENSOR)
    sides = cv2.minAreaRect(points[:, :2].astype(np.float32))[1]
    assert found.footprint.length_m == pytest.approx(max(sides), abs=0.02)


def test_a_cluster_within_the_band_of_the_floor_is_no_obstacle():
    """A blob 5 cm high: an obstacle on a floor known to 3 cm, noise on one known to 6 cm."""
    rng = np.random.default_rng(0)
    blob = rng.uniform([1.0, -0.1, 0.02], [1.2, 0.1, 0.05], (400, 3))
    sigma = np.full(400, 0.005)
    for band_m, count in ((0.03, 1), (0.06, 0)):
        found = cluster(blob, sigma, np.zeros(2), floor_band=np.full(400, band_m))
        assert len(found) == count


def test_surface_points_lie_on_the_upper_front_away_from_the_edges():
    rng = np.random.default_rng(1)
    box = rng.uniform([1.5, -0.2, 0.0], [1.52, 0.2, 0.6], (3000, 3))
    (one,) = cluster(box, np.full(3000, 0.005), np.zeros(2))
    points = box[one.surface]
    assert len(points) >= 10
    assert np.abs(points[:, 1]).max() < 0.11
    assert points[:, 2].min() >= 0.29
