"""Relative pose of the two pictures of a pair, from the texture of the floor between them.

A walking trunk sways by half a degree between the two pictures, and the joints do not measure that; at 1.5 m it looks
like 0.3 m/s. But the floor stands still. Corners of its texture are tracked from picture to picture; those that agree
with one homography, and so with one plane, correct both camera poses by least squares, with the joints' errors and the
gyro as priors. What the floor does not determine keeps its prior covariance: a bare floor changes nothing.

The state of the estimate are the ten errors of `contact_covariance.STATES`.

Source: ours; the homography of a plane: Hartley and Zisserman, Multiple View Geometry, section 13.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from ..primitives.pose import Pose3
from .back_projection import FARTHEST_M, floor_points, project, viewing_direction
from .contact_covariance import (
    STATES,
    CameraNoise,
    pixel_jacobian,
    pose_jacobian,
    prior_covariance,
)
from .flow import CORNER_SIGMA_PX
from .result import Picture

LEAST_POINTS = 12  # ours: a homography has four; fewer than thrice that are no majority
OFF_PLANE_PX = 1.5  # ours: a tracked corner farther from the homography is not on the floor
ROUNDS = 3  # of Gauss-Newton; angles of a degree converge in two
TAIL = 2.0  # ours: residuals beyond this many sigma lose weight (Huber)
HEAD_RESTS_RAD = math.radians(0.5)  # ours: backlash of the neck
GYRO_RADPS = 0.0054  # noise 0.002 and bias 0.005 of a consumer gyro, as for the localiser


@dataclass(frozen=True, eq=False)
class PairPose:
    """A pair with corrected camera poses.

    Args:
        previous, current: The pictures.
        covariance: (10, 10), of the remaining errors, see `contact_covariance.STATES`.
        points: Number of floor points that determined it; 0: only the gyro did, if there is one.
    """

    previous: Picture
    current: Picture
    covariance: Float[np.ndarray, "10 10"]
    points: int


def estimate(
    previous: Picture,
    current: Picture,
    begin: Float[np.ndarray, "n 2"],
    end: Float[np.ndarray, "n 2"],
    noise: CameraNoise,
    sway_world: Float[np.ndarray, "2"] | None = None,
) -> PairPose:
    """Correct the poses of a pair.

    Args:
        previous, current: With the poses by joints.
        begin, end: Corners of the floor's texture in both, px; outliers are rejected.
        noise: Errors of the poses; without any, the poses stay.
        sway_world: Rotation between the pictures about the world's x and y axes by the gyro, less that by the
            joints, rad; None without gyro.
    """
    prior = prior_covariance(current, noise)
    if not prior.any():
        return PairPose(previous, current, prior, 0)
    information = np.linalg.inv(prior + 1e-12 * np.eye(STATES))
    gyro = _gyro_rows(previous, current, sway_world)
    seconds = current.stamp_s - previous.stamp_s
    of_plane = _on_one_plane(begin, end)
    begin, end = begin[of_plane], end[of_plane]
    state, before, now, count = np.zeros(STATES), previous, current, 0
    H = information
    for _ in range(ROUNDS):
        H, b = information.copy(), -information @ state
        if gyro is not None:
            rows, sway = gyro
            weight = 1.0 / (GYRO_RADPS * seconds) ** 2
            H += weight * rows.T @ rows
            b += weight * rows.T @ (sway - rows @ state)
        if len(begin) >= LEAST_POINTS:
            jacobian, residual, count = _floor_rows(before, now, begin, end)
            H += jacobian.T @ jacobian
            b += jacobian.T @ residual
        state = state + np.linalg.solve(H, b)
        before, now = _corrected(previous, state[:4], state[8:]), _corrected(current, state[4:8])
    return PairPose(before, now, np.linalg.inv(H), count)


def sway_by_gyro(
    rate_body: Float[np.ndarray, "3"],
    seconds: float,
    T_body_camera_before: Pose3,
    T_body_camera: Pose3,
    yaw_rad: float,
) -> Float[np.ndarray, "2"] | None:
    """`sway_world` of `estimate`: what the gyro measures beyond the joints.

    Args:
        rate_body: Mean angular velocity of the trunk since the previous picture, body axes, rad/s.
        seconds: Time between the pictures.
        T_body_camera_before, T_body_camera: Cameras of the two pictures by the joints.
        yaw_rad: Heading of the body in the world frame.

    Returns:
        None if the reading is not finite, or the head turned: the joints then mix head and trunk.
    """
    turned = T_body_camera.rotation @ T_body_camera_before.rotation.T
    by_joints = cv2.Rodrigues(turned)[0][:, 0]
    if not np.isfinite(rate_body).all() or np.linalg.norm(by_joints) > HEAD_RESTS_RAD:
        return None
    x, y, _ = rate_body * seconds - by_joints
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([c * x - s * y, s * x + c * y])


def _on_one_plane(
    begin: Float[np.ndarray, "n 2"], end: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, "n"]:
    """Corners that agree with the homography of most of them; none if there is no such majority, as in noise."""
    if len(begin) < LEAST_POINTS:
        return np.zeros(len(begin), bool)
    _, inside = cv2.findHomography(begin, end, cv2.RANSAC, OFF_PLANE_PX)
    if inside is None or 2 * np.count_nonzero(inside) < len(begin):
        return np.zeros(len(begin), bool)
    return np.asarray(inside)[:, 0] > 0


def _floor_rows(
    before: Picture, now: Picture, begin: np.ndarray, end: np.ndarray
) -> tuple[Float[np.ndarray, "m 10"], Float[np.ndarray, "m"], int]:
    """Whitened, weighted rows of the floor points: what the errors do to their pixels, and how far these are off.

    All derivatives are taken at the predicted pixels: at the tracked ones their noise would bias the tilt.
    """
    places = floor_points(begin, before.camera, before.T_world_camera, FARTHEST_M)
    known = np.isfinite(places).all(axis=1)
    places, end = places[known], end[known]
    pixels = project(places, now.camera, now.T_world_camera)
    if len(places) < LEAST_POINTS or not np.isfinite(pixels).all():
        return np.zeros((0, STATES)), np.zeros(0), 0
    by_error = np.zeros((len(places), 2, STATES))
    by_error[..., :4] = pose_jacobian(places, before.T_world_camera)
    by_error[..., 4:8] = -pose_jacobian(places, now.T_world_camera)
    by_error[..., 8:] = np.eye(2)
    to_px = np.linalg.inv(pixel_jacobian(pixels, places, now.camera, now.T_world_camera))
    off_px = end - pixels
    spread = 1.4826 * float(np.median(np.abs(off_px - np.median(off_px, axis=0))))
    sigma = max(spread, CORNER_SIGMA_PX)
    size = np.hypot(*off_px.T) / sigma
    weight = np.sqrt(np.minimum(1.0, TAIL / np.maximum(size, 1e-9))) / sigma
    rows = weight[:, None, None] * (to_px @ by_error)
    return rows.reshape(-1, STATES), (weight[:, None] * off_px).ravel(), len(places)


def _gyro_rows(
    previous: Picture, current: Picture, sway_world: np.ndarray | None
) -> tuple[Float[np.ndarray, "2 10"], Float[np.ndarray, "2"]] | None:
    """Rows of the gyro: the tilt errors of the current less those of the previous camera, world axes."""
    if sway_world is None:
        return None
    rows = np.zeros((2, STATES))
    for first, picture, sign in ((0, previous, -1.0), (4, current, 1.0)):
        x, y = viewing_direction(picture.T_world_camera)
        rows[:, first], rows[:, first + 2] = sign * np.array([-y, x]), sign * np.array([x, y])
    return rows, np.asarray(sway_world)


def _corrected(
    picture: Picture, error: Float[np.ndarray, "4"], displaced: np.ndarray | None = None
) -> Picture:
    """The picture with its pose turned and moved."""
    pose = picture.T_world_camera
    x, y = viewing_direction(pose)
    pitch, yaw, roll, height = error
    vector = pitch * np.array([-y, x, 0.0]) + roll * np.array([x, y, 0.0])
    vector[2] = yaw
    turn = np.asarray(cv2.Rodrigues(vector)[0])
    moved = pose.position + np.array([*(np.zeros(2) if displaced is None else displaced), height])
    return replace(picture, T_world_camera=Pose3.from_rotation(turn @ pose.rotation, moved))
