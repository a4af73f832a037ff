"""Prior of the floor: from joint angles, from gravity, or from how a camera is usually held.

A prior is a `Plane` in the camera frame with its covariance. It limits the planes that are searched, and it is
fused with the measured plane as one more measurement.

Source: seed 003, section 3, Fig. 4 (normal predicted by the joint angles); the rest ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..primitives.errors import InputError
from ..primitives.plane import Plane
from ..primitives.pose import Pose3

HAND_UP = np.array([0.0, -1.0, 0.0])  # of a camera held level
HAND_TILT_RAD = math.radians(25.0)  # ours: handheld cameras pitch and roll by up to 50 deg
GRAVITY_TILT_RAD = math.radians(3.0)  # ours: gravity in handheld recordings is accurate to 1-3 deg
HAND_HEIGHT_M = 1.0  # ours: between ankle and head
HAND_HEIGHT_SIGMA_M = 1.0  # ours


class Gate(NamedTuple):
    """Planes that are searched: largest tilt from `up` and its cosine, range of the camera height."""

    up: Float[np.ndarray, "3"]
    tilt_rad: float
    least_cosine: float
    lowest_m: float
    highest_m: float


def kinematic_prior(T_body_camera: Pose3, tilt_sigma_rad: float, height_sigma_m: float) -> Plane:
    """The floor z = 0 of the body frame, in the camera frame, by joint angles.

    Args:
        T_body_camera: Camera on the body.
        tilt_sigma_rad: Standard deviation of either tilt of the camera.
        height_sigma_m: Standard deviation of the camera height.

    Raises:
        InputError: A standard deviation is not positive and finite, or the camera is not above the floor.
    """
    for name, value in (("tilt_sigma_rad", tilt_sigma_rad), ("height_sigma_m", height_sigma_m)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"floor prior: {name}={value} must be positive and finite")
    height = T_body_camera.translation[2]
    if not height > 0.0:
        raise InputError(
            f"floor prior: the camera is {height} m above the floor of the body frame; it must be "
            "above it, check T_body_camera"
        )
    up = T_body_camera.rotation.T @ np.array([0.0, 0.0, 1.0])
    return Plane(up, height, np.diag([tilt_sigma_rad**2, tilt_sigma_rad**2, height_sigma_m**2]))


def handheld_prior(up_camera: Float[np.ndarray, "3"] | None) -> Plane:
    """The floor below a handheld camera: 1 m below it, give or take 1 m.

    Args:
        up_camera: Up direction in the camera frame, from an inertial sensor or a given pose, of any length;
            None: the camera is held upright with a standard deviation of `HAND_TILT_RAD`.

    Raises:
        InputError: The direction has no length or is not finite.
    """
    if up_camera is None:
        up, tilt = HAND_UP, HAND_TILT_RAD
    else:
        length = float(np.linalg.norm(up_camera))
        if not (math.isfinite(length) and length > 0.0):
            raise InputError(f"floor prior: up_camera={up_camera} must be a direction")
        up, tilt = up_camera / length, GRAVITY_TILT_RAD
    return Plane(up, HAND_HEIGHT_M, np.diag([tilt**2, tilt**2, HAND_HEIGHT_SIGMA_M**2]))


def gate(prior: Plane, sigmas: float, most_tilt_rad: float, least_height_m: float) -> Gate:
    """Planes within `sigmas` standard deviations of the prior, limited in tilt and height."""
    tilt = sigmas * math.sqrt(float(np.linalg.eigvalsh(prior.covariance[:2, :2])[-1]))
    reach = sigmas * math.sqrt(float(prior.covariance[2, 2]))
    tilt = min(tilt, most_tilt_rad)
    return Gate(
        prior.normal,
        tilt,
        math.cos(tilt),
        max(prior.offset_m - reach, least_height_m),
        prior.offset_m + reach,
    )
