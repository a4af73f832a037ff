"""The complexity measure: obstacles to the right of straight ahead minus obstacles to the left.

Each obstacle counts by its apparent area and by how frontal it is. A positive sum means more obstacles on the right.

Source: Kang 2013 (seed 004), eq. (21), which is lost: near, frontal and large obstacles count more, left ones negatively.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import InputError

FORMS = ("frontal", "ratio", "integrated")
LEAST_THETA_RAD = math.radians(1.0)  # ours: limits the pole of `ratio` straight ahead


def complexity(
    edges_rad: Float[np.ndarray, "n 2"],
    distance_m: Float[np.ndarray, "n"],
    width_m: Float[np.ndarray, "n"],
    height_m: Float[np.ndarray, "n"],
    form: str = "integrated",
) -> Float[np.ndarray, "n"]:
    """CM of each obstacle, right positive, without unit ("ratio": 1/rad times m).

    Args:
        edges_rad: Azimuths of the left and the right edge, left positive.
        distance_m: Forward distance of the nearest point.
        width_m: Lateral extent.
        height_m: Above the floor.
        form: "frontal": sgn(theta) w h / d^2 cos(theta) of the middle; "ratio": w h / (d theta), probably the
            printed form; "integrated": h/d times the integral of cos over the azimuths, right part minus left
            part, which is continuous for an obstacle straight ahead.

    Raises:
        InputError: Unknown form, or a distance that is not positive.

    Source: seed 004, eq. (21); the forms are ours.
    """
    if form not in FORMS:
        raise InputError(f"complexity: form={form!r} is unknown; use one of {', '.join(FORMS)}")
    if not np.all(distance_m > 0.0):
        raise InputError(f"complexity: distance_m={distance_m} must be positive")
    theta_left, theta_right = (
        -edges_rad[:, 0],
        -edges_rad[:, 1],
    )  # theta of the paper: right positive
    theta = 0.5 * (theta_left + theta_right)
    if form == "frontal":
        return np.asarray(np.sign(theta) * width_m * height_m / distance_m**2 * np.cos(theta))
    if form == "ratio":
        size = np.maximum(np.abs(theta), LEAST_THETA_RAD)
        return np.asarray(np.sign(theta) * width_m * height_m / (distance_m * size))
    right = _sine(np.maximum(theta_right, 0.0)) - _sine(np.maximum(theta_left, 0.0))
    left = _sine(np.maximum(-theta_left, 0.0)) - _sine(np.maximum(-theta_right, 0.0))
    return np.asarray(height_m / distance_m * (right - left))


def _sine(angle_rad: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    return np.asarray(np.sin(np.minimum(angle_rad, math.pi / 2)))
