"""Footprints of things of known shape, and of a measured cabinet."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.io.clouds import CloudBuilder, CloudConfig
from mapping.objects.columns import Voxels
from mapping.objects.footprints import Footprint, FootprintConfig, find, voxels_of
from mapping.objects.free_cells import FreeCells, area
from mapping.objects.pixels import inside
from mapping.objects.sides import EDGE_SIGMA_M
from perception.primitives.errors import ConfigError
from perception.primitives.pose import Pose2, Pose3


def box(
    rng: np.random.Generator,
    size: tuple[float, float, float],
    faces: str = "front back left right top",
    sigma_m: float = 0.005,
    density: float = 4000.0,
) -> np.ndarray:
    """Noisy points (n, 3) on faces of an upright box about the origin, m; density per m^2."""
    a, b, h = size
    spans = {
        "front": ((a, b / 2 * -1), (0, h)),
        "back": ((a, b / 2), (0, h)),
        "left": ((b, a / 2 * -1), (1, h)),
        "right": ((b, a / 2), (1, h)),
    }
    parts = []
    for face in faces.split():
        if face == "top":
            n = int(a * b * density)
            part = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)) * [a, b], np.full(n, h)])
        else:
            (length, at), (axis, height) = spans[face]
            n = int(length * height * density)
            part = np.empty((n, 3))
            part[:, axis] = rng.uniform(-0.5, 0.5, n) * length
            part[:, 1 - axis] = at
            part[:, 2] = rng.uniform(0, height, n)
        parts.append(part)
    points = np.concatenate(parts)
    return points + rng.normal(0, sigma_m, points.shape)


def placed(points: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
    """The points moved to a pose on the floor."""
    return Pose2(x, y, yaw).lifted().apply(points)


def voxels(points: np.ndarray) -> np.ndarray:
    """Averaged as the pipeline does."""
    builder = CloudBuilder(CloudConfig(voxel_m=0.02))
    builder.add(points)
    return builder.cloud()[0]


def turn_between(a: float, b: float) -> float:
    """Angle between two directions without sense, rad."""
    return abs((a - b + math.pi / 2) % math.pi - math.pi / 2)


def from_(points: np.ndarray, *places: tuple[float, float]) -> Voxels:
    """Voxels of the points, each seen from the mean of these places of the sensor."""
    cloud = voxels(points)
    sensor = np.tile(np.mean(places, axis=0), (len(cloud), 1))
    return voxels_of(cloud, sensor=sensor)


def together(*parts: Voxels) -> Voxels:
    """Voxels of several views."""
    names = Voxels.__dataclass_fields__
    return Voxels(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def side(
    rng: np.random.Generator,
    a: tuple[float, float],
    b: tuple[float, float],
    height_m: float = 0.5,
    sigma_m: float = 0.005,
) -> np.ndarray:
    """Noisy points (n, 3) on an upright face from a to b, 4000 per m^2."""
    start, step = np.array(a), np.subtract(b, a)
    n = int(np.linalg.norm(step) * height_m * 4000)
    points = np.empty((n, 3))
    points[:, :2] = start + rng.uniform(0, 1, (n, 1)) * step
    points[:, 2] = rng.uniform(0, height_m, n)
    return points + rng.normal(0, sigma_m, points.shape)


def floor_seen(where: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> FreeCells:
    """Cells of 5 cm from -3 to 5 m whose centre fulfils a condition on x and y."""
    x, y = np.meshgrid(np.arange(-2.975, 5.0, 0.05), np.arange(-2.975, 5.0, 0.05))
    return FreeCells(np.asarray(where(x, y), np.bool_), np.array([-3.0, -3.0]), 0.05)


def area_of(found: list[Footprint]) -> float:
    return sum(area(one.outline) for one in found)


def over(found: list[Footprint], free: FreeCells) -> float:
    return sum(abs(area(part)) for one in found for part in free.overlaps(one.outline))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-1.5, 1.5))
def test_a_box_seen_from_all_sides_has_its_size_at_any_pose(seed, yaw):
    rng = np.random.default_rng(seed)
    (found,) = find(voxels_of(voxels(placed(box(rng, (0.8, 0.45, 0.5)), 1.3, -0.7, yaw))))
    assert found.box is not None
    assert found.seen.all()
    assert found.box.length_m == pytest.approx(0.8, abs=0.025)
    assert found.box.width_m == pytest.approx(0.45, abs=0.025)
    assert found.height_m == pytest.approx(0.5, abs=0.02)
    assert turn_between(found.box.yaw_rad, yaw) < math.radians(2.0)  # a voxel over 0.45 m is 2.5
    np.testing.assert_allclose(found.box.centre, [1.3, -0.7], atol=0.015)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.0, -1.2])
def test_two_faces_give_the_whole_box_with_two_sides_unseen(yaw):
    points = placed(box(np.random.default_rng(1), (1.2, 0.6, 1.5), "front left"), 2.0, 1.0, yaw)
    camera = Pose2(2.0, 1.0, yaw).apply(np.array([-2.0, -2.0]))
    (found,) = find(from_(points, tuple(camera)))
    assert found.box is not None
    assert found.box.length_m == pytest.approx(1.2, abs=0.03)
    assert found.box.width_m == pytest.approx(0.6, abs=0.03)
    np.testing.assert_allclose(found.box.centre, [2.0, 1.0], atol=0.02)
    assert found.seen.sum() == 2
    assert np.isfinite(found.sigma_m[found.seen]).all()
    assert np.isnan(found.sigma_m[~found.seen]).all()
    assert math.isnan(found.box.sigma_length_m)


@pytest.mark.parametrize("towards", [-1.0, 1.0])
def test_a_box_seen_from_one_side_is_the_strip_that_was_seen(towards):
    points = side(np.random.default_rng(2), (0.0, 0.0), (1.0, 0.0))
    (found,) = find(from_(points, (0.5, 2.0 * towards)))
    assert (towards * found.outline[:, 1]).max() == pytest.approx(0.0, abs=0.01)
    assert np.ptp(found.outline[:, 0]) == pytest.approx(1.0, abs=0.04)
    assert np.ptp(found.outline[:, 1]) < 0.05  # nothing is known of its depth
    assert found.seen.sum() == 1


@pytest.mark.parametrize("slope", [-0.6, 0.0, 0.6])
def test_where_the_picture_ends_is_no_side_that_was_seen(slope):
    """The near part of a box is below the picture: its top ends at a line across it, its sides are elsewhere."""
    points = box(np.random.default_rng(5), (0.8, 0.5, 0.4), "top")
    points = points[points[:, 1] > slope * points[:, 0]]
    (found,) = find(from_(points, (0.0, -2.0)))
    for k in np.flatnonzero(found.seen):
        x, y = np.abs(found.outline[k] + found.outline[(k + 1) % len(found.outline)]) / 2
        assert min(abs(x - 0.4), abs(y - 0.25)) < 3.0 * found.sigma_m[k]


def test_two_walls_of_a_room_are_two_walls():
    rng = np.random.default_rng(3)
    walls = [side(rng, (0.0, 0.0), (2.0, 0.0)), side(rng, (0.0, 0.0), (0.0, 1.5))]
    room = floor_seen(lambda x, y: (x > 0.05) & (y > 0.05))
    found = find(from_(np.concatenate(walls), (1.2, 0.9)), free=room)
    assert len(found) == 2
    assert area_of(found) < 0.2  # their corner spans 1.5 m^2
    assert over(found, room) == 0.0


def test_two_faces_without_the_place_of_the_sensor_are_not_filled():
    points = box(np.random.default_rng(4), (1.2, 0.6, 0.5), "front left")
    assert area_of(find(voxels_of(voxels(points)))) < 0.25  # the box has 0.72 m^2


def test_a_niche_of_three_walls_stays_open():
    rng = np.random.default_rng(5)
    corners = [(0.0, 1.0), (0.0, 0.0), (1.5, 0.0), (1.5, 1.0)]
    walls = [side(rng, a, b) for a, b in pairwise(corners)]
    found = find(from_(np.concatenate(walls), (0.75, 0.8)))
    assert len(found) == 3
    assert not any(inside(one.outline, np.array([0.75, 0.5])) for one in found)


def test_a_cupboard_at_a_wall_is_parted_from_it():
    rng = np.random.default_rng(6)
    faces = [
        side(rng, (0.0, 0.0), (1.0, 0.0)),  # the wall left of it
        side(rng, (1.0, 0.0), (1.0, -0.4)),
        side(rng, (1.0, -0.4), (1.9, -0.4)),
    ]
    found = find(from_(np.concatenate(faces), (0.0, -2.0)))
    assert len(found) == 2
    cupboard = max(found, key=lambda one: area(one.outline))
    assert area(cupboard.outline) == pytest.approx(0.9 * 0.4, abs=0.05)


def test_a_round_column_seen_from_half_round_is_whole():
    rng = np.random.default_rng(7)
    angle, height = rng.uniform(np.pi, 2 * np.pi, 4000), rng.uniform(0, 0.5, 4000)
    points = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), height])
    (found,) = find(from_(points + rng.normal(0, 0.004, points.shape), (0.0, -2.0)))
    assert area(found.outline) == pytest.approx(np.pi * 0.2**2, rel=0.08)
    np.testing.assert_allclose(found.outline.mean(axis=0), [0, 0], atol=0.015)
    assert found.box is None
    middles = (found.outline + np.roll(found.outline, -1, axis=0)) / 2
    assert not found.seen[middles[:, 1] > 0.06].any()


def test_a_table_is_its_legs_if_the_floor_below_it_was_seen():
    rng = np.random.default_rng(8)
    legs = [
        placed(box(rng, (0.05, 0.05, 0.5), density=20000), x, y, 0.0)
        for x in (0.0, 1.0)
        for y in (0.0, 0.6)
    ]
    below = floor_seen(lambda x, y: (np.abs(x % 1.0 - 0.5) < 0.4) | (np.abs(y - 0.3) < 0.2))
    found = find(voxels_of(voxels(np.concatenate(legs))), free=below)
    assert len(found) == 4
    assert area_of(found) < 4 * 0.08**2
    assert over(found, below) == 0.0


def bed_and_night_stand(rng: np.random.Generator, colours: bool) -> Voxels:
    """A bed of 0.45 m and a night stand of 0.6 m side by side, seen from above their common front."""
    parts = []
    for (x0, x1, height), colour in (((0.0, 1.0, 0.45), 220.0), ((1.0, 1.4, 0.6), 90.0)):
        n = int((x1 - x0) * 0.5 * 8000)
        top = np.column_stack([rng.uniform(x0, x1, n), rng.uniform(0, 0.5, n), np.full(n, height)])
        front = side(rng, (x0, 0.0), (x1, 0.0), height)
        part = from_(np.concatenate([front, top + rng.normal(0, 0.003, top.shape)]), (0.7, -1.5))
        tint = np.full((len(part), 3), colour if colours else np.nan)
        parts.append(dataclasses.replace(part, colour=tint))
    return together(*parts)


def test_a_bed_and_its_night_stand_are_parted_by_height_and_colour():
    found = find(bed_and_night_stand(np.random.default_rng(9), colours=True))
    assert len(found) == 2
    tall = min(found, key=lambda one: area(one.outline))
    assert area(tall.outline) == pytest.approx(0.4 * 0.5, abs=0.04)
    assert tall.height_m == pytest.approx(0.6, abs=0.03)
    assert not any(one.several for one in found)


def test_a_bed_and_its_night_stand_without_colour_are_said_to_be_several():
    (found,) = find(bed_and_night_stand(np.random.default_rng(9), colours=False))
    assert found.several
    assert area(found.outline) == pytest.approx(1.4 * 0.5, abs=0.07)


def test_a_wall_with_a_door_is_two_walls():
    rng = np.random.default_rng(10)
    walls = [side(rng, (0.0, 0.0), (2.0, 0.0)), side(rng, (2.9, 0.0), (4.0, 0.0))]
    found = find(from_(np.concatenate(walls), (2.0, -2.0)))
    assert len(found) == 2
    assert not any(inside(one.outline, np.array([2.45, 0.005])) for one in found)


def test_a_thin_pole_is_found_and_thin():
    rng = np.random.default_rng(11)
    angle, height = rng.uniform(0, 2 * np.pi, 1500), rng.uniform(0, 0.5, 1500)
    points = np.column_stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), height])
    (found,) = find(voxels_of(voxels(points + rng.normal(0, 0.003, points.shape))))
    assert np.ptp(found.outline, axis=0).max() < 0.09
    assert inside(found.outline, np.array([0.0, 0.0]))


def test_what_was_there_in_few_of_the_frames_that_saw_its_place_has_no_footprint():
    standing = from_(side(np.random.default_rng(12), (0.0, 0.0), (0.6, 0.0)), (0.3, -2.0))
    gone = dataclasses.replace(standing, stay=np.full(len(standing), 0.2))
    there = dataclasses.replace(standing, stay=np.full(len(standing), 0.9))
    assert find(gone) == []
    assert len(find(there)) == 1


def test_floor_that_was_seen_is_cut_out_of_a_box_to_the_last_corner():
    points = placed(box(np.random.default_rng(13), (1.2, 0.8, 0.5), "front left"), 1.0, 1.0, 0.3)
    camera = Pose2(1.0, 1.0, 0.3).apply(np.array([-2.0, -2.0]))
    free = floor_seen(lambda x, y: (x > 1.2) & (y > 1.3))
    found = find(from_(points, tuple(camera)), free=free)
    assert area_of(found) > 0.5
    assert over(found, free) == 0.0


def test_a_single_free_cell_does_not_keep_a_box_from_being_one():
    points = box(np.random.default_rng(14), (1.0, 0.6, 0.5), "front left")
    speck = floor_seen(lambda x, y: (np.abs(x - 0.125) < 0.02) & (np.abs(y - 0.075) < 0.02))
    (found,) = find(from_(points, (-2.0, -2.0)), free=speck)
    assert found.box is not None
    assert area(found.outline) > 0.9 * 0.6
    assert over([found], speck) == 0.0


def test_sides_lie_within_their_deviation_over_seeds():
    """Faces displaced by a bias of EDGE_SIGMA_M, as in fused depth, and by the doubt of the pose."""
    rng = np.random.default_rng(15)
    errors = []
    for _ in range(40):
        yaw, drift = rng.uniform(-1.5, 1.5), rng.normal(0, 0.02, 2)
        bias = rng.normal(0, EDGE_SIGMA_M, 2)
        front = box(rng, (0.8, 0.45 + 2 * bias[0], 0.5), "front")
        left = box(rng, (0.8 + 2 * bias[1], 0.45, 0.5), "left")
        there = Pose2(1.0 + float(drift[0]), 2.0 + float(drift[1]), yaw)
        points = there.lifted().apply(np.concatenate([front, left]))
        seen = from_(points, tuple(there.apply(np.array([-2.0, -2.0]))))
        seen = dataclasses.replace(seen, pose_variance=np.full(len(seen), 0.02**2))
        (found,) = find(seen)
        local = Pose2(1.0, 2.0, yaw).inverse().apply(found.outline)
        for k in np.flatnonzero(found.seen):
            a, b = local[k], local[(k + 1) % len(local)]
            along = int(np.argmax(np.abs(b - a)))
            true = (-0.4, -0.225)[1 - along]
            errors.append(((a + b)[1 - along] / 2 - true) / found.sigma_m[k])
    assert len(errors) == 80
    assert 0.6 < np.mean(np.square(errors)) < 1.5
    assert np.mean(np.abs(errors) < 2.0) > 0.9


def test_a_face_displaced_in_some_frames_does_not_move_the_side():
    rng = np.random.default_rng(2)
    points = box(rng, (0.8, 0.45, 0.5))
    stray = points[rng.choice(len(points), 120, replace=False)] + rng.normal(0, 1, (120, 3)) * [
        0.04,
        0.04,
        0,
    ]
    flying = rng.uniform([0.3, -0.2, 0.1], [1.5, 0.2, 0.5], (25, 3))  # behind the silhouette
    layer = box(rng, (0.88, 0.1, 0.3), "right")  # a third of one face, 4 cm out, in one frame
    (found,) = find(voxels_of(voxels(np.concatenate([points, stray, flying, layer]))))
    assert found.box is not None
    assert found.box.length_m == pytest.approx(0.8, abs=0.05)
    assert found.box.width_m == pytest.approx(0.45, abs=0.05)


def test_obstacles_separate_at_wide_gaps():
    rng = np.random.default_rng(3)
    a = placed(box(rng, (0.3, 0.2, 0.3)), 0.0, 0.0, 0.0)
    b = placed(box(rng, (0.3, 0.2, 0.3)), 0.0, 0.35, 0.0)  # 15 cm of floor between
    assert len(find(voxels_of(voxels(np.concatenate([a, b]))))) == 2


def test_floor_misclassified_as_obstacle_is_separated_from_the_obstacle_it_touches():
    rng = np.random.default_rng(4)
    cabinet = box(rng, (0.8, 0.45, 0.5))
    floor = rng.uniform([0.2, -0.6, 0.05], [1.6, 0.6, 0.08], (6000, 3))
    found = find(voxels_of(voxels(np.concatenate([cabinet, floor]))))
    tall = max(found, key=lambda one: one.height_m)
    assert tall.box is not None
    assert tall.box.length_m == pytest.approx(0.8, abs=0.04)
    assert tall.box.width_m == pytest.approx(0.45, abs=0.04)
    assert all(one.height_m < 0.1 for one in found if one is not tall)


def test_the_order_of_points_does_not_matter():
    rng = np.random.default_rng(7)
    points = voxels(
        np.concatenate(
            [box(rng, (0.8, 0.45, 0.5)), placed(box(rng, (0.3, 0.2, 0.3)), 2.0, 1.0, 0.3)]
        )
    )
    straight = find(voxels_of(points))
    shuffled = find(voxels_of(points[rng.permutation(len(points))]))
    assert len(straight) == len(shuffled) == 2
    for a, b in zip(straight, shuffled, strict=True):
        np.testing.assert_allclose(a.outline, b.outline, atol=1e-9)


def test_outliers_alone_are_no_obstacle():
    rng = np.random.default_rng(8)
    assert find(voxels_of(np.zeros((0, 3)))) == []
    assert find(voxels_of(np.full((50, 3), np.nan))) == []
    assert find(voxels_of(rng.uniform(-3, 3, (150, 3)))) == []


def test_points_within_the_noise_of_the_floor_are_no_obstacle():
    rng = np.random.default_rng(16)
    layer = voxels_of(voxels(rng.uniform([0.0, 0.0, 0.02], [1.0, 0.5, 0.06], (4000, 3))))
    noisy = dataclasses.replace(layer, noise_variance=np.full(len(layer), 0.03**2))
    assert find(noisy) == []
    assert find(layer) != []


def test_voxels_seen_once_beside_a_well_seen_obstacle_are_outliers():
    rng = np.random.default_rng(9)
    points = voxels(box(rng, (0.8, 0.45, 0.5)))
    ghost = voxels(box(rng, (0.94, 0.45, 0.5), "right"))  # the same face, 7 cm out, in one frame
    both = np.concatenate([points, ghost])
    often = np.repeat([9, 1], [len(points), len(ghost)])
    (found,) = find(voxels_of(both, often))
    assert found.box is not None
    assert found.box.length_m == pytest.approx(0.8, abs=0.025)
    assert found.points <= len(points)


def test_a_single_frame_is_enough_for_a_footprint():
    points = voxels(box(np.random.default_rng(9), (0.8, 0.45, 0.5)))
    (found,) = find(voxels_of(points, np.ones(len(points), np.int64)))
    assert found.box is not None
    assert found.box.length_m == pytest.approx(0.8, abs=0.025)


def test_bad_input_is_refused_with_its_reason():
    with pytest.raises(ConfigError, match=r"gap_m=0\.01 must be at least 0\.02"):
        FootprintConfig(gap_m=0.01)
    with pytest.raises(ConfigError, match="least_points=2"):
        FootprintConfig(least_points=2)


# The cabinet of a real recording: 38 frames of depth, poses by motion capture.


def cabinet_cloud(folder: Path, stride: int = 1) -> CloudBuilder:
    """Fused points of the frames between 5 cm and 1 m above the floor, given poses."""
    cloud = CloudBuilder(CloudConfig(voxel_m=0.02))
    v, u = np.mgrid[0:480:stride, 0:640:stride]
    for k, row in enumerate(np.loadtxt(folder / "groundtruth.txt")):
        image = cv2.imread(str(folder / "depth" / f"{k:04d}.png"), cv2.IMREAD_UNCHANGED)
        z = image[::stride, ::stride] / 5000.0
        seen = (z > 0.3) & (z < 4.0)
        camera = np.stack([(u - 320.1) / 535.4 * z, (v - 247.6) / 539.2 * z, z], axis=-1)[seen]
        world = Pose3(tuple(row[1:4].tolist()), tuple(row[4:8].tolist())).apply(camera)
        cloud.add(world[(world[:, 2] > 0.05) & (world[:, 2] < 1.0)])
    return cloud


@pytest.fixture(scope="module")
def cabinet(recordings: Path) -> CloudBuilder:
    return cabinet_cloud(recordings / "tum_fr3_cabinet", stride=2)


def assert_is_the_cabinet(found: Footprint, recordings: Path) -> None:
    footprint = found.box
    assert footprint is not None
    truth = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")
    x, y, _, yaw, half_length, half_width, half_height = truth
    assert footprint.length_m == pytest.approx(2 * half_length, abs=0.05)
    assert footprint.width_m == pytest.approx(2 * half_width, abs=0.05)
    assert found.height_m == pytest.approx(2 * half_height, abs=0.05)
    assert turn_between(footprint.yaw_rad, yaw) < math.radians(
        3.0
    )  # the file is good to 2 cm in 0.79 m
    np.testing.assert_allclose(footprint.centre, [x, y], atol=0.03)


def near_the_cabinet(footprints: list[Footprint], recordings: Path) -> list[Footprint]:
    """Footprints with their centre in the cabinet or within half a metre of it."""
    x, y = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")[:2]
    return [f for f in footprints if np.linalg.norm(f.outline.mean(axis=0) - [x, y]) < 0.9]


def test_the_cabinet_is_one_obstacle_of_its_size(cabinet, recordings):
    footprints = find(voxels_of(cabinet.cloud()[0], cabinet.sightings))
    (footprint,) = near_the_cabinet(footprints, recordings)
    assert_is_the_cabinet(footprint, recordings)


def test_the_cabinet_keeps_its_size_without_sightings(cabinet, recordings):
    points = cabinet.cloud()[0]
    footprint = find(voxels_of(points[points[:, 2] > 0.1]))[0].box
    assert footprint is not None
    truth = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")
    assert footprint.length_m == pytest.approx(2 * truth[4], abs=0.05)
    assert footprint.width_m == pytest.approx(2 * truth[5], abs=0.05)
