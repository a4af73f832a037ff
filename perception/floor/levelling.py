"""Stand the camera upright: joint angles or a given pose, corrected by the floor that is seen.

A head's joint angles are off by a good half degree, the floor seen is not. The smallest rotation that
makes the seen floor horizontal and puts it at height zero replaces tilt and height of the camera; its
heading and its place on the floor stay what joints or the given pose say.

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
    if cosine < -1.0 + 1e-9:  # opposite: half a turn about any axis across
        across = np.eye(3)[int(np.argmin(np.abs(source)))]
        axis = np.cross(source, across)
        axis /= np.linalg.norm(axis)
        return np.asarray(2.0 * np.outer(axis, axis) - np.eye(3))
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + cosine))


def level(T_body_camera: Pose3, floor: Plane) -> Pose3:
    """The camera on the body with the tilt and height that the seen floor gives it.

    Args:
        T_body_camera: Camera by joint angles, or by a given pose, in an upright frame with the floor near
            z = 0.
        floor: The floor in the camera frame, normal up, offset the camera's height, m.

    Returns:
        T_body_camera whose image of the floor is z = 0 exactly; x and y of the camera unchanged, m.
    """
    normal_body = T_body_camera.rotation @ floor.normal
    rotation = rotation_between(normal_body, UP) @ T_body_camera.rotation
    x, y, _ = T_body_camera.translation
    return Pose3.from_rotation(rotation, np.array([x, y, floor.offset_m]))


def shadow(floor: Plane) -> Pose3:
    """The camera in a body frame of its own: on the floor below it, x where the camera looks.

    Args:
        floor: The floor in the camera frame, m.

    Returns:
        T_body_camera for a camera in the hand: origin straight below the camera, heading of its
        optical axis, or of its upper image edge where it looks straight down.
    """
    up = floor.normal
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(ahead) < math.sin(math.radians(2.0)):
        ahead = np.array([0.0, -1.0, 0.0]) + up[1] * up
    ahead /= np.linalg.norm(ahead)
    rotation = np.stack([ahead, np.cross(up, ahead), up])
    return Pose3.from_rotation(rotation, np.array([0.0, 0.0, floor.offset_m]))
