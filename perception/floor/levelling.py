"""Levelling: correct tilt and height of a camera pose by the measured floor.

Joint angles of a head have errors of half a degree and more; the measured floor is more accurate. The smallest
rotation that makes the floor horizontal, and its offset, replace tilt and height of the camera. Heading and
position on the floor stay those of the joints or the given pose.

Source: seed 003, section 2.2 (range to the floor frame); the correction is ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from ..primitives.pose import Pose3

UP = np.array([0.0, 0.0, 1.0])


def rotation_between(
    source: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation that turns one unit vector into another (Rodrigues)."""
    axis = np.cross(source, target)
    cosine = float(source @ target)
    if cosine < -1.0 + 1e-9:  # opposite: half a turn about any perpendicular axis
        across = np.eye(3)[int(np.argmin(np.abs(source)))]
        axis = np.cross(source, across)
        axis /= np.linalg.norm(axis)
        return np.asarray(2.0 * np.outer(axis, axis) - np.eye(3))
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + cosine))


def level(T_body_camera: Pose3, floor: Plane) -> Pose3:
    """Pose of the camera on the body, with tilt and height by the measured floor.

    Args:
        T_body_camera: By joint angles or a given pose, in an upright frame with the floor near z = 0.
        floor: Measured floor, camera frame; normal up, offset the camera height, m.

    Returns:
        T_body_camera that maps the floor to z = 0 exactly; x and y of the camera are unchanged.
    """
    normal_body = T_body_camera.rotation @ floor.normal
    rotation = rotation_between(normal_body, UP) @ T_body_camera.rotation
    x, y, _ = T_body_camera.translation
    return Pose3.from_rotation(rotation, np.array([x, y, floor.offset_m]))


def camera_above_floor(floor: Plane) -> Pose3:
    """Pose of a handheld camera in a body frame on the floor straight below it.

    Args:
        floor: The floor in the camera frame, m.

    Returns:
        T_body_camera; x of the body frame is the direction of the optical axis, or of the upper image edge
        where the camera looks straight down.
    """
    up = floor.normal
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(ahead) < math.sin(math.radians(2.0)):
        ahead = np.array([0.0, -1.0, 0.0]) + up[1] * up
    ahead /= np.linalg.norm(ahead)
    rotation = np.stack([ahead, np.cross(up, ahead), up])
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, floor.offset_m]))
