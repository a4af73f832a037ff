"""Footprints of generated boxes and of a measured cabinet."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.io.clouds import CloudBuilder, CloudConfig
from mapping.objects.footprints import EDGE_SIGMA_M, Footprint, FootprintConfig, find
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


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(-1.5, 1.5), st.booleans())
def test_a_box_has_its_size_at_any_pose(seed, yaw, whole):
    rng = np.random.default_rng(seed)
    size = (0.8, 0.45, 0.5)
    faces = "front back left right top" if whole else "front left top"
    footprint, *others = find(voxels(placed(box(rng, size, faces), 1.3, -0.7, yaw)))
    assert not others
    # Two layers of voxels on either side of each face: half a voxel of 2 cm an edge.
    assert footprint.length_m == pytest.approx(0.8, abs=0.025)
    assert footprint.width_m == pytest.approx(0.45, abs=0.025)
    assert footprint.height_m == pytest.approx(0.5, abs=0.02)
    assert turn_between(footprint.yaw_rad, yaw) < math.radians(2.0)  # a voxel over 0.45 m is 2.5
    np.testing.assert_allclose(footprint.centre, [1.3, -0.7], atol=0.015)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.0, -1.2])
def test_two_faces_of_an_obstacle_above_the_camera_give_its_whole_footprint(yaw):
    points = box(np.random.default_rng(1), (1.2, 0.6, 1.5), "front left", density=2000)
    (footprint,) = find(voxels(placed(points, 2.0, 1.0, yaw)))
    assert footprint.length_m == pytest.approx(1.2, abs=0.03)
    assert footprint.width_m == pytest.approx(0.6, abs=0.03)
    np.testing.assert_allclose(footprint.centre, [2.0, 1.0], atol=0.02)


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
    (footprint,) = find(voxels(np.concatenate([points, stray, flying, layer])))
    assert footprint.length_m == pytest.approx(0.8, abs=0.05)
    assert footprint.width_m == pytest.approx(0.45, abs=0.05)


def test_obstacles_separate_at_wide_gaps_and_join_at_narrow_ones():
    rng = np.random.default_rng(3)
    a = placed(box(rng, (0.3, 0.2, 0.3)), 0.0, 0.0, 0.0)
    b = placed(box(rng, (0.3, 0.2, 0.3)), 0.0, 0.35, 0.0)  # 15 cm of floor between
    c = placed(box(rng, (0.3, 0.2, 0.3)), 0.0, 0.25, 0.0)  # 5 cm
    assert len(find(voxels(np.concatenate([a, b])))) == 2
    assert len(find(voxels(np.concatenate([a, c])))) == 1


def test_floor_misclassified_as_obstacle_is_separated_from_the_obstacle_it_touches():
    rng = np.random.default_rng(4)
    cabinet = box(rng, (0.8, 0.45, 0.5))
    floor = rng.uniform([0.2, -0.6, 0.05], [1.6, 0.6, 0.08], (6000, 3))
    footprint, skirt = find(voxels(np.concatenate([cabinet, floor])))
    if footprint.height_m < skirt.height_m:
        footprint, skirt = skirt, footprint
    assert footprint.length_m == pytest.approx(0.8, abs=0.04)
    assert footprint.width_m == pytest.approx(0.45, abs=0.04)
    assert skirt.height_m < 0.1


def test_the_covariance_covers_the_error_of_the_centre():
    # Faces displaced by a random bias of EDGE_SIGMA_M, as in fused depth.
    rng = np.random.default_rng(5)
    distances = []
    for _ in range(60):
        yaw = rng.uniform(-1.5, 1.5)
        bias = rng.normal(0, EDGE_SIGMA_M, 4)
        size = (0.8 + bias[0] + bias[1], 0.45 + bias[2] + bias[3], 0.5)
        middle = Pose2(1.0, 2.0, yaw).apply(np.array([bias[0] - bias[1], bias[2] - bias[3]]) / 2)
        (footprint,) = find(voxels(placed(box(rng, size, density=2500), *middle, yaw)))
        error = footprint.centre - [1.0, 2.0]
        distances.append(error @ np.linalg.solve(footprint.covariance, error))
    assert 0.5 < np.mean(distances) / 2 < 1.5  # normalised error squared, two degrees of freedom


def test_a_cylinder_has_its_diameter_as_length_and_width():
    rng = np.random.default_rng(6)
    angle, height = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(0, 0.4, 6000)
    points = np.column_stack([0.15 * np.cos(angle), 0.15 * np.sin(angle), height])
    (footprint,) = find(voxels(points + rng.normal(0, 0.004, points.shape)))
    assert footprint.length_m == pytest.approx(0.30, abs=0.05)
    assert footprint.width_m == pytest.approx(0.30, abs=0.05)
    np.testing.assert_allclose(footprint.centre, [0, 0], atol=0.01)


def test_the_order_of_points_does_not_matter():
    rng = np.random.default_rng(7)
    points = voxels(
        np.concatenate(
            [box(rng, (0.8, 0.45, 0.5)), placed(box(rng, (0.3, 0.2, 0.3)), 2.0, 1.0, 0.3)]
        )
    )
    straight, shuffled = find(points), find(points[rng.permutation(len(points))])
    assert len(straight) == len(shuffled) == 2
    for a, b in zip(straight, shuffled, strict=True):
        np.testing.assert_allclose(a.centre, b.centre, atol=1e-9)
        assert a.length_m == pytest.approx(b.length_m, abs=1e-9)


def test_outliers_alone_are_no_obstacle():
    rng = np.random.default_rng(8)
    assert find(np.zeros((0, 3))) == []
    assert find(np.full((50, 3), np.nan)) == []
    assert find(rng.uniform(-3, 3, (150, 3))) == []


def test_voxels_seen_once_beside_a_well_seen_obstacle_are_outliers():
    rng = np.random.default_rng(9)
    points = voxels(box(rng, (0.8, 0.45, 0.5)))
    ghost = voxels(box(rng, (0.94, 0.45, 0.5), "right"))  # the same face, 7 cm out, in one frame
    both = np.concatenate([points, ghost])
    often = np.repeat([9, 1], [len(points), len(ghost)])
    (footprint,) = find(both, sightings=often)
    assert footprint.length_m == pytest.approx(0.8, abs=0.025)
    assert footprint.points <= len(points)


def test_a_single_frame_is_enough_for_a_footprint():
    points = voxels(box(np.random.default_rng(9), (0.8, 0.45, 0.5)))
    (footprint,) = find(points, sightings=np.ones(len(points), np.int64))
    assert footprint.length_m == pytest.approx(0.8, abs=0.025)


def test_bad_configurations_are_refused_with_their_reason():
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


def assert_is_the_cabinet(footprint: Footprint, recordings: Path) -> None:
    truth = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")
    x, y, _, yaw, half_length, half_width, half_height = truth
    assert footprint.length_m == pytest.approx(2 * half_length, abs=0.05)
    assert footprint.width_m == pytest.approx(2 * half_width, abs=0.05)
    assert footprint.height_m == pytest.approx(2 * half_height, abs=0.05)
    assert turn_between(footprint.yaw_rad, yaw) < math.radians(
        3.0
    )  # the file is good to 2 cm in 0.79 m
    np.testing.assert_allclose(footprint.centre, [x, y], atol=0.03)


def near_the_cabinet(footprints: list[Footprint], recordings: Path) -> list[Footprint]:
    """Footprints with their centre in the cabinet or within half a metre of it."""
    x, y = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")[:2]
    return [f for f in footprints if np.linalg.norm(f.centre - [x, y]) < 0.9]


def test_the_cabinet_is_one_obstacle_of_its_size(cabinet, recordings):
    footprints = find(cabinet.cloud()[0], sightings=cabinet.sightings)
    (footprint,) = near_the_cabinet(footprints, recordings)
    assert_is_the_cabinet(footprint, recordings)


def test_the_cabinet_keeps_its_size_without_sightings(cabinet, recordings):
    points = cabinet.cloud()[0]
    footprint = find(points[points[:, 2] > 0.1])[0]
    truth = np.loadtxt(recordings / "tum_fr3_cabinet" / "truth_objects.txt")
    assert footprint.length_m == pytest.approx(2 * truth[4], abs=0.05)
    assert footprint.width_m == pytest.approx(2 * truth[5], abs=0.05)
