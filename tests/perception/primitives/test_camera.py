"""Projection and back-projection, compared with OpenCV."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError

STRAIGHT = Camera(320, 240, 277.0, 280.0, 158.3, 121.7)
BENT = Camera(320, 240, 277.0, 280.0, 158.3, 121.7, (-0.28, 0.09, 0.001, -0.0015, -0.01))
MILD = Camera(640, 480, 525.0, 520.0, 319.5, 239.5, (0.05, -0.12, 0.0005, 0.0007, 0.03))

TOF = Camera(  # an Azure Kinect's depth camera, 640x576: Azure-Kinect-Sensor-SDK issue 1617
    640, 576, 503.84, 503.74, 321.01, 328.48,
    (4.72473669, 3.20922279, 5.8798e-6, 1.23821e-4, 0.17059645, 5.05585957, 4.7757802, 0.88649416),
)  # fmt: skip
KINECT = Camera(  # its colour camera, 1280x960
    1280, 960, 613.02, 612.94, 648.1, 493.5,
    (0.40386343, -2.60288429, 8.9408e-4, -4.1652e-5, 1.5118779, 0.28427526, -2.42072129, 1.43543446),
)  # fmt: skip

KITTI = Camera(  # the raw grey camera on the left, 2011-09-26; its radius stops growing at 50 deg
    1392, 512, 984.2, 980.8, 690.0, 233.2,
    (-0.3728755, 0.2037299, 2.219027e-3, 1.383707e-3, -0.07233722),
)  # fmt: skip


def points_before(camera: Camera, seed: int, n: int = 200) -> np.ndarray:
    """Points that fall on the image of the distortion-free camera, 0.2 to 6 m away."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.2, 6.0, n)
    u = rng.uniform(0, camera.width - 1, n)
    v = rng.uniform(0, camera.height - 1, n)
    x = (u - camera.cx) / camera.fx * 0.8
    y = (v - camera.cy) / camera.fy * 0.8
    return np.stack([x * z, y * z, z], axis=-1)


@pytest.mark.parametrize("camera", [STRAIGHT, BENT, MILD, TOF, KINECT])
def test_projection_agrees_with_opencv(camera):
    points = points_before(camera, 1)
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    np.testing.assert_allclose(camera.project(points), theirs.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("camera", [STRAIGHT, BENT, MILD, TOF, KINECT])
@given(seed=st.integers(0, 2**32 - 1))
def test_back_projection_inverts_projection(camera, seed):
    points = points_before(camera, seed, 20)
    again = camera.back_project(camera.project(points), points[:, 2])
    np.testing.assert_allclose(again, points, atol=1e-9)


@pytest.mark.parametrize("camera", [STRAIGHT, BENT, TOF])
def test_the_ray_table_is_the_back_projection_of_every_pixel_at_one_metre(camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
    expected = camera.back_project(np.stack([u, v], axis=-1), np.ones_like(u))
    np.testing.assert_allclose(camera.rays, expected, atol=1e-12)
    assert camera.rays is camera.rays  # formed once
    assert not camera.rays.flags.writeable


def test_undistorting_agrees_with_opencv_near_the_corner_of_the_image(undistort):
    corner = np.array([[2.0, 3.0]])
    theirs = undistort(
        corner.reshape(1, 1, 2),
        BENT.matrix,
        np.array(BENT.distortion),
        None,
        None,
        (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14),
    ).reshape(2)
    ours = BENT.back_project(corner, np.ones(1))[0, :2]
    np.testing.assert_allclose(ours, theirs, atol=1e-8)


@pytest.mark.parametrize("camera", [TOF, KINECT])
def test_the_rays_of_a_rational_lens_agree_with_opencv_in_every_pixel(camera):
    seen, _ = cv2.projectPoints(
        camera.rays.reshape(-1, 3),
        np.zeros(3),
        np.zeros(3),
        camera.matrix,
        np.array(camera.distortion),
    )
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    np.testing.assert_allclose(seen.reshape(-1, 2), np.stack([u, v], -1).reshape(-1, 2), atol=1e-6)


def test_a_point_behind_the_camera_has_no_pixel():
    pixels = STRAIGHT.project(np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.all(np.isnan(pixels[:2]))
    np.testing.assert_allclose(pixels[2], [STRAIGHT.cx, STRAIGHT.cy])


def test_missing_depth_stays_missing():
    point = STRAIGHT.back_project(np.array([[10.0, 10.0]]), np.array([np.nan]))
    assert np.all(np.isnan(point))


def test_the_image_ends_half_a_pixel_beyond_its_outer_pixel_centres():
    inside = STRAIGHT.contains(
        np.array([[-0.5, -0.5], [319.5, 239.5], [-0.51, 0.0], [0.0, 239.6], [np.nan, 3.0]])
    )
    assert inside.tolist() == [True, True, False, False, False]


@given(st.floats(0.3, 2.2), st.floats(0.3, 2.2))
def test_the_field_of_view_reaches_from_edge_to_edge(across, down):
    camera = Camera.from_view(320, 240, across, down)
    left, right = camera.back_project(np.array([[-0.5, 119.5], [319.5, 119.5]]), np.ones(2))
    assert math.isclose(math.atan(right[0]) - math.atan(left[0]), across, abs_tol=1e-9)
    top, bottom = camera.back_project(np.array([[159.5, -0.5], [159.5, 239.5]]), np.ones(2))
    assert math.isclose(math.atan(bottom[1]) - math.atan(top[1]), down, abs_tol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "at least 1x1"),
        ({"fx": -5.0}, "fx=-5.0 px must be positive"),
        ({"fy": math.nan}, "fy=nan px must be positive"),
        ({"cx": 5000.0}, "cx=5000.0 px lies far outside"),
        ({"cy": math.inf}, "cy=inf px lies far outside"),
        ({"distortion": (0.1, 0.2, 0.0, 0.0)}, r"distortion=\(0.1, .* must be 5 finite numbers"),
        ({"distortion": (0.1, 0.0, 0.0, 0.0, math.nan)}, "nan.* must be 5 finite .* or 8"),
        ({"distortion": (0.1, 1e300, 0.0, 0.0, 0.0)}, "1e[+]300.* none beyond 1e[+]06"),
    ],
)
def test_invalid_intrinsics_are_refused_by_name(change, message):
    good = {"width": 320, "height": 240, "fx": 277.0, "fy": 277.0, "cx": 159.5, "cy": 119.5}
    with pytest.raises(ConfigError, match=message):
        Camera(**(good | change))


@pytest.mark.parametrize(
    ("distortion", "expected"),
    [
        ((0.0, 0.0, 0.001, 0.0, 0.0), math.inf),
        ((0.3, 0.0, 0.0, 0.0, 0.0), math.inf),
        ((-0.3, 0.0, 0.0, 0.0, 0.0), math.sqrt(1 / 0.9)),  # r - 0.3 r^3
        ((-0.3, 0.0, 0.0, 0.0, 5e-320), math.sqrt(1 / 0.9)),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0), 2.0),  # r / (1 + r^2 / 4)
        ((0.0, 0.0, 0.0, 0.0, 0.0, -0.25, 0.0, 0.0), 2.0),  # r / (1 - r^2 / 4): infinite there
    ],
)
def test_the_largest_slope_is_where_the_distorted_radius_stops_growing(distortion, expected):
    camera = Camera(320, 240, 100.0, 100.0, 159.5, 119.5, distortion)
    assert camera.largest_slope == pytest.approx(expected)


@pytest.mark.parametrize("camera", [KITTI, BENT, MILD, TOF, KINECT])
def test_no_ray_beyond_the_edge_of_the_image_is_in_it_and_every_ray_inside_is(camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    again = camera.project(camera.rays)
    np.testing.assert_allclose(again, np.stack([u, v], axis=-1), atol=1e-6)
    turns = np.linspace(0, math.tau, 24, endpoint=False)
    slopes = np.tan(np.radians(np.linspace(0, 89.9, 2000)))
    for cosine, sine in zip(np.cos(turns), np.sin(turns), strict=True):
        rays = np.column_stack([slopes * cosine, slopes * sine, np.ones(len(slopes))])
        inside = camera.contains(camera.project(rays))
        assert inside[0]
        assert np.count_nonzero(np.diff(inside)) == 1  # it leaves the image once, for good
