"""The relative pose of a pair from the texture of the floor, against rendered floors with known camera poses."""

from __future__ import annotations

import math

import cv2
import numpy as np

from perception.monocular import pair_pose
from perception.monocular.back_projection import camera_pose, floor_points, project
from perception.monocular.contact_covariance import CameraNoise, prior_covariance
from perception.monocular.flow import track_floor
from perception.monocular.result import Picture
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3, head_rotation

CAMERA = Camera.from_view(720, 720, math.pi / 2, math.pi / 2)
SMALL = Camera.from_view(360, 360, math.pi / 2, math.pi / 2)
NOISE = CameraNoise()
STEP_S = 0.2
BLACK = np.zeros((720, 720, 3), np.uint8)
BEFORE = camera_pose(np.array([0.0, 0.0, 0.40]), 0.1, math.radians(30.0), 0.0)


def swayed(pose, pitch_deg=0.0, roll_deg=0.0, yaw_deg=0.0, moved=(0.0, 0.0, 0.0)):
    """A pose turned about the world's y axis (pitch), x axis (roll) and z axis, and moved."""
    turn = cv2.Rodrigues(np.radians([roll_deg, pitch_deg, yaw_deg]))[0]
    return Pose3.from_rotation(turn @ pose.rotation, pose.position + np.array(moved))


def floor_tracks(true_before, true_now, rng, count=80, sigma_px=0.25):
    """Pixels of floor points in both true cameras, with the error of a tracker."""
    places = np.column_stack([rng.uniform(0.3, 2.5, count), rng.uniform(-1.0, 1.0, count)])
    begin = project(places, CAMERA, true_before)
    end = project(places, CAMERA, true_now) + rng.normal(0.0, sigma_px, (count, 2))
    seen = CAMERA.contains(begin) & CAMERA.contains(end)
    return begin[seen], end[seen]


def moved_floor(pair, place):
    """How far a standing floor point seems to move by the estimated poses, when the true ones are at the test's ends."""
    begin = project(place, CAMERA, TRUE[0])
    end = project(place, CAMERA, TRUE[1])
    was = floor_points(begin, CAMERA, pair.previous.T_world_camera)
    return floor_points(end, CAMERA, pair.current.T_world_camera) - was


TRUE = (
    swayed(BEFORE, 0.5, -0.7, 0.3, (0.003, -0.004, 0.001)),
    swayed(BEFORE, -0.6, 0.4, -0.4, (0.012, 0.004, -0.001)),
)
GIVEN = (
    Picture(BLACK, CAMERA, BEFORE, 0.0),
    Picture(BLACK, CAMERA, swayed(BEFORE, moved=(0.012, 0, 0)), STEP_S),
)
PLACES = np.array([[0.6, 0.1], [1.2, -0.4], [1.8, 0.5]])
NONE = (np.zeros((0, 2)), np.zeros((0, 2)))


def test_floor_points_make_standing_things_stand():
    pair = pair_pose.estimate(*GIVEN, *floor_tracks(*TRUE, np.random.default_rng(1)), NOISE)
    before = pair_pose.estimate(*GIVEN, *NONE, NOISE)
    assert pair.points >= pair_pose.LEAST_POINTS
    for place in PLACES:
        off = moved_floor(pair, place[None])[0]
        assert np.hypot(*off) < 0.02 * STEP_S
        assert np.hypot(*moved_floor(before, place[None])[0]) > 0.05 * STEP_S


def test_things_that_move_or_stand_up_do_not_disturb_it():
    rng = np.random.default_rng(2)
    begin, end = floor_tracks(*TRUE, rng)
    wrong = np.arange(len(begin)) % 3 == 0
    end[wrong] += rng.uniform(3.0, 20.0, (np.count_nonzero(wrong), 2))
    pair = pair_pose.estimate(*GIVEN, begin, end, NOISE)
    assert pair.points <= np.count_nonzero(~wrong) + 2
    for place in PLACES:
        assert np.hypot(*moved_floor(pair, place[None])[0]) < 0.02 * STEP_S


def test_its_covariance_holds_over_many_draws():
    """NEES of all ten errors, drawn from the prior: the mean of a chi-square with ten degrees of freedom is 10."""
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(prior_covariance(GIVEN[1], NOISE))
    found = []
    for _ in range(60):
        error = root @ rng.normal(size=10)
        true = [
            pair_pose._corrected(picture, error[k : k + 4], moved).T_world_camera
            for picture, k, moved in ((GIVEN[0], 0, error[8:]), (GIVEN[1], 4, None))
        ]
        pair = pair_pose.estimate(*GIVEN, *floor_tracks(*true, rng), NOISE)
        left = np.concatenate(
            [
                _errors(pair.previous.T_world_camera, true[0]),
                _errors(pair.current.T_world_camera, true[1]),
                (true[0].position - pair.previous.T_world_camera.position)[:2],
            ]
        )
        found.append(left @ np.linalg.solve(pair.covariance, left))
    print(np.round(found, 1))
    assert 7.0 < np.mean(found) < 13.0


def _errors(estimated, true):
    """Pitch, yaw, roll and height by which the true pose differs."""
    turn = cv2.Rodrigues(true.rotation @ estimated.rotation.T)[0][:, 0]
    x, y = estimated.rotation[:2, 2] / np.hypot(*estimated.rotation[:2, 2])
    height = true.position[2] - estimated.position[2]
    return np.array([turn @ [-y, x, 0.0], turn[2], turn @ [x, y, 0.0], height])


def test_on_a_bare_floor_the_gyro_takes_over():
    rate = np.radians([1.1, -1.1, 0.0]) / STEP_S  # roll, pitch between the two true poses
    sway = pair_pose.sway_by_gyro(rate, STEP_S, BEFORE, BEFORE, 0.0)
    bare = pair_pose.estimate(*GIVEN, *NONE, NOISE)
    pair = pair_pose.estimate(*GIVEN, *NONE, NOISE, sway)
    assert pair.points == bare.points == 0
    np.testing.assert_allclose(
        bare.current.T_world_camera.matrix, GIVEN[1].T_world_camera.matrix, atol=1e-9
    )
    tilts = [
        cv2.Rodrigues(one.current.T_world_camera.rotation @ one.previous.T_world_camera.rotation.T)[
            0
        ]
        for one in (pair, bare)
    ]
    np.testing.assert_allclose(np.degrees(tilts[0][:2, 0]), [1.1, -1.1], atol=0.02)
    np.testing.assert_allclose(tilts[1][:2, 0], 0.0, atol=1e-9)


def test_the_gyro_is_not_used_while_the_head_turns():
    turned = Pose3.from_rotation(head_rotation(0.05, 0.5), np.zeros(3))
    still = Pose3.from_rotation(head_rotation(0.0, 0.5), np.zeros(3))
    assert pair_pose.sway_by_gyro(np.zeros(3), STEP_S, still, turned, 0.0) is None
    assert pair_pose.sway_by_gyro(np.full(3, np.nan), STEP_S, still, still, 0.0) is None


def test_exact_poses_stay():
    exact = CameraNoise(0.0, 0.0, 0.0, 0.0)
    pair = pair_pose.estimate(*GIVEN, *floor_tracks(*TRUE, np.random.default_rng(4)), exact)
    assert (pair.previous, pair.current) == GIVEN
    assert not pair.covariance.any()


def test_corners_of_the_floor_are_found_again_after_a_turn_of_six_degrees():
    rng = np.random.default_rng(5)
    grain = cv2.GaussianBlur(rng.normal(0.0, 1.0, (600, 600)), (0, 0), 1.5)
    poses = (BEFORE, swayed(BEFORE, yaw_deg=6.0))
    v, u = np.mgrid[0:360, 0:360].astype(float)
    pictures = []
    for pose, stamp_s in zip(poses, (0.0, STEP_S), strict=True):
        floor = floor_points(np.stack([u, v], axis=-1), SMALL, pose, 5.0)
        known = np.isfinite(floor[..., 0])
        x, y = ((np.nan_to_num(floor) * 100.0 + 100.0).astype(np.float32)).transpose(2, 0, 1)
        tone = cv2.remap(grain.astype(np.float32), x, y + 200.0, cv2.INTER_LINEAR)
        image = np.where(known, 130.0 + 150.0 * tone, 60.0)
        rgb = np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        pictures.append(Picture(rgb, SMALL, pose, stamp_s))
    ground = np.where(known, 255, 0).astype(np.uint8)
    begin, end = track_floor(*pictures, ground)
    expected = project(floor_points(begin, SMALL, poses[0]), SMALL, poses[1])
    assert len(begin) >= pair_pose.LEAST_POINTS
    assert np.median(np.hypot(*(end - expected).T)) < 0.3
