"""Detection of known tags, with range and bearing in the body frame.

A tag's four corners give its centre in the camera frame (perspective from four points, refined by least
squares). The head's joint angles, which err by tenths of a degree, transform it to the body frame. Both errors
enter a covariance of that point. The known height of the tag above the floor, which is more certain than the
head's tilt, then corrects it. The result is range along the floor and bearing.

Source: seed 001, section 3 (landmarks for self-localisation); tags and their errors are ours.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from ..primitives.camera import Camera
from ..primitives.errors import ConfigError, InputError
from ..primitives.frame import ColourView
from ..primitives.gaussian import Gaussian
from ..primitives.landmark import Landmark, Sighting
from ..primitives.pose import Pose3
from ..primitives.settings import setting
from . import tag_edges

CAMERA_HEIGHT_SIGMA_M = 0.003  # walking trials: 0.3 mm of stride, and the tag's own height
REPROJECTION_PX = 0.7  # ours: a larger error is no flat square, or another lens
HEIGHT_GATE_SIGMA = 4.0  # ours: a tag this far from its height is another one or misread
SMALL = 50  # tags of DICT_4X4_50
FARTHEST_M = 8.0  # ours: beyond, a printed tag is too small in every camera of the robot


@dataclass(frozen=True)
class LandmarkConfig:
    """Errors of tag corners and head angles."""

    corner_sigma_px: float = setting(
        0.3,
        "px",
        "standard deviation of a tag corner",
        "ours: .05 on ideal images, .25 on rendered ones",
    )
    head_yaw_sigma_rad: float = math.radians(0.4)  # ours: walking trials; play of the head's pan
    head_pitch_sigma_rad: float = math.radians(
        0.5
    )  # ours: walking trials; error of the head's tilt
    head_roll_sigma_rad: float = math.radians(
        0.7
    )  # ours: walking trials; roll of the head by the gait
    camera_place_sigma_m: float = 0.004  # walking trials: trunk tilt of 0.6 deg, 0.38 m above
    smallest_side_px: float = 20.0  # ours: below, blur mixes an edge with the first cells

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"landmarks: {one.name}={value} must be positive and finite")


class Look(NamedTuple):
    """What a colour image shows of the known tags.

    Args:
        sightings: One per tag, in order of identity.
        misplaced: Number of tags at another height than they have: the camera does not point where the joints say.
    """

    sightings: list[Sighting]
    misplaced: int


def detect(
    view: ColourView, landmarks: Sequence[Landmark], config: LandmarkConfig | None = None
) -> Look:
    """Find the known tags of a colour image.

    Args:
        view: The image, with the pose of the camera on the body.
        landmarks: Tags that may be present; others are ignored, and so is an identity seen twice.
        config: Errors and limits; the defaults if None.

    Raises:
        InputError: The view has no pose of the camera on the body.
    """
    config = config or LandmarkConfig()
    if view.T_body_camera is None:
        raise InputError(
            "landmarks: the colour image has no T_body_camera, the pose of the camera on the body; "
            "give it, or leave landmarks out"
        )
    known = {mark.identity: mark for mark in landmarks}
    many = max(known, default=0) >= SMALL
    found = find_corners(view.rgb, many)
    identities = [identity for identity, _ in found]
    sightings, misplaced = [], 0
    for identity, corners in sorted(found, key=lambda pair: pair[0]):
        if identity not in known or identities.count(identity) > 1:
            continue
        centre = tag_centre(corners, known[identity].side_m, view.camera, config)
        if centre is None:
            continue
        in_body = to_body_frame(centre, view.T_body_camera, config)
        at_height = constrained_to_height(in_body, known[identity].position[2])
        if at_height is None:
            misplaced += 1
        else:
            sightings.append(range_and_bearing(at_height, identity))
    return Look(sightings, misplaced)


def find_corners(
    rgb: UInt8[np.ndarray, "h w 3"], many: bool = False
) -> list[tuple[int, Float[np.ndarray, "4 2"]]]:
    """Fully visible tags: identity and corners (u, v) in px, clockwise from the upper left.

    Args:
        rgb: The image.
        many: Tags of DICT_4X4_250, which begins with those of DICT_4X4_50; else of the latter, which confuse less.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(_dictionary(many), parameters)
    corners, identities, _ = detector.detectMarkers(grey)
    if identities is None:
        return []
    found = []
    for identity, four in zip(np.asarray(identities).reshape(-1), corners, strict=True):
        refined = tag_edges.refine_corners(grey, np.asarray(four, np.float64).reshape(4, 2))
        if refined is None:
            continue
        if not tag_edges.is_occluded(grey, refined, _templates(int(identity))):
            found.append((int(identity), refined))
    return found


def _dictionary(many: bool) -> cv2.aruco.Dictionary:
    name = cv2.aruco.DICT_4X4_250 if many else cv2.aruco.DICT_4X4_50
    return cv2.aruco.getPredefinedDictionary(name)


@functools.cache
def _templates(identity: int) -> Float[np.ndarray, "p p 17"]:
    return tag_edges.occluded_templates(
        _dictionary(True).generateImageMarker(identity, tag_edges.CELLS)
    )


def tag_centre(
    corners: Float[np.ndarray, "4 2"], side_m: float, camera: Camera, config: LandmarkConfig
) -> Gaussian | None:
    """The centre of a square tag in the camera frame.

    Args:
        corners: (u, v) in px, clockwise from the tag's upper left.
        side_m: Side of the square.
        camera: Intrinsics.
        config: Corner noise and limits.

    Returns:
        Gaussian over (x, y, z), m, camera frame; None if the tag is too small, too far or not square.
    """
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    if float(sides.min()) < config.smallest_side_px:
        return None
    half = side_m / 2.0
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    lens = np.array(camera.distortion)
    ok, turn, centre = cv2.solvePnP(
        square, corners, camera.matrix, lens, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not ok:
        return None
    turn, centre = cv2.solvePnPRefineLM(square, corners, camera.matrix, lens, turn, centre)
    projected, jacobian = cv2.projectPoints(square, turn, centre, camera.matrix, lens)
    point = np.asarray(centre, np.float64).reshape(3)
    error_px = float(np.sqrt(np.mean((np.reshape(projected, (4, 2)) - corners) ** 2)))
    if not np.all(np.isfinite(point)) or error_px > REPROJECTION_PX:
        return None
    if not 0.0 < point[2] < FARTHEST_M:
        return None
    J = np.asarray(jacobian)[:, :6]  # eight coordinates by rotation and translation
    information = J.T @ J / config.corner_sigma_px**2
    return Gaussian(point, np.linalg.pinv(information, hermitian=True)[3:, 3:])


def to_body_frame(point: Gaussian, T_body_camera: Pose3, config: LandmarkConfig) -> Gaussian:
    """A point of the camera frame in the body frame, with the error of the head's angles, m.

    The pan errs about the body's z, the tilt about the camera's x, the roll about its optical axis.
    """
    R = T_body_camera.rotation
    axes = np.stack([np.array([0.0, 0.0, 1.0]), R[:, 0], R[:, 2]])  # rows: pan, tilt, roll
    sigmas = np.array(
        [config.head_yaw_sigma_rad, config.head_pitch_sigma_rad, config.head_roll_sigma_rad]
    )
    arm = R @ point.mean
    displacement = np.cross(axes, arm) * sigmas[:, None]  # rows: by one standard deviation
    place = np.diag([config.camera_place_sigma_m**2, config.camera_place_sigma_m**2, 0.0])
    return Gaussian(
        arm + T_body_camera.position,
        R @ point.covariance @ R.T + displacement.T @ displacement + place,
    )


def constrained_to_height(point: Gaussian, height_m: float) -> Gaussian | None:
    """A point of the body frame, updated with its known height above the floor; None if it contradicts it."""
    P = point.covariance
    innovation = height_m - float(point.mean[2])
    variance = float(P[2, 2]) + CAMERA_HEIGHT_SIGMA_M**2
    if innovation**2 > HEIGHT_GATE_SIGMA**2 * variance:
        return None
    gain = P[:, 2] / variance
    return Gaussian(point.mean + gain * innovation, P - np.outer(gain, P[2]))


def range_and_bearing(point: Gaussian, identity: int | None) -> Sighting:
    """Range along the floor and bearing of a point of the body frame, to first order."""
    x, y = float(point.mean[0]), float(point.mean[1])
    distance = math.hypot(x, y)
    J = np.array([[x / distance, y / distance], [-y / distance**2, x / distance**2]])
    covariance = J @ point.covariance[:2, :2] @ J.T
    return Sighting(
        identity, np.array([distance, math.atan2(y, x)]), (covariance + covariance.T) / 2.0
    )
