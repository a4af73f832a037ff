"""Alignment of two synthetic images of a corner, against the motion they were rendered with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.depth import structured_light
from perception.depth.distortion import Distortion
from perception.odometry.alignment import AlignConfig, align
from perception.odometry.hypotheses import rotation_starts
from perception.odometry.pyramid import Pyramid, build, compress, downsampled
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth, DepthView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3

from .walls import looked_at

CAMERA = Camera(320, 240, 262.0, 262.0, 159.5, 119.5)
WALLS = np.array(  # n.p = d for points in space, world axes as the first camera's
    [[0.0, 0.0, 1.0, 2.5], [0.8, 0.0, 0.6, 2.0], [0.0, 1.0, 0.0, 0.9], [-1.0, 0.0, 0.1, 1.4]]
)


def seen(
    pose: Pose3, rng: np.random.Generator | None = None, camera: Camera = CAMERA
) -> tuple[Depth, np.ndarray]:
    """Depth and colour image of four patterned walls, from a pose between them."""
    z, spots = looked_at(WALLS, pose, camera)
    light = np.sin(6 * spots[..., 0]) + np.sin(7 * spots[..., 1]) + np.sin(5 * spots[..., 2] + 1.0)
    if rng is not None:
        z = z + rng.standard_normal(z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    rgb = np.repeat((128.0 + 40.0 * light)[..., None], 3, axis=2).astype(np.uint8)
    return structured_light.depth(DepthView(z.astype(np.float32), camera)), rgb


def image(
    pose: Pose3,
    rng: np.random.Generator | None = None,
    grey: bool = True,
    distortion: Distortion | None = None,
) -> Pyramid:
    depth, rgb = seen(pose, rng)
    return build(depth, rgb if grey else None, distortion=distortion)


def moved(along: tuple[float, float, float], turn_deg: tuple[float, float, float]) -> Pose3:
    R = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    return Pose3.from_rotation(R, np.array(along))


def error(found: Pose3, true: Pose3) -> tuple[float, float]:
    off = true.inverse() @ found
    return float(np.linalg.norm(off.position)), float(
        np.degrees(Rotation.from_matrix(off.rotation).magnitude())
    )


@pytest.mark.parametrize("method", ["hybrid", "depth"])
def test_a_small_motion_is_estimated_to_two_millimetres(method: str) -> None:
    true = moved((0.03, -0.02, 0.05), (1.0, -2.0, 0.5))
    found = align(image(Pose3()), image(true), config=AlignConfig(method=method))
    assert found is not None
    metres, degrees = error(found.motion, true)
    assert metres < 2e-3
    assert degrees < 0.05
    assert found.fitting > 0.97
    assert found.contradicting < 0.01


def test_errors_by_depth_noise_agree_with_the_covariance() -> None:
    rng = np.random.default_rng(5)
    distances = []
    for _ in range(20):
        true = moved(tuple(rng.normal(0.0, 0.03, 3)), tuple(rng.normal(0.0, 1.5, 3)))
        plain = Distortion()
        found = align(image(Pose3(), rng, distortion=plain), image(true, rng, distortion=plain))
        assert found is not None
        off = found.motion.rotation @ true.rotation.T
        e = np.append(found.motion.position - true.position, Rotation.from_matrix(off).as_rotvec())
        distances.append(e @ np.linalg.solve(found.covariance, e))
    # chi-square with 6 degrees of freedom: 6 on average; overconfidence must not happen
    assert 0.3 < np.mean(distances) < 12.0


def test_errors_by_depth_distortion_of_image_regions_agree_with_the_covariance() -> None:
    rng = np.random.default_rng(6)
    v, u = np.mgrid[0 : 1 : CAMERA.height * 1j, 0 : 1 : CAMERA.width * 1j]
    without, bent = [], []
    for _ in range(12):
        bend = sum(  # waves half an image long or more, 1 % together, the same for both images
            rng.normal(0.0, 0.01 / 2.0) * np.cos(2 * np.pi * (a * u + b * v) + rng.uniform(0, 6.3))
            for a, b in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (1, -1), (2, 1), (1, 2))
        )
        true = moved(tuple(rng.normal(0.0, 0.05, 3)), tuple(rng.normal(0.0, 5.0, 3)))
        shots = []
        for pose in (Pose3(), true):
            depth, rgb = seen(pose, rng)
            z = (depth.z * (1.0 + bend)).astype(np.float32)
            shots.append((structured_light.depth(DepthView(z, CAMERA)), rgb))
        for distortion, squares in ((Distortion(), without), (Distortion(share=0.01), bent)):
            pair = [build(depth, rgb, distortion=distortion) for depth, rgb in shots]
            found = align(pair[0], pair[1], [true])
            assert found is not None
            turn = Rotation.from_matrix(found.motion.rotation @ true.rotation.T).as_rotvec()
            e = np.append(found.motion.position - true.position, turn)
            squares.append(e @ np.linalg.solve(found.covariance, e))
    # 6 on average if consistent; twelve pairs and waves instead of patches leave a factor of three
    assert np.mean(bent) < 18.0
    assert np.mean(without) > 2.0 * np.mean(bent)


def test_a_large_rotation_is_found_from_rotated_starts() -> None:
    true = moved((0.05, 0.0, 0.1), (0.0, 24.0, 0.0))
    first, second = image(Pose3()), image(true)
    found = align(first, second, [Pose3(), *rotation_starts(first, Pose3())])
    assert found is not None
    metres, degrees = error(found.motion, true)
    assert metres < 3e-3
    assert degrees < 0.1


def test_a_change_of_exposure_hardly_changes_the_motion() -> None:
    true = moved((0.03, 0.0, 0.02), (0.0, 1.0, 0.0))
    depth, rgb = seen(true)
    darker = build(depth, np.maximum(rgb.astype(int) - 12, 0).astype(np.uint8))
    found = align(image(Pose3()), darker)
    assert found is not None
    assert error(found.motion, true)[0] < 3e-3


def test_a_single_wall_without_colour_is_not_aligned() -> None:
    """It does not determine the motion along it."""
    wall = np.full((240, 320), 1.5, np.float32)
    depth = structured_light.depth(DepthView(wall, CAMERA))
    assert align(build(depth), build(depth)) is None


def test_images_without_overlap_are_not_aligned() -> None:
    nothing = np.full((240, 320), np.nan, np.float32)
    empty = build(structured_light.depth(DepthView(nothing, CAMERA)))
    assert align(image(Pose3()), empty) is None
    assert align(empty, image(Pose3())) is None


def test_downsampled_intrinsics_project_to_the_same_points() -> None:
    half = downsampled(CAMERA, 2)
    point = np.array([[0.3, -0.2, 1.7]])
    u, v = CAMERA.project(point)[0]
    small_u, small_v = half.project(point)[0]
    assert small_u == pytest.approx((u - 0.5) / 2)
    assert small_v == pytest.approx((v - 0.5) / 2)


def test_planes_fitted_to_a_noise_free_wall_are_exact() -> None:
    depth, _ = seen(Pose3())
    packed = build(depth).levels[0].packed
    v, u = 120, 60
    ray = CAMERA.rays[v, u]
    point = ray * depth.z[v, u]
    nearest = min(WALLS, key=lambda wall: abs(wall[:3] @ point - wall[3]))
    truth = nearest[:3] / np.linalg.norm(nearest[:3])
    assert packed[v, u, :3] == pytest.approx(truth, abs=2e-4)
    assert packed[v, u, 3] == pytest.approx(nearest[3] / np.linalg.norm(nearest[:3]), abs=1e-3)


def test_overlap_counts_only_pixels_off_the_floor() -> None:
    depth, rgb = seen(Pose3())
    floor = Plane(np.array([0.0, -1.0, 0.0]), 0.9)
    counts = build(depth, rgb, floor).levels[0].counts
    on_floor = np.abs(CAMERA.rays[..., 1] * depth.z - 0.9) < 0.01
    assert not counts[on_floor].any()
    assert counts[:100].all()


def test_a_compressed_image_is_restored_to_a_tenth_of_a_millimetre() -> None:
    first = image(Pose3(), np.random.default_rng(1))
    again = compress(first).pyramid()
    a, b = first.levels[0], again.levels[0]
    assert np.array_equal(np.isfinite(a.z), np.isfinite(b.z))
    assert np.nanmax(np.abs(a.z - b.z)) < 1.1e-4
    assert np.max(np.abs(a.grey - b.grey)) <= 1.0


def test_lens_distortion_is_removed_before_alignment() -> None:
    bent = Camera(320, 240, 262.0, 262.0, 159.5, 119.5, (-0.15, 0.04, 0.0, 0.0, 0.0))
    true = moved((0.03, -0.01, 0.04), (0.5, -1.0, 0.0))
    views = [build(*seen(pose, None, bent)) for pose in (Pose3(), true)]
    found = align(*views)
    assert found is not None
    assert error(found.motion, true)[0] < 3e-3


def test_wrong_image_sizes_and_methods_are_refused() -> None:
    depth, rgb = seen(Pose3())
    with pytest.raises(InputError, match="register"):
        build(depth, rgb[:100])
    with pytest.raises(ConfigError, match="method"):
        AlignConfig(method="icp")


def test_a_start_that_is_not_a_number_leads_to_no_motion() -> None:
    nowhere = Pose3((np.nan, np.nan, np.nan))
    assert align(image(Pose3()), image(Pose3()), [nowhere]) is None
