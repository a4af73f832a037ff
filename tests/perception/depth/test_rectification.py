"""Rectification of synthetic rigs, of real chessboards, and invalid rigs."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.depth.rectification import rectification
from perception.primitives.camera import Camera
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3

LEFT = Camera(320, 240, 230.0, 228.0, 158.0, 121.0, (-0.28, 0.07, 0.0002, 0.0001, 0.0))
RIGHT = Camera(320, 240, 231.0, 229.5, 163.0, 118.0, (-0.27, 0.06, -0.0001, 0.0002, 0.0))
BESIDE = Pose3((0.11, 0.002, -0.001), (0.008, -0.006, 0.004, 1.0))


def seen(raw, rig_maps, points):
    """Rectified pixels of points in the raw camera frame, by inverting the maps."""
    u, v = cv2.convertMaps(*rig_maps, cv2.CV_32FC1)
    target = raw.project(points)
    found = []
    for x, y in target:
        row, column = np.unravel_index(np.argmin((u - x) ** 2 + (v - y) ** 2), u.shape)
        found.append((column, row))
    return np.array(found, dtype=np.float64)


def test_points_are_in_one_row_with_the_disparity_of_their_depth():
    rig = rectification(LEFT, RIGHT, BESIDE)
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-0.6, 0.8, (40, 2)) * [1.0, 0.6], rng.uniform(1.5, 4, 40)]
    )
    a = seen(LEFT, rig.left_maps, points)
    b = seen(RIGHT, rig.right_maps, BESIDE.inverse().apply(points))
    inside = (a > 2).all(1) & (b > 2).all(1) & (a < [317, 237]).all(1) & (b < [317, 237]).all(1)
    assert inside.sum() > 20
    assert np.abs(a[:, 1] - b[:, 1])[inside].max() <= 1.0  # both are rounded to whole pixels
    z = rig.T_left_rectified.inverse().apply(points)[:, 2]
    disparity = rig.camera.fx * rig.baseline_m / z
    assert np.abs(a[:, 0] - b[:, 0] - disparity)[inside].max() <= 1.0
    expected = rig.camera.project(rig.T_left_rectified.inverse().apply(points))
    assert np.abs(a - expected)[inside].max() <= 0.75
    assert abs(rig.baseline_m - np.linalg.norm(BESIDE.position)) < 1e-9


def test_corners_of_real_chessboards_are_in_one_row(recordings):
    folder = recordings / "opencv_samples"
    pairs = []
    for number in range(1, 15):
        files = [folder / f"{side}{number:02d}.jpg" for side in ("left", "right")]
        if not all(file.exists() for file in files):
            continue
        images = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
        corners = [corners_of(image) for image in images]
        if all(found is not None for found in corners):
            pairs.append((images, corners))
    assert len(pairs) >= 10
    left, right, beside = calibrated([corners for _, corners in pairs])
    rig = rectification(left, right, beside)
    rows = []
    for images, _ in pairs:
        view = rig.apply(*images)
        a, b = corners_of(view.left), corners_of(view.right)
        if a is not None and b is not None:
            rows.append(np.abs(a[:, 1] - b[:, 1]))
    assert len(rows) >= 8
    assert np.median(np.concatenate(rows)) < 0.25
    assert np.mean(np.concatenate(rows)) < 0.5  # px


def corners_of(image):
    """(54, 2) inner corners to a fraction of a pixel, or None."""
    found, corners = cv2.findChessboardCorners(image, (9, 6))
    if not found:
        return None
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    corners = cv2.cornerSubPix(image, corners, (7, 7), (-1, -1), stop)
    return corners.reshape(-1, 2)


def calibrated(corners):
    """Both cameras and the pose of the right one in the left one, calibrated from the boards by OpenCV."""
    board = np.zeros((54, 3), np.float32)
    board[:, :2] = 0.025 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    boards = [board] * len(corners)
    sides = [[pair[k].astype(np.float32)[:, None] for pair in corners] for k in range(2)]
    single = [cv2.calibrateCamera(boards, side, (640, 480), None, None) for side in sides]
    _, K1, D1, K2, D2, R, T, *_ = cv2.stereoCalibrate(
        boards,
        *sides,
        single[0][1],
        single[0][2],
        single[1][1],
        single[1][2],
        (640, 480),
        flags=cv2.CALIB_FIX_INTRINSIC,
    )
    cameras = [
        Camera(640, 480, K[0, 0], K[1, 1], K[0, 2], K[1, 2], tuple(float(d) for d in D.ravel()[:5]))
        for K, D in ((K1, D1), (K2, D2))
    ]
    return (*cameras, Pose3.from_rotation(R, T.ravel()).inverse())


def test_the_pose_on_the_body_includes_the_rectifying_rotation():
    rig = rectification(LEFT, RIGHT, BESIDE)
    on_body = Pose3((0.03, 0.02, 0.4), (-0.5, 0.5, -0.5, 0.5))
    grey = np.zeros((240, 320), np.uint8)
    view = rig.apply(grey, grey, on_body)
    np.testing.assert_allclose(view.T_body_camera.position, on_body.position)
    expected = on_body.rotation @ rig.T_left_rectified.rotation
    np.testing.assert_allclose(view.T_body_camera.rotation, expected, atol=1e-9)


def test_an_invalid_rig_is_refused_with_a_message():
    with pytest.raises(InputError, match="both must have the same size"):
        rectification(LEFT, replace(RIGHT, width=300), BESIDE)
    with pytest.raises(InputError, match="must be to its right"):
        rectification(LEFT, RIGHT, BESIDE.inverse())
    with pytest.raises(InputError, match="axes are 90 deg apart"):
        rectification(LEFT, RIGHT, Pose3((0.1, 0.0, 0.0), (0.0, 0.0, 0.5**0.5, 0.5**0.5)))
    rig = rectification(LEFT, RIGHT, BESIDE)
    with pytest.raises(InputError, match=r"the right image is \(240, 300\)"):
        rig.apply(np.zeros((240, 320), np.uint8), np.zeros((240, 300), np.uint8))


@pytest.mark.parametrize("baseline_m", [1e-300, 110.0])
def test_a_baseline_in_another_unit_is_refused(baseline_m):
    with pytest.raises(InputError, match="baseline_m"):
        rectification(LEFT, RIGHT, replace(BESIDE, translation=(baseline_m, 0.0, 0.0)))
