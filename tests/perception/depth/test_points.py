"""Back-projection against `Camera.rays`, with missing and invalid depth."""

from __future__ import annotations

import numpy as np
import pytest

from perception.depth.points import from_depth, organised
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.frame import Depth

PINHOLE = Camera(31, 23, 30.0, 33.0, 14.2, 11.9)
BENT = Camera(31, 23, 30.0, 33.0, 14.2, 11.9, (-0.28, 0.07, 0.0002, 0.0001, 0.0))


def image(camera, seed=0):
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.2, 5.0, (camera.height, camera.width)).astype(np.float32)
    z[rng.random(z.shape) < 0.2] = np.nan
    return Depth(z, (0.01 * z).astype(np.float32), camera)


@pytest.mark.parametrize("camera", [PINHOLE, BENT])
def test_points_equal_back_projected_pixels(camera):
    depth = image(camera)
    points = from_depth(depth, 0.0, 10.0)
    v, u = np.divmod(points.pixels, camera.width)
    z = depth.z[v, u].astype(np.float64)
    expected = camera.back_project(np.stack([u, v], axis=-1).astype(np.float64), z)
    np.testing.assert_allclose(points.xyz, expected, atol=1e-9)
    np.testing.assert_allclose(points.sigma, depth.sigma[v, u])
    np.testing.assert_array_equal(points.pixels, np.flatnonzero(np.isfinite(depth.z)))
    np.testing.assert_allclose(camera.project(points.xyz), np.stack([u, v], axis=-1), atol=1e-6)


@pytest.mark.parametrize("camera", [PINHOLE, BENT])
def test_the_organised_cloud_holds_the_same_points(camera):
    depth = image(camera)
    cloud = organised(depth)
    points = from_depth(depth, 0.0, 10.0)
    np.testing.assert_allclose(cloud.reshape(-1, 3)[points.pixels], points.xyz, atol=1e-5)
    assert np.array_equal(np.isnan(cloud[..., 0]), np.isnan(depth.z))
    kept = np.empty_like(cloud)
    assert organised(depth, kept) is kept
    np.testing.assert_array_equal(kept, cloud)


def test_ray_slopes_broadcast_to_the_cameras_rays():
    for camera in (PINHOLE, BENT):
        x, y = camera.slopes
        shape = (camera.height, camera.width)
        np.testing.assert_allclose(np.broadcast_to(x, shape), camera.rays[..., 0], atol=1e-12)
        np.testing.assert_allclose(np.broadcast_to(y, shape), camera.rays[..., 1], atol=1e-12)


def test_only_valid_depth_within_the_range_becomes_points():
    z = np.array([[0.5, np.nan, 2.0], [np.inf, 3.0, 0.0], [1.0, 1.0, -1.0]], dtype=np.float32)
    sigma = np.full((3, 3), 0.01, dtype=np.float32)
    sigma[2, 0], sigma[2, 1] = np.nan, 0.0
    depth = Depth(z, sigma, Camera(3, 3, 3.0, 3.0, 1.0, 1.0))
    np.testing.assert_array_equal(from_depth(depth, 0.1, 2.5).pixels, [0, 2])
    empty = from_depth(depth, 5.0, 6.0)
    assert len(empty) == 0
    assert empty.xyz.shape == (0, 3)


def test_a_stride_of_three_takes_every_third_row_and_column():
    depth = image(PINHOLE)
    v, u = np.divmod(from_depth(depth, 0.0, 10.0, stride=3).pixels, PINHOLE.width)
    assert set(v % 3) == {0}
    assert set(u % 3) == {0}
    assert len(v) == np.isfinite(depth.z[::3, ::3]).sum()


def test_invalid_input_is_refused_with_a_message():
    depth = image(PINHOLE)
    with pytest.raises(InputError, match="nearest_m=2"):
        from_depth(depth, 2.0, 1.0)
    with pytest.raises(InputError, match="stride=0"):
        from_depth(depth, 0.1, 1.0, 0)
    wrong = Depth(depth.z, depth.sigma, Camera(32, 23, 30.0, 33.0, 14.2, 11.9))
    with pytest.raises(InputError, match="check the intrinsics"):
        from_depth(wrong, 0.1, 1.0)
    with pytest.raises(InputError, match="check the intrinsics"):
        organised(wrong)
    with pytest.raises(InputError, match=r"out is \(23, 30, 3\)"):
        organised(depth, np.empty((23, 30, 3), np.float32))
