"""Projection between pixels and the floor z = 0, which gives a single camera its depth.

Source: Han 2018 (seed 000), eq. (1) and (2) corrected: T_world_camera = T(P_c) R_Z R_Y R_X R_opt. As printed, the
rotation also applies to the position of the camera.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from ..primitives.camera import Camera
from ..primitives.pose import CAMERA_IN_BODY_AXES, Pose3

FARTHEST_M = 6.0  # seed 000: d_max; beyond, a pixel covers 0.25 m
_VERTICAL = 1e-6  # shorter horizontal parts of the optical axis have no direction


def camera_pose(
    position: Float[np.ndarray, "3"], yaw_rad: float, pitch_rad: float, roll_rad: float
) -> Pose3:
    """T_world_camera from position and angles.

    Args:
        position: P_c, world frame, m.
        yaw_rad, pitch_rad, roll_rad: alpha (left), beta (down) and gamma (right).

    Source: seed 000, eq. (2) corrected.
    """
    cz, sz = math.cos(yaw_rad), math.sin(yaw_rad)
    cy, sy = math.cos(pitch_rad), math.sin(pitch_rad)
    cx, sx = math.cos(roll_rad), math.sin(roll_rad)
    R_Z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    R_Y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    R_X = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return Pose3.from_rotation(R_Z @ R_Y @ R_X @ CAMERA_IN_BODY_AXES, position)


def floor_points(
    pixels: Float[np.ndarray, "*n 2"],
    camera: Camera,
    T_world_camera: Pose3,
    farthest_m: float = FARTHEST_M,
) -> Float[np.ndarray, "*n 2"]:
    """Intersections of the rays of pixels (u, v) with the floor, (x, y) in the world frame, m.

    Args:
        pixels: May lie outside the picture.
        camera: Intrinsics of the picture.
        T_world_camera: Its pose above the floor z = 0.
        farthest_m: Maximum length of a ray.

    Returns:
        NaN for rays that do not point downwards or are longer.

    Source: seed 000, section 3: r = R K^-1 (u, v, 1), P_w = P_c - (P_c,z / r_z) r.
    """
    rays = camera.back_project(pixels, np.ones(pixels.shape[:-1]))
    r = rays @ T_world_camera.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        along = -T_world_camera.position[2] / r[..., 2]
        reach = along * np.linalg.norm(r, axis=-1)
        along = np.where((along > 0.0) & (reach < farthest_m), along, np.nan)
    return np.asarray(T_world_camera.position[:2] + along[..., None] * r[..., :2])


def project(
    points_world: Float[np.ndarray, "*n 2"], camera: Camera, T_world_camera: Pose3
) -> Float[np.ndarray, "*n 2"]:
    """Pixels (u, v) of floor points (x, y), world frame, m; NaN for points behind the camera."""
    on_floor = np.concatenate([points_world, np.zeros((*points_world.shape[:-1], 1))], axis=-1)
    return camera.project(T_world_camera.inverse().apply(on_floor))


def nearest_distance_m(camera: Camera, T_world_camera: Pose3) -> float:
    """Horizontal distance to the nearest floor in view (middle of the lowest row), m; NaN if none.

    Seed 000 states 0.16 m, which does not follow from its own angles.
    """
    lowest = np.array([camera.cx, camera.height - 1.0])
    point = floor_points(lowest, camera, T_world_camera, math.inf)
    return float(np.hypot(*(point - T_world_camera.position[:2])))


def viewing_direction(T_world_camera: Pose3) -> Float[np.ndarray, "2"]:
    """Horizontal viewing direction, unit (x, y); that of the upper edge of the picture if it looks straight down."""
    ahead = T_world_camera.rotation[:2, 2]
    if np.hypot(*ahead) < _VERTICAL:
        ahead = -T_world_camera.rotation[:2, 1]
    return np.asarray(ahead / np.hypot(*ahead))
