"""Each step of a panorama against a closed form, a NumPy version or another library."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage
from scipy.spatial.transform import Rotation

from mapping.panorama import level_sets
from mapping.panorama.adjustment import Placed, Prior, adjust
from mapping.panorama.key_angles import AngleLaw, laws, locate, prepared
from mapping.panorama.matches import Guide, ViewFeatures
from mapping.panorama.pairs import Link, PairConfig, motion_link, rotation_link
from mapping.panorama.rendering import render
from mapping.panorama.sphere import Sphere, angles_of, direction, look_up, window_of_view
from mapping.panorama.surfaces import align, surface
from mapping.panorama.views import PriorConfig, View, head_directions, prior_covariance
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, InputError
from perception.primitives.frame import Depth
from perception.primitives.pose import CAMERA_IN_BODY_AXES, Pose3, head_rotation

TOF = Camera.from_view(176, 144, math.radians(44.0), math.radians(35.0))
ANGLES = st.floats(-1.4, 1.4)


def rotation_of(vector):
    return Rotation.from_rotvec(vector).as_matrix()


@settings(deadline=None)  # the first call compiles
@given(st.floats(-3.1, 3.1), ANGLES)
def test_angles_and_directions_are_inverse(theta, phi):
    back = angles_of(direction(np.array([theta]), np.array([phi])))
    np.testing.assert_allclose([back[0][0], back[1][0]], [theta, phi], atol=1e-12)


def test_theta_is_positive_to_the_right_and_phi_upwards():
    theta, phi = angles_of(np.array([[1.0, -0.5, 0.0], [1.0, 0.0, 0.5]]))
    assert theta[0] > 0.0
    assert phi[1] > 0.0


def test_the_window_of_a_view_is_the_smallest_that_contains_it():
    for pan, tilt in ((0.0, 0.0), (1.0, 0.3), (-1.0, -0.3)):
        rotation = head_rotation(pan, tilt)
        sphere = window_of_view(TOF, rotation, math.degrees(4.0))
        u, v = look_up(sphere, TOF, rotation)
        shown = u >= 0.0
        for ends in (u[shown], v[shown]):
            assert ends.min() < 2.0
        assert u.max() > 174.0
        assert v.max() > 142.0
        assert shown.mean() > 0.75


def room_view(pose, noise=0.0, seed=0):
    """A box of 6 x 4 x 2.5 m seen from inside, exact but for noise along the axis."""
    rays = TOF.rays @ pose.rotation.T
    with np.errstate(divide="ignore"):
        low = (np.array([-2.0, -2.0, 0.0]) - pose.position) / rays
        high = (np.array([4.0, 2.0, 2.5]) - pose.position) / rays
    z = np.maximum(low, high).min(axis=-1)
    z = z + noise * np.random.default_rng(seed).standard_normal(z.shape)
    return Depth(z.astype(np.float32), np.full(z.shape, 0.004, np.float32), TOF)


def corner_pose(pan, tilt, place=(0.0, 0.0, 0.6)):
    return Pose3.from_rotation(head_rotation(pan, tilt), np.array(place))


def test_surfaces_find_a_small_motion_between_two_views_of_a_corner():
    one = corner_pose(0.5, 0.25)
    other = corner_pose(0.62, 0.2, (0.03, -0.02, 0.61))
    target, source = (surface(room_view(p, 0.004, k)) for k, p in enumerate((one, other)))
    true = one.inverse() @ other
    found = align(target, source, Pose3.from_rotation(true.rotation @ rotation_of([0.02, -0.02, 0.01]), true.position + 0.01))  # fmt: skip
    turn = Rotation.from_matrix(found.T_to_from.rotation.T @ true.rotation).as_rotvec()
    assert np.degrees(np.linalg.norm(turn)) < 0.15
    error = np.concatenate([turn, true.rotation.T @ (found.T_to_from.position - true.position)])
    assert error @ np.linalg.solve(found.covariance, error) < 25.0


def test_a_plain_wall_leaves_the_motion_along_it_unobservable():
    z = np.full((144, 176), 1.5, np.float32)
    wall = surface(Depth(z, np.full_like(z, 0.004), TOF))
    assert align(wall, wall, Pose3((0.01, 0.0, 0.01))) is None


def features_of(points, pose, rng, wrong=0, noise=0.0):
    camera = pose.inverse().apply(points)
    camera[:wrong] = rng.uniform(-1, 1, (wrong, 3)) + np.array([0, 0, 2])
    camera += noise * rng.standard_normal(camera.shape)
    range_m = np.linalg.norm(camera, axis=1)
    nothing = np.zeros((len(points), 128), np.float32)
    return ViewFeatures(
        camera / range_m[:, None], range_m, nothing, np.zeros(len(points), np.int64)
    )


@pytest.mark.parametrize("wrong", [0, 30])
def test_a_rotation_is_found_among_wrong_matches(wrong):
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (80, 3)) + np.array([3.0, 0.0, 0.5])
    one, other = corner_pose(0.0, 0.0), corner_pose(0.2, 0.05)
    seen = features_of(points, one, rng, wrong, 0.003), features_of(points, other, rng, 0, 0.003)
    pairs = np.column_stack([np.arange(80)] * 2)
    guide = Guide(other.inverse() @ one, np.radians(3.0), 0.002)
    link = rotation_link((0, 1), seen, pairs, guide, rng, PairConfig())
    true = one.rotation.T @ other.rotation
    turn = Rotation.from_matrix(link.T_first_second.rotation.T @ true).as_rotvec()
    assert np.degrees(np.linalg.norm(turn)) < 0.2
    assert link.inliers >= 80 - wrong - 3
    assert turn @ np.linalg.solve(link.covariance[:3, :3], turn) < 16.0


def test_a_known_camera_position_corrects_the_parallax_of_near_features():
    rng = np.random.default_rng(6)
    points = rng.uniform(-0.4, 0.4, (60, 3)) + np.array([1.0, 0.0, 0.6])
    one, other = corner_pose(0.0, 0.0), corner_pose(0.2, 0.0, (0.0, 0.06, 0.6))
    seen = features_of(points, one, rng), features_of(points, other, rng)
    pairs = np.column_stack([np.arange(60)] * 2)
    true = one.rotation.T @ other.rotation
    guide = Guide(other.inverse() @ one, np.radians(3.0), 0.002)
    known = rotation_link((0, 1), seen, pairs, guide, rng, PairConfig())
    turn = Rotation.from_matrix(known.T_first_second.rotation.T @ true).magnitude()
    assert np.degrees(turn) < 0.01
    unknown = rotation_link((0, 1), seen, pairs, None, rng, PairConfig())
    assert unknown is None or Rotation.from_matrix(
        unknown.T_first_second.rotation.T @ true
    ).magnitude() > np.radians(0.5)


@pytest.mark.parametrize("wrong", [0, 30])
def test_a_motion_is_found_among_wrong_matches(wrong):
    rng = np.random.default_rng(7)
    points = rng.uniform(-1, 1, (80, 3)) + np.array([2.5, 0.0, 0.5])
    one, other = corner_pose(0.0, 0.0), corner_pose(0.3, 0.1, (0.2, 0.1, 0.5))
    seen = features_of(points, one, rng, wrong, 0.002), features_of(points, other, rng, 0, 0.002)
    pairs = np.column_stack([np.arange(80)] * 2)
    link = motion_link((0, 1), seen, pairs, rng)
    true = one.inverse() @ other
    np.testing.assert_allclose(link.T_first_second.position, true.position, atol=0.01)
    turn = Rotation.from_matrix(link.T_first_second.rotation.T @ true.rotation).magnitude()
    assert np.degrees(turn) < 0.3


def test_random_matches_are_no_pair():
    rng = np.random.default_rng(8)
    points = rng.uniform(-1, 1, (40, 3)) + np.array([3.0, 0.0, 0.5])
    seen = (
        features_of(points, corner_pose(0.0, 0.0), rng, 40),
        features_of(points, corner_pose(0.0, 0.0), rng, 40),
    )
    pairs = np.column_stack([np.arange(40)] * 2)
    for guide in (None, Guide(Pose3(), np.radians(20.0), 0.002)):
        assert rotation_link((0, 1), seen, pairs, guide, rng, PairConfig()) is None
    assert motion_link((0, 1), seen, pairs, rng) is None
    assert motion_link((0, 1), seen, pairs[:5], rng) is None


def test_without_priors_the_first_view_looks_straight_ahead():
    step = Pose3.from_rotation(rotation_of([0.0, 0.1, 0.0]), np.zeros(3))
    links = [Link(k, k + 1, step, 1e-4 * np.eye(6), 30, 40) for k in range(3)]
    placed = adjust([None] * 5, links, rotations_only=True)
    np.testing.assert_allclose(placed[0].T_base_camera.rotation, CAMERA_IN_BODY_AXES, atol=1e-6)
    turn = Rotation.from_matrix(CAMERA_IN_BODY_AXES.T @ placed[3].T_base_camera.rotation)
    np.testing.assert_allclose(turn.as_rotvec(), [0.0, 0.3, 0.0], atol=1e-6)
    assert placed[4] is None
    # three independent steps add up
    np.testing.assert_allclose(placed[3].covariance[:3, :3], 3e-4 * np.eye(3), atol=1e-6)


@pytest.mark.parametrize("rotations_only", [True, False])
def test_one_wrong_pair_does_not_displace_the_others(rotations_only):
    config = PriorConfig()
    poses = [corner_pose(0.3 * k, 0.0) for k in range(4)]
    priors = [Prior(p, prior_covariance(p, config)) for p in poses]
    links = [
        Link(i, j, poses[i].inverse() @ poses[j], 1e-6 * np.eye(6), 50, 60)
        for i in range(4)
        for j in range(i + 1, 4)
    ]
    false = Pose3.from_rotation(rotation_of([0.0, 0.3, 0.1]), np.zeros(3))
    links[0] = Link(0, 1, false, 1e-6 * np.eye(6), 9, 10)
    for found, true in zip(adjust(priors, links, rotations_only), poses, strict=True):
        turn = Rotation.from_matrix(found.T_base_camera.rotation.T @ true.rotation).magnitude()
        assert np.degrees(turn) < 0.1
        assert np.all(np.linalg.eigvalsh(found.covariance[:3, :3]) > 0.0)


def test_a_prior_has_less_variance_in_roll_than_in_pan_and_tilt():
    covariance = prior_covariance(corner_pose(0.7, 0.0), PriorConfig())
    deviations = np.degrees(np.sqrt(np.diag(covariance)[:3]))
    np.testing.assert_allclose(deviations, [0.51, 0.51, 0.1], atol=0.01)


def test_a_rendered_panorama_has_the_ranges_of_the_room():
    poses = [corner_pose(pan, 0.0, (0.02 * math.cos(pan), 0.02 * math.sin(pan), 0.6)) for pan in (-0.5, 0.0, 0.5)]  # fmt: skip
    views = [View(room_view(pose), (), None, float(k)) for k, pose in enumerate(poses)]
    drawing = render(views, [Placed(pose, np.eye(6), "encoders", 0) for pose in poses])
    rays = drawing.sphere.rays
    low = (np.array([-2.0, -2.0, 0.0]) - drawing.centre) / np.where(rays == 0, 1e-12, rays)
    high = (np.array([4.0, 2.0, 2.5]) - drawing.centre) / np.where(rays == 0, 1e-12, rays)
    true = np.maximum(low, high).min(axis=-1)
    known = np.isfinite(drawing.range_m)
    assert known.mean() > 0.7
    off = np.abs(drawing.range_m - true)[known] / true[known]
    assert np.median(off) < 0.002
    assert np.percentile(off, 99) < 0.03  # a pixel of grazing floor
    assert render(views, [None] * 3) is None


@pytest.mark.parametrize("pans_deg", [range(0, 391, 30), range(-180, 180, 30), (-170, 170)])
def test_a_panorama_of_more_than_a_turn_shows_every_direction_once(pans_deg):
    # A round wall of 2 m about the camera; a direction has the newest stamp of all views that show it.
    rays = TOF.rays
    z = (2.0 / np.hypot(rays[..., 0], rays[..., 2])).astype(np.float32)
    poses = [corner_pose(math.radians(pan), 0.0, (0.0, 0.0, 0.0)) for pan in pans_deg]
    depth = Depth(z, np.full_like(z, 0.01), TOF)
    views = [View(depth, (), None, float(k)) for k in range(len(poses))]
    drawing = render(views, [Placed(pose, np.eye(6), "encoders", 0) for pose in poses])
    assert drawing.sphere.width <= 360 * 4
    level = round(drawing.sphere.top_rad * drawing.sphere.px_per_rad)
    columns = np.arange(float(drawing.sphere.width))
    theta, _ = drawing.sphere.angles(columns, np.full_like(columns, level))
    off = np.array([(theta + math.radians(p) + np.pi) % (2 * np.pi) - np.pi for p in pans_deg])
    shown = np.abs(off) < math.radians(21.0)
    newest = len(poses) - 1 - np.argmax(shown[::-1], axis=0)
    sure = shown.any(axis=0) & ~((np.abs(off) > math.radians(21)) & (np.abs(off) < 0.4)).any(axis=0)
    assert sure.sum() > 100
    np.testing.assert_allclose(drawing.range_m[level, sure], 2.0, atol=0.01)
    np.testing.assert_array_equal(drawing.stamp_s[level, sure], newest[sure])


def test_the_nearest_range_occludes_others_and_equal_surfaces_are_averaged():
    pose = corner_pose(0.0, 0.0)
    placed = [Placed(pose, np.eye(6), "encoders", 0)] * 2

    def view(z_m, stamp, sigma_m=0.01):
        z = np.full((144, 176), z_m, np.float32)
        return View(Depth(z, np.full_like(z, sigma_m), TOF), (), None, stamp)

    near = render([view(1.0, 0.0), view(2.0, 1.0)], placed)
    middle = near.sphere.height // 2, near.sphere.width // 2
    assert near.range_m[middle] == pytest.approx(1.0, abs=0.001)
    assert near.stamp_s[middle] == 0.0
    same = render([view(1.0, 0.0), view(1.02, 1.0)], placed)
    assert same.range_m[middle] == pytest.approx(1.01, abs=0.001)
    assert same.sigma_m[middle] == pytest.approx(0.01 / math.sqrt(2), rel=0.01)
    assert same.stamp_s[middle] == 1.0
    exact = render([view(1.0, 0.0, 0.0), view(1.02, 1.0)], placed)  # depth without noise
    assert exact.range_m[middle] == pytest.approx(1.0, abs=0.001)


def test_the_correlation_agrees_with_opencv():
    rng = np.random.default_rng(9)
    image = cv2.GaussianBlur(rng.normal(size=(90, 160)).astype(np.float32), (0, 0), 3)
    template = image[30:70, 50:110] + 0.02 * rng.normal(size=(40, 60)).astype(np.float32)
    found = locate(prepared(image), prepared(template), (47, 31), (6, 6), row_step=1)
    peer = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED)
    (x, y), value = cv2.minMaxLoc(peer)[3], cv2.minMaxLoc(peer)[1]
    assert (x, y) == (50, 30)
    assert found.correlation == pytest.approx(value, abs=1e-4)
    assert (found.x, found.y) == pytest.approx((50, 30), abs=0.1)


def test_a_template_outside_the_panorama_is_not_found():
    image = np.random.default_rng(0).normal(size=(50, 60)).astype(np.float32)
    assert locate(prepared(image), prepared(image[:20, :20]), (200, 10), (2, 2)) is None


@settings(deadline=None)  # the first call compiles
@given(st.floats(-100, 800))
def test_angles_are_linear_between_keys_and_extrapolated_beyond(x):
    law = AngleLaw(np.radians([-60.0, 0.0, 60.0]), np.array([100.0, 340.0, 580.0]))
    assert np.degrees(law.angle(np.array([x])))[0] == pytest.approx((x - 340.0) / 4.0, abs=1e-9)
    falling = AngleLaw(np.radians([-17.0, 17.0]), np.array([200.0, 64.0]))
    assert np.degrees(falling.angle(np.array([x])))[0] == pytest.approx((132 - x) / 4, abs=1e-9)


@pytest.mark.parametrize("pan_deg", [29.5, 30.0, 30.4])
def test_views_whose_yaws_nearly_agree_share_a_key_angle(pan_deg):
    pans = np.radians([0.0, pan_deg - 0.1, pan_deg + 0.1])
    poses = [corner_pose(float(pan), tilt) for pan in pans for tilt in (0.0, 0.3)]
    views = [View(room_view(pose), (), pose, float(k)) for k, pose in enumerate(poses)]
    drawing = render(views, [Placed(pose, np.eye(6), "encoders", 0) for pose in poses])
    across, down = laws(drawing, views)
    np.testing.assert_allclose(np.degrees(across.keys_rad), [-pan_deg, 0.0], atol=1e-6)
    np.testing.assert_allclose(down.keys_rad, [-0.3, 0.0], atol=1e-6)


def test_views_without_priors_have_no_key_angles():
    view = View(room_view(corner_pose(0.0, 0.0)), ())
    drawing = render([view], [Placed(corner_pose(0.0, 0.0), np.eye(6), "encoders", 0)])
    with pytest.raises(InputError, match="0 key angles"):
        laws(drawing, [view])


def test_an_angle_law_needs_two_keys_in_order():
    with pytest.raises(InputError, match="at least two"):
        AngleLaw(np.zeros(1), np.zeros(1))
    with pytest.raises(InputError, match="monotonic"):
        AngleLaw(np.array([0.0, 1.0, 2.0]), np.array([0.0, 5.0, 4.0]))


@settings(deadline=None)  # the first call compiles
@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.integers(0, 3)))  # fmt: skip
def test_one_pass_labelling_agrees_with_labelling_each_level(slices):
    parts = level_sets.label(slices)
    total = 0
    for level in (1, 2, 3):
        expected, count = ndimage.label(slices == level, np.ones((3, 3)))
        total += count
        for number in range(1, count + 1):
            mine = np.unique(parts.labels[expected == number])
            assert len(mine) == 1
            where = np.argwhere(parts.labels == mine[0])
            assert len(where) == parts.areas[mine[0] - 1] == np.sum(expected == number)
            (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0)
            np.testing.assert_array_equal(parts.boxes[mine[0] - 1], [left, top, right, bottom])
            assert parts.levels[mine[0] - 1] == level
    assert len(parts) == total
    assert np.all((parts.labels == 0) == (slices == 0))


def test_a_face_perpendicular_to_x_lies_in_one_level():
    sphere = Sphere.window(-0.7, 0.7, -0.3, 0.3, math.degrees(4.0))
    rays = sphere.rays
    range_m = (1.07 / rays[..., 0]).astype(np.float32)
    forward = level_sets.forward_distance(range_m, sphere)
    np.testing.assert_allclose(forward, 1.07, atol=1e-5)
    assert np.unique(level_sets.levels(forward)).tolist() == [22]  # floor(1.07 / 0.05) + 1


def test_the_first_level_ends_at_five_centimetres_and_the_last_at_the_farthest_distance():
    distance = np.array([[0.0, 0.049, 0.051, 2.499, 2.51, np.nan, -0.1]], np.float32)
    np.testing.assert_array_equal(level_sets.levels(distance)[0], [1, 1, 2, 50, 0, 0, 0])


def test_the_nine_views_look_at_every_key_angle():
    directions = np.degrees(head_directions())
    assert len(directions) == 9
    theta, phi = angles_of(
        np.array([head_rotation(*np.radians(d).tolist())[:, 2] for d in directions])
    )
    np.testing.assert_allclose(np.unique(np.degrees(theta).round(6)), [-60, -30, 0, 30, 60])
    np.testing.assert_allclose(np.unique(np.degrees(phi).round(6)), [-17, 0, 17])


def test_impossible_settings_are_refused():
    with pytest.raises(ConfigError, match="pan_deg=0"):
        PriorConfig(pan_deg=0.0)
    with pytest.raises(ConfigError, match="count=300"):
        level_sets.LevelConfig(count=300)
    with pytest.raises(InputError, match="picture of"):
        View(room_view(corner_pose(0.0, 0.0)), (np.zeros((3, 3), np.uint8),))
