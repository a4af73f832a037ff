"""Rectification of raw stereo pairs: removes lens distortion and aligns both image planes.

A point then lies in the same row of both images, and its disparity alone gives its depth. The maps are
computed once per pair of cameras; a frame takes two look-ups.

Source: Bouguet's rectification, by OpenCV; seed 003, section 2 (input is rectified).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from jaxtyping import Int16, UInt8, UInt16

from ..primitives.camera import Camera
from ..primitives.errors import InputError
from ..primitives.frame import LEAST_BASELINE_M, MOST_BASELINE_M, StereoView
from ..primitives.pose import Pose3

MOST_TURN_DEG = 30.0  # between the two optical axes, for matching along rows
Maps = tuple[Int16[np.ndarray, "h w 2"], UInt16[np.ndarray, "h w"]]


@dataclass(frozen=True, eq=False)
class Rectification:
    """Maps from the raw images of one stereo rig to rectified ones.

    Args:
        camera: The rectified left camera; the right one has the same intrinsics.
        baseline_m: From the left to the right centre of projection.
        T_left_rectified: The rectified left camera in the raw left one: a rotation about its centre.
        left_maps, right_maps: Raw position of each rectified pixel, in OpenCV's fixed-point form.
    """

    camera: Camera
    baseline_m: float
    T_left_rectified: Pose3
    left_maps: Maps
    right_maps: Maps

    def apply(
        self,
        left: UInt8[np.ndarray, "h w"],
        right: UInt8[np.ndarray, "h2 w2"],
        T_body_left: Pose3 | None = None,
    ) -> StereoView:
        """Rectify one pair.

        Args:
            left, right: Raw grey images.
            T_body_left: The raw left camera on the body, if it is on one.

        Raises:
            InputError: An image does not have the size of the calibration.
        """
        size = (self.camera.height, self.camera.width)
        for name, image in (("left", left), ("right", right)):
            if image.shape != size:
                raise InputError(
                    f"rectification: the {name} image is {image.shape}, its calibration has {size} "
                    "(rows, columns); use the calibration of this camera at this resolution"
                )
        rectified = (
            cv2.remap(image, *maps, cv2.INTER_LINEAR)
            for image, maps in ((left, self.left_maps), (right, self.right_maps))
        )
        a, b = (np.asarray(image, np.uint8) for image in rectified)
        on_body = None if T_body_left is None else T_body_left @ self.T_left_rectified
        return StereoView(a, b, self.baseline_m, self.camera, on_body)


def check_baseline(baseline_m: float) -> None:
    """Refuse a distance of two cameras that is none.

    Raises:
        InputError: It is impossible.
    """
    if not LEAST_BASELINE_M <= baseline_m <= MOST_BASELINE_M:
        raise InputError(
            f"stereo: baseline_m={baseline_m} must lie in [{LEAST_BASELINE_M:g}, {MOST_BASELINE_M:g}]; the distance of "
            "the cameras in m was expected, check the calibration and its unit"
        )


def rectified(view: StereoView) -> StereoView:
    """The pair without lens distortion; both cameras are parallel and have the same intrinsics.

    Raises:
        InputError: As `rectification`, or an image does not fit its camera.
    """
    check_baseline(view.baseline_m)
    if not view.camera.is_distorted:
        return view
    return _parallel(view.camera, view.baseline_m).apply(view.left, view.right, view.T_body_camera)


def rectification(left: Camera, right: Camera, T_left_right: Pose3) -> Rectification:
    """Prepare the rectification of a calibrated rig.

    Args:
        left, right: Raw cameras with their distortion, of one size.
        T_left_right: Pose of the right camera in the left one; to its right, nearly parallel.

    Raises:
        InputError: Sizes differ, or the right camera is not to the right of the left one, or impossibly near or far.
    """
    if (left.width, left.height) != (right.width, right.height):
        raise InputError(
            f"rectification: left images are {left.width}x{left.height} px, right ones "
            f"{right.width}x{right.height}; both must have the same size"
        )
    x, y, z = T_left_right.translation
    if not x > abs(y) + abs(z):
        raise InputError(
            f"rectification: the right camera is at ({x:.3f}, {y:.3f}, {z:.3f}) m of the left one; it "
            "must be to its right (+x), check the order of the cameras and the direction of the extrinsics"
        )
    check_baseline(math.hypot(x, y, z))
    cosine = (float(np.trace(T_left_right.rotation)) - 1.0) / 2.0
    turn = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
    if turn > MOST_TURN_DEG:
        raise InputError(
            f"rectification: the optical axes are {turn:.0f} deg apart; expected at most "
            f"{MOST_TURN_DEG:.0f} deg, check the direction of the extrinsics"
        )
    T_right_left = T_left_right.inverse()
    size = (left.width, left.height)
    lenses = [np.array(camera.distortion) for camera in (left, right)]
    turn_left, turn_right, first, second = cv2.stereoRectify(
        left.matrix,
        lenses[0],
        right.matrix,
        lenses[1],
        size,
        T_right_left.rotation,
        T_right_left.position[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0.0,  # only pixels that both raw images cover
    )[:4]
    fx, fy, cx, cy = (float(first[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    maps = [
        cv2.initUndistortRectifyMap(raw.matrix, lens, turned, P[:, :3], size, cv2.CV_16SC2)
        for raw, lens, turned, P in zip(
            (left, right), lenses, (turn_left, turn_right), (first, second), strict=True
        )
    ]
    return Rectification(
        Camera(left.width, left.height, fx, fy, cx, cy),
        float(-second[0, 3] / second[0, 0]),
        Pose3.from_rotation(np.asarray(turn_left.T), np.zeros(3)),
        maps[0],
        maps[1],
    )


@cache
def _parallel(camera: Camera, baseline_m: float) -> Rectification:
    return rectification(camera, camera, Pose3((baseline_m, 0.0, 0.0)))
