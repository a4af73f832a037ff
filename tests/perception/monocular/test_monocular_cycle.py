"""Edges against brute force, and complete cycles on rendered scenes with known motion."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from perception.monocular.back_projection import camera_pose, floor_points
from perception.monocular.contact_covariance import UNKNOWN_SPEED_MPS, CameraNoise
from perception.monocular.cycle import Monocular, MonocularConfig
from perception.monocular.edges import MIN_COLUMNS, REACH_PX, find_edges
from perception.monocular.result import Picture
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError

CAMERA = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)
STEP_M, STEP_S = 0.0123, 0.2
BOX_M = (1.0, 0.10, 0.08)  # ahead, width, height
EXACT = MonocularConfig(camera_noise=CameraNoise(0.0, 0.0, 0.0, 0.0))
TEXTURE = np.random.default_rng(7).integers(0, 255, (12, 12)).astype(np.uint8)


def picture(stamp_s, left_m, noise=0):
    """A uniform floor, a blue wall at 3 m, and a box with a textured front."""
    pose = camera_pose(
        np.array([STEP_M * stamp_s / STEP_S, 0.0, 0.42]), 0.0, math.radians(30.0), 0.0
    )
    v, u = np.mgrid[0:720, 0:720].astype(float)
    floor = floor_points(np.stack([u, v], axis=-1), CAMERA, pose)
    image = np.where((floor[..., 0] < 3.0)[..., None], (190.0, 150.0, 105.0), (110.0, 140.0, 180.0))
    ahead, width, height = BOX_M
    sides = (left_m + width / 2, left_m - width / 2)
    corners = np.array(
        [[ahead, y, z] for y, z in zip((*sides, *sides[::-1]), (height, height, 0, 0), strict=True)]
    )
    pixels = CAMERA.project(pose.inverse().apply(corners)).astype(np.float32)
    source = np.array([[0, 0], [12, 0], [12, 12], [0, 12]], np.float32)
    panel = cv2.warpPerspective(TEXTURE, cv2.getPerspectiveTransform(source, pixels), (720, 720))
    inside = cv2.fillConvexPoly(
        np.zeros((720, 720), np.uint8), np.rint(16 * pixels).astype(np.int32), 1, shift=4
    )
    image[inside > 0] = panel[inside > 0, None] * np.array([0.3, 0.4, 0.9])
    image += np.random.default_rng(noise).normal(0.0, 2.0, image.shape)
    rgb = np.clip(image, 0, 255).astype(np.uint8)
    return Picture(rgb, CAMERA, pose, stamp_s)


def box_of(result):
    return min(result.obstacles, key=lambda o: abs(np.nanmean(o.contact_world[:, 0]) - BOX_M[0]))


def cycle(speed_mps, config=None):
    left = -0.05
    pair = picture(0.0, left, 1), picture(STEP_S, left + speed_mps * STEP_S, 2)
    return Monocular(config or EXACT).cycle(*pair), left + speed_mps * STEP_S


def strips(rng, height, width):
    """Floor with strips that are not floor, at distances below and above the reach."""
    ground = np.full((height, width), 255, np.uint8)
    for _ in range(int(rng.integers(1, 2 + height * width // 150))):
        v, u, long = rng.integers((0, 0, 1), (height - 1, width, 14))
        ground[v : v + int(rng.integers(1, 4)), u : u + long] = 0
    return ground


def grouped_by_reach(pixels):
    """Groups of pixels, grown one neighbour at a time."""
    left, found = set(pixels), []
    while left:
        grown = [left.pop()]
        for x, y in grown:
            near = {p for p in left if max(abs(p[0] - x), abs(p[1] - y)) <= REACH_PX}
            left -= near
            grown += near
        found.append(frozenset(grown))
    return found


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 60), st.integers(4, 60), st.booleans())
def test_edges_separate_obstacle_from_ground_and_groups_are_connected(seed, height, width, rugged):
    rng = np.random.default_rng(seed)
    ground = strips(rng, height, width)
    if rugged:
        ground = np.where(rng.random((height, width)) < 0.8, 255, 0).astype(np.uint8)
    edges = find_edges(ground)
    expected = {
        (x, y)
        for y in range(height - 1)
        for x in range(width)
        if ground[y, x] == 0 and ground[y + 1, x] == 255
    }
    assert set(zip(*np.nonzero(edges.image)[::-1], strict=True)) == expected
    pixels = list(zip(edges.columns.tolist(), edges.rows.tolist(), strict=True))
    assert len(pixels) == len(expected)
    groups = grouped_by_reach(expected)
    wide = {one for one in groups if len({x for x, _ in one}) >= MIN_COLUMNS}
    grouped = {
        frozenset(p for p, label in zip(pixels, edges.labels, strict=True) if label == k)
        for k in range(len(edges.groups))
    }
    assert grouped == wide
    noise = {p for p, label in zip(pixels, edges.labels, strict=True) if label < 0}
    assert noise == expected - set().union(*wide)
    for k, group in enumerate(edges.groups):
        mine = [p for p, label in zip(pixels, edges.labels, strict=True) if label == k]
        lowest = {u: max(y for x, y in mine if x == u) for u, _ in mine}
        assert group.tolist() == [[u, lowest[u]] for u in sorted(lowest)]


@pytest.mark.parametrize("speed", [0.06, -0.06, 0.15])
def test_a_moving_box_is_told_from_the_robots_own_motion_and_predicted(speed):
    result, left = cycle(speed)
    box = box_of(result)
    assert box.moving
    np.testing.assert_allclose(box.velocity_world, [0.0, speed], atol=0.03)
    middle = np.nanmean(box.predicted_world, axis=0)
    np.testing.assert_allclose(middle, [BOX_M[0], left + 0.65 * speed], atol=0.03)


def test_a_static_box_is_static_while_the_robot_walks():
    result, left = cycle(0.0)
    box = box_of(result)
    assert box.flow >= 0
    assert not box.moving
    np.testing.assert_array_equal(box.predicted_world, box.contact_world)
    np.testing.assert_allclose(np.nanmean(box.contact_world, axis=0), [BOX_M[0], left], atol=0.015)
    assert not result.predicted.any()


@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_the_speed_of_an_outlier_enters_only_the_covariance(speed):
    config = replace(EXACT, fastest_mps=0.1)
    box = box_of(cycle(speed, config)[0])
    assert box.flow == -1
    assert not box.moving
    np.testing.assert_array_equal(box.predicted_world, box.contact_world)
    error = np.array([0.0, speed])
    assert error @ np.linalg.solve(box.velocity_covariance, error) < stats.chi2.ppf(0.95, 2)
    assert box_of(cycle(speed)[0]).moving


def test_a_flow_beyond_the_maximum_distance_gives_no_velocity():
    config = replace(EXACT, farthest_m=0.8)
    result = cycle(0.15, config)[0]
    owned = result.flows.obstacle >= 0
    assert np.isnan(result.flows.velocity_world[owned]).any()
    unknown = UNKNOWN_SPEED_MPS**2 * np.eye(2)
    for obstacle in result.obstacles:
        if obstacle.flow < 0:
            np.testing.assert_allclose(obstacle.velocity_covariance, unknown)


def test_only_the_floor_that_a_moving_box_will_cover_is_not_free():
    result, left = cycle(0.15)
    assert not np.any(result.movable & ~result.ground)
    there = np.array([BOX_M[0], left + 0.15 * 0.65])
    for point, free in ((there, False), (there + np.array([0.0, 0.2]), True)):
        pose = result.current.T_world_camera
        at = CAMERA.project(pose.inverse().apply(np.append(point, 0.0)))
        u, v = np.rint(at).astype(int)
        assert (result.movable[v - 1, u] > 0) == free


def test_corners_are_tracked_to_half_a_pixel():
    result, _ = cycle(0.15)
    mine = [
        k
        for k in range(len(result.flows))
        if result.flows.obstacle[k] == result.obstacles.index(box_of(result))
    ]
    assert len(mine) >= 3
    errors = []
    for k in mine:  # corners of the front lie in the plane x = 1 m, which gives their new position
        pair = result.previous, result.current
        ray = CAMERA.back_project(result.flows.previous[k], np.array(1.0))
        world = pair[0].T_world_camera.rotation @ ray
        start = pair[0].T_world_camera.position
        point = start + world * (BOX_M[0] - start[0]) / world[0] + [0.0, 0.15 * STEP_S, 0.0]
        expected = CAMERA.project(pair[1].T_world_camera.inverse().apply(point))
        errors.append(np.hypot(*(result.flows.current[k] - expected)))
    assert np.median(errors) <= 0.5


def test_without_a_previous_picture_all_obstacles_are_static():
    result = Monocular(MonocularConfig()).cycle(None, picture(0.0, 0.1))
    assert len(result.flows) == 0
    assert not any(o.moving for o in result.obstacles)


def test_a_pair_in_the_wrong_order_is_refused():
    with pytest.raises(InputError, match="swap"):
        Monocular(MonocularConfig()).cycle(picture(0.2, 0.0), picture(0.0, 0.0))


def test_the_colour_floor_is_the_depth_floor_of_a_real_recording(recordings):
    offline = pytest.importorskip("surefoot.offline.monocular", reason="reads a recording")
    from surefoot.recordings.open import open_recording

    floors = []
    for floor in offline.colour_floors(open_recording(recordings / "realsense_low_boxes")):
        floors.append(floor.iou)
    assert np.mean(floors) >= 0.75
