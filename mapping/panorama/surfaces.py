"""Alignment of two depth images: point to plane, with association by projection.

Each point of the source is projected into the target image and moved along the normal it finds there. The
gate narrows with the iterations; large residuals get little weight (Huber).

Source: Chen and Medioni 1991 (point to plane), Blais and Levine 1995 (association by projection).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.camera import Camera
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3

COLUMNS = 160  # ours: images are subsampled to about this width
GATES_M = (0.15, 0.10, 0.07, 0.05)  # ours
ROUNDS = 4  # ours: iterations per gate
LEAST_COSINE = 0.7  # ours: between the normals of associated points
LEAST_SHARE = 0.10  # ours: of the points that must be associated
CORRELATED = 30.0  # ours: neighbouring residuals with common errors, which count as one
LEAST_SIGMA_M = 0.0005  # ours: smallest residual assumed in the covariance


@dataclass(frozen=True, eq=False)
class Surface:
    """A subsampled depth image as points with normals, camera frame, NaN where unknown."""

    points: Float[np.ndarray, "h w 3"]
    normals: Float[np.ndarray, "h w 3"]
    sigma: Float[np.ndarray, "h w"]
    camera: Camera


def surface(depth: Depth) -> Surface:
    """Points and normals of a depth image, subsampled after a median filter of 5 px."""
    stride = max(1, round(depth.camera.width / COLUMNS))
    z = np.nan_to_num(depth.z, nan=0.0)
    z = cv2.medianBlur(z, 5)
    measured = (z > 0.0) & np.isfinite(depth.z) & np.isfinite(depth.sigma)
    z = np.where(measured, z, np.nan)[::stride, ::stride].astype(np.float64)
    rays = depth.camera.rays[::stride, ::stride]
    points = rays * z[..., None]
    across, down = np.full_like(points, np.nan), np.full_like(points, np.nan)
    across[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normals = np.cross(down, across)
    torn = (
        np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2])) > 0.1 * z
    )  # a depth discontinuity
    with np.errstate(invalid="ignore", divide="ignore"):
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[torn] = np.nan
    c = depth.camera
    thin = Camera(
        z.shape[1], z.shape[0], c.fx / stride, c.fy / stride, c.cx / stride, c.cy / stride,
        c.distortion,
    )  # fmt: skip
    return Surface(points, normals, depth.sigma[::stride, ::stride].astype(np.float64), thin)


@dataclass(frozen=True)
class Alignment:
    """Relative pose of two views.

    Args:
        T_to_from: Pose of the source in the target.
        covariance: Rotation (rad^2), then translation (m^2), in the source's axes.
    """

    T_to_from: Pose3
    covariance: Float[np.ndarray, "6 6"]


def align(
    target: Surface,
    source: Surface,
    start: Pose3,
    position_sigma_m: float = math.inf,
) -> Alignment | None:
    """Align the source with the target.

    Args:
        target: The fixed surface.
        source: The surface to move.
        start: T_target_source, accurate to a few degrees and half the first gate.
        position_sigma_m: Standard deviation of the start's position. If the camera only rotated, it stops
            the source from sliding along a wall that fills the overlap. The covariance ignores it.

    Returns:
        None if too few points are associated, or they leave a degree of freedom unobservable.
    """
    known = np.isfinite(source.normals).all(axis=-1)
    points, normals, sigma = source.points[known], source.normals[known], source.sigma[known]
    rotation, translation = start.rotation, start.position
    square, hessian = np.nan, np.eye(6)
    for gate in GATES_M:
        for _ in range(ROUNDS):
            found = _associate(target, points, normals, rotation, translation, gate)
            if len(found[0]) / max(len(points), 1) < LEAST_SHARE:
                return None
            index, normal, off = found
            across = normal @ rotation  # normal in the source's axes
            jacobian = np.concatenate([np.cross(points[index], across), across], axis=1)
            scale = 1.4826 * float(np.median(np.abs(off))) + 1e-6
            weight = 1.0 / np.maximum(np.abs(off), 1.5 * scale)
            weight /= 1.0 + (sigma[index] / np.median(sigma[index])) ** 2
            hessian = jacobian.T @ (weight[:, None] * jacobian)
            if np.linalg.cond(hessian) > 1e9:
                return None
            square = float(np.sum(weight * off**2) / np.sum(weight))
            gradient = jacobian.T @ (weight * off)
            hold = np.zeros(6)
            hold[3:] = CORRELATED * square * float(np.mean(weight)) / position_sigma_m**2
            gradient[3:] += hold[3:] * (rotation.T @ (translation - start.position))
            step = -np.linalg.solve(hessian + np.diag(hold), gradient)
            translation = translation + rotation @ step[3:]
            rotation = rotation @ Rotation.from_rotvec(step[:3]).as_matrix()
            hessian *= len(index) / np.sum(weight)
    covariance = CORRELATED * max(square, LEAST_SIGMA_M**2) * np.linalg.inv(hessian)
    return Alignment(Pose3.from_rotation(rotation, translation), covariance)


def _associate(
    target: Surface,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
    gate_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the associated points, the target normals there, and the residuals along them, m."""
    moved = points @ rotation.T + translation
    pixels = target.camera.project(moved)
    with np.errstate(invalid="ignore"):
        index = np.flatnonzero(target.camera.contains(pixels) & np.isfinite(pixels[:, 0]))
    u, v = np.rint(pixels[index]).astype(int).T
    u, v = np.clip(u, 0, target.camera.width - 1), np.clip(v, 0, target.camera.height - 1)
    normal, place = target.normals[v, u], target.points[v, u]
    gap = moved[index] - place
    with np.errstate(invalid="ignore"):
        near = np.einsum("ij,ij->i", gap, gap) < gate_m**2
        similar = np.einsum("ij,ij->i", normal, normals[index] @ rotation.T) > LEAST_COSINE
    kept = near & similar
    return index[kept], normal[kept], np.einsum("ij,ij->i", normal[kept], gap[kept])
