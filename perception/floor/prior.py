"""Where the floor should be before one looks: from the joints, or from next to nothing.

Source: seed 003, Fig. 4, step 2 (up vector predicted by the joint angles); the rest is ours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.plane import Plane
from ..primitives.pose import Pose3

HAND_TILT_RAD = math.radians(28.0)  # people hold cameras level or down; rolled by 20 deg at times
HAND_HEIGHT_M = 1.1  # between a small humanoid's head and a person's
HAND_HEIGHT_SIGMA_M = 1.5


def kinematic_prior(T_body_camera: Pose3, tilt_sigma_rad: float, height_sigma_m: float) -> Plane:
    """The floor by joint angles: z = 0 of the body frame, seen from the camera.

    Args:
        T_body_camera: Camera on the body.
        tilt_sigma_rad: Deviation of each tilt.
        height_sigma_m: Deviation of the camera's height.

    Returns:
        Plane in the camera frame, with covariance.
    """
    plane = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(T_body_camera.inverse())
    covariance = np.diag([tilt_sigma_rad**2, tilt_sigma_rad**2, height_sigma_m**2])
    return Plane(plane.normal, plane.offset_m, covariance)


def handheld_prior(up_camera: Float[np.ndarray, "3"] | None) -> Plane:
    """The floor for a camera in the hand: below it, at an unknown height.

    Args:
        up_camera: Up in the camera frame, if gravity is known; then it is good to a few degrees.

    Returns:
        Plane in the camera frame, with a covariance that says how little is known.
    """
    known = up_camera is not None
    up = up_camera / np.linalg.norm(up_camera) if up_camera is not None else np.array([0.0, -1.0, 0.0])
    tilt = math.radians(4.0) if known else HAND_TILT_RAD
    return Plane(up, HAND_HEIGHT_M, np.diag([tilt**2, tilt**2, HAND_HEIGHT_SIGMA_M**2]))
