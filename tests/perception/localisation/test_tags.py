"""Tags drawn at known poses: detected position and its covariance."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.filtering import consistency
from perception.localisation import tag_edges
from perception.localisation.landmarks import (
    CAMERA_HEIGHT_SIGMA_M,
    LandmarkConfig,
    constrained_to_height,
    detect,
    find_corners,
    range_and_bearing,
    tag_centre,
    to_body_frame,
)
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import ColourView
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose3, head_rotation

CAMERA = Camera.from_view(320, 240, math.radians(60), math.radians(46.8))
SIDE_M = 0.16
FINE = 6  # rays per pixel and axis


def draw(
    camera: Camera,
    T_camera_tags: list[tuple[int, Pose3]],
    rng: np.random.Generator,
    blur_px: float = 0.5,
    noise: float = 2.0,
) -> np.ndarray:
    """A grey wall with tags on white paper, seen by a camera without distortion."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cell = 40
    fine = np.array([[FINE, 0, FINE / 2 - 0.5], [0, FINE, FINE / 2 - 0.5], [0, 0, 1.0]])
    size = (camera.width * FINE, camera.height * FINE)
    image = np.full((size[1], size[0]), 150, np.uint8)
    for identity, T_camera_tag in T_camera_tags:
        paper = np.full((8 * cell, 8 * cell), 255, np.uint8)
        paper[cell:-cell, cell:-cell] = cv2.aruco.generateImageMarker(
            dictionary, identity, 6 * cell
        )
        scale, half = SIDE_M / (6 * cell), SIDE_M / 2
        edge = (0.5 - cell) * scale  # paper's pixel (0, 0) is centred half a pixel inside its edge
        to_tag = np.array([[scale, 0, edge - half], [0, -scale, half - edge], [0, 0, 1.0]])
        H = fine @ camera.matrix @ T_camera_tag.matrix[:3][:, [0, 1, 3]] @ to_tag
        cv2.warpPerspective(
            paper, H, size, dst=image, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
        )
    grey = image.reshape(camera.height, FINE, camera.width, FINE).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(grey, (0, 0), blur_px) + rng.normal(size=grey.shape) * noise
    return np.repeat(np.clip(grey.round(), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def tag_in_body(distance: float, bearing: float, height: float, slant: float) -> Pose3:
    """A vertical tag that faces the robot, turned by the slant."""
    facing = bearing + math.pi + slant
    out = np.array([math.cos(facing), math.sin(facing), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    place = np.array([distance * math.cos(bearing), distance * math.sin(bearing), height])
    return Pose3.from_rotation(np.stack([np.cross(up, out), up, out], axis=1), place)


def head(pan: float = 0.0, tilt: float = 0.1) -> Pose3:
    return Pose3.from_rotation(head_rotation(pan, tilt), np.array([0.035, 0.0, 0.383]))


def square() -> np.ndarray:
    h = SIDE_M / 2
    return np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])


@pytest.mark.parametrize(
    ("distance", "slant_deg", "limit_px"), [(0.8, 0, 0.04), (1.5, 30, 0.06), (2.5, 20, 0.15)]
)
def test_corners_are_located_to_a_fraction_of_a_pixel(distance, slant_deg, limit_px):
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(6):
        tag = tag_in_body(distance, rng.uniform(-0.25, 0.25), 0.45, math.radians(slant_deg))
        T_camera_tag = head().inverse() @ tag
        found = find_corners(draw(CAMERA, [(7, T_camera_tag)], rng))
        assert [identity for identity, _ in found] == [7]
        errors.append(found[0][1] - CAMERA.project(T_camera_tag.apply(square())))
    assert np.sqrt(np.mean(np.square(errors))) < limit_px


def test_blur_does_not_shrink_the_tag():
    """A corner detector moves blurred corners inward; lines through the edges do not."""
    rng = np.random.default_rng(2)
    T_camera_tag = head().inverse() @ tag_in_body(1.2, 0.0, 0.45, 0.0)
    true = CAMERA.project(T_camera_tag.apply(square()))
    rgb = draw(CAMERA, [(3, T_camera_tag)], rng, blur_px=1.2, noise=1.0)
    (_, corners), *_ = find_corners(rgb)
    inward = true.mean(axis=0) - true
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    assert np.abs(np.sum((corners - true) * inward, axis=1)).max() < 0.1


def test_a_square_without_visible_edges_has_no_corners():
    flat = np.full((60, 60), 128, np.uint8)
    corners = np.array([[10.0, 10.0], [40.0, 10.0], [40.0, 40.0], [10.0, 40.0]])
    assert tag_edges.refine_corners(flat, corners) is None


@pytest.mark.parametrize("side", range(4))
def test_a_partly_occluded_tag_is_ignored(side):
    """The straight edge of a bright occluder is mistaken for the tag's own."""
    rng = np.random.default_rng(side)
    T_camera_tag = head().inverse() @ tag_in_body(1.2, 0.0, 0.45, 0.0)
    rgb = draw(CAMERA, [(3, T_camera_tag)], rng)
    assert [identity for identity, _ in find_corners(rgb)] == [3]
    left, top, right, bottom = (
        extreme(CAMERA.project(T_camera_tag.apply(square()))[:, axis])
        for extreme in (np.min, np.max)
        for axis in (0, 1)
    )
    covered = round(0.08 * (right - left))
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    before = (
        (u < left + covered, v < top + covered, u > right - covered, v > bottom - covered)[side]
        & (abs(u - (left + right) / 2) < 60)
        & (abs(v - (top + bottom) / 2) < 60)
    )
    rgb[before] = 215
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    _, identities, _ = detector.detectMarkers(np.ascontiguousarray(rgb[..., 0]))
    assert np.ravel(identities).tolist() == [3]  # the tag is still decoded
    assert find_corners(rgb) == []


def test_several_tags_come_in_order_and_unknown_ones_are_ignored():
    rng = np.random.default_rng(3)
    tags = [(9, 0.25), (4, 0.0), (30, -0.25)]
    seen = [(i, head().inverse() @ tag_in_body(1.2, b, 0.45, 0.0)) for i, b in tags]
    known = [Landmark(i, (1.0, 2.0, 0.45), SIDE_M) for i in (4, 9, 11)]
    found = detect(ColourView(draw(CAMERA, seen, rng), CAMERA, head()), known).sightings
    assert [s.identity for s in found] == [4, 9]
    np.testing.assert_allclose(found[1].measured, [1.2, 0.25], atol=0.02)


def test_a_tag_seen_twice_is_ignored():
    rng = np.random.default_rng(4)
    seen = [(4, head().inverse() @ tag_in_body(1.2, b, 0.45, 0.0)) for b in (-0.2, 0.2)]
    known = [Landmark(4, (1.0, 2.0, 0.45), SIDE_M)]
    assert detect(ColourView(draw(CAMERA, seen, rng), CAMERA, head()), known).sightings == []


def test_a_tag_at_the_wrong_height_is_ignored_and_counted():
    rng = np.random.default_rng(5)
    image = draw(CAMERA, [(4, head().inverse() @ tag_in_body(1.2, 0.1, 0.45, 0.0))], rng)
    right = detect(ColourView(image, CAMERA, head()), [Landmark(4, (0.0, 0.0, 0.45), SIDE_M)])
    wrong = detect(ColourView(image, CAMERA, head()), [Landmark(4, (0.0, 0.0, 0.75), SIDE_M)])
    assert (len(right.sightings), right.misplaced) == (1, 0)
    assert (len(wrong.sightings), wrong.misplaced) == (0, 1)


def test_an_empty_image_has_no_sightings():
    rgb = np.full((240, 320, 3), 90, np.uint8)
    assert not detect(
        ColourView(rgb, CAMERA, head()), [Landmark(4, (0.0, 0.0, 0.4), SIDE_M)]
    ).sightings


def test_the_bearing_does_not_depend_on_the_pan_of_the_head():
    rng = np.random.default_rng(6)
    aside = head(pan=0.8, tilt=0.2)
    image = draw(CAMERA, [(4, aside.inverse() @ tag_in_body(1.3, 0.9, 0.40, 0.0))], rng)
    (seen,) = detect(
        ColourView(image, CAMERA, aside), [Landmark(4, (0.0, 0.0, 0.40), SIDE_M)]
    ).sightings
    np.testing.assert_allclose(seen.measured, [1.3, 0.9], atol=0.01)


def test_a_distorted_square_is_refused():
    T_camera_tag = head().inverse() @ tag_in_body(1.0, 0.0, 0.45, 0.0)
    corners = CAMERA.project(T_camera_tag.apply(square()))
    assert tag_centre(corners, SIDE_M, CAMERA, LandmarkConfig()) is not None
    corners[0] += [6.0, 6.0]
    assert tag_centre(corners, SIDE_M, CAMERA, LandmarkConfig()) is None


@pytest.mark.parametrize("distance", [0.7, 1.2, 1.8])
def test_the_centre_is_consistent_with_its_covariance(distance):
    """Corners with exactly the modelled noise, and a distorted lens."""
    rng = np.random.default_rng(7)
    camera = Camera(320, 240, 277.0, 277.0, 159.5, 119.5, (-0.2, 0.05, 0.001, -0.001, 0.0))
    config = LandmarkConfig(corner_sigma_px=0.1, smallest_side_px=8.0)
    errors, covariances = [], []
    for _ in range(150):
        tag = tag_in_body(distance, rng.uniform(-0.3, 0.3), 0.45, rng.uniform(0.3, 0.8))
        T_camera_tag = head().inverse() @ tag
        corners = camera.project(T_camera_tag.apply(square())) + rng.normal(size=(4, 2)) * 0.1
        centre = tag_centre(corners, SIDE_M, camera, config)
        assert centre is not None
        errors.append(centre.mean - T_camera_tag.position)
        covariances.append(centre.covariance)
    low, high = consistency.band(3, 150, 0.999)
    assert low < consistency.nees(np.array(errors), np.array(covariances)).mean() < high


def test_sightings_with_head_errors_are_consistent_with_their_covariance():
    """From image to range and bearing; the range may be more certain than its covariance, never less."""
    rng = np.random.default_rng(8)
    config = LandmarkConfig(smallest_side_px=12.0)
    errors, covariances = [], []
    for _ in range(100):
        distance, bearing = rng.uniform(0.8, 2.0), rng.uniform(-0.25, 0.25)
        true = head(tilt=rng.uniform(0.0, 0.2))
        tag = tag_in_body(distance, bearing, 0.45, rng.uniform(-0.7, 0.7))
        image = draw(CAMERA, [(7, true.inverse() @ tag)], rng)
        R = true.rotation
        slip = rng.normal(size=3) * [
            config.head_yaw_sigma_rad,
            config.head_pitch_sigma_rad,
            config.head_roll_sigma_rad,
        ]
        turn = slip[0] * np.array([0.0, 0.0, 1.0]) + slip[1] * R[:, 0] + slip[2] * R[:, 2]
        believed = Pose3.from_rotation(Rotation.from_rotvec(turn).as_matrix() @ R, true.position)
        view = ColourView(image, CAMERA, believed)
        for seen in detect(view, [Landmark(7, (0.0, 0.0, 0.45), SIDE_M)], config).sightings:
            errors.append(seen.measured - [distance, bearing])
            covariances.append(seen.covariance)
    n = len(errors)
    assert n > 90
    error, P = np.array(errors), np.array(covariances)
    low, high = consistency.band(1, n, 0.999)
    assert low < np.mean(error[:, 1] ** 2 / P[:, 1, 1]) < high
    assert np.mean(error[:, 0] ** 2 / P[:, 0, 0]) < high
    assert np.sqrt(np.mean(error[:, 0] ** 2)) < 0.006
    assert consistency.nees(error, P).mean() < consistency.band(2, n, 0.999)[1]


def test_a_view_without_the_camera_pose_is_refused():
    with pytest.raises(InputError, match="no T_body_camera"):
        detect(ColourView(np.zeros((240, 320, 3), np.uint8), CAMERA), [])


def test_an_impossible_noise_is_refused():
    with pytest.raises(ConfigError, match=r"corner_sigma_px=0\.0"):
        LandmarkConfig(corner_sigma_px=0.0)


def some_point(seed: int) -> Gaussian:
    rng = np.random.default_rng(seed)
    root = 0.03 * rng.normal(size=(3, 3))
    return Gaussian(np.array([1.5, -0.4, 0.3]) + 0.3 * rng.normal(size=3), root @ root.T)


@pytest.mark.parametrize("seed", range(3))
def test_the_known_height_of_a_tag_is_one_more_measurement(seed):
    """In information form: the inverse covariances add up."""
    point, seen = some_point(seed), np.array([0.0, 0.0, 1.0])
    height = float(point.mean[2]) + 0.02
    found = constrained_to_height(point, height)
    W, w = np.linalg.inv(point.covariance), np.outer(seen, seen) / CAMERA_HEIGHT_SIGMA_M**2
    np.testing.assert_allclose(np.linalg.inv(found.covariance), W + w, rtol=1e-6)
    mean = np.linalg.solve(W + w, W @ point.mean + w @ [0.0, 0.0, height])
    np.testing.assert_allclose(found.mean, mean, atol=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_tag_more_than_four_deviations_from_its_height_is_another_one(side):
    point = some_point(4)
    sigma = math.hypot(math.sqrt(point.covariance[2, 2]), CAMERA_HEIGHT_SIGMA_M)
    height = float(point.mean[2])
    assert constrained_to_height(point, height + side * 3.9 * sigma) is not None
    assert constrained_to_height(point, height + side * 4.1 * sigma) is None


@pytest.mark.parametrize("seed", range(3))
def test_errors_of_the_head_turn_a_tag_about_its_axes(seed):
    config, point = LandmarkConfig(), some_point(seed)
    R = head_rotation(0.5, 0.3)
    T = Pose3.from_rotation(R, np.array([0.02, 0.01, 0.45]))
    found = to_body_frame(point, T, config)
    np.testing.assert_allclose(found.mean, T.apply(point.mean), atol=1e-12)
    expected = R @ point.covariance @ R.T
    expected += np.diag([config.camera_place_sigma_m**2, config.camera_place_sigma_m**2, 0.0])
    for axis, sigma in (
        (np.array([0.0, 0.0, 1.0]), config.head_yaw_sigma_rad),
        (R @ [1.0, 0.0, 0.0], config.head_pitch_sigma_rad),
        (R @ [0.0, 0.0, 1.0], config.head_roll_sigma_rad),
    ):
        turned = Rotation.from_rotvec(1e-6 * axis).apply(R @ point.mean) - R @ point.mean
        expected += np.outer(turned, turned) * (sigma / 1e-6) ** 2
    np.testing.assert_allclose(found.covariance, expected, atol=1e-9)


def test_range_and_bearing_have_the_covariance_of_many_draws():
    point = some_point(1)
    found = range_and_bearing(point, 7)
    assert found.identity == 7
    drawn = np.random.default_rng(0).multivariate_normal(point.mean, point.covariance, 200_000)
    polar = np.column_stack([np.hypot(*drawn[:, :2].T), np.arctan2(drawn[:, 1], drawn[:, 0])])
    np.testing.assert_allclose(found.measured, polar.mean(axis=0), atol=2e-3)
    np.testing.assert_allclose(found.covariance, np.cov(polar.T), rtol=0.03, atol=1e-6)
