"""Two depth images of one room laid upon each other: points against the planes they fall on.

Each point of the one is looked up in the other's image (no search), and pulled along the normal it meets
there. The gate narrows as the images fall into place; a hull of large residuals counts little (Huber).

Source: Chen and Medioni 1991 (point to plane), Blais and Levine 1995 (look up by projection).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError
from perception.primitives.frame import Depth
from perception.primitives.pose import Pose3


@dataclass(frozen=True)
class SurfaceConfig:
    """How two images are laid upon each other."""

    columns: int = 160  # ours: images are thinned to about this width
    gates_m: tuple[float, ...] = (0.15, 0.10, 0.07, 0.05)  # ours: three rounds each
    rounds: int = 4
    least_cosine: float = 0.7  # ours: between the normals
    least_share: float = (
        0.10  # ours: of the points that must find a partner, else there is no result
    )
    alike: float = 30.0  # ours: neighbouring residuals are alike, so that many count as one
    least_m: float = 0.0005  # ours: however well two images agree, none is exact to less than this

    def __post_init__(self) -> None:
        if self.columns < 16 or self.rounds < 1 or not self.gates_m:
            raise ConfigError("surfaces: columns must be 16 or more, rounds and gates at least one")
        if not 0.0 < self.least_share < 1.0:
            raise ConfigError(f"surfaces: least_share={self.least_share} must lie in (0, 1)")
        if not self.alike >= 1.0:
            raise ConfigError(f"surfaces: alike={self.alike} must be at least 1")
        if not self.least_m > 0.0:
            raise ConfigError(f"surfaces: least_m={self.least_m} must be positive")


@dataclass(frozen=True, eq=False)
class Surface:
    """A thinned depth image as points with normals, camera frame, NaN where there is none."""

    points: Float[np.ndarray, "h w 3"]
    normals: Float[np.ndarray, "h w 3"]
    sigma: Float[np.ndarray, "h w"]
    camera: Camera


def surface(depth: Depth, config: SurfaceConfig) -> Surface:
    """Points and normals of a depth image, thinned after a median filter of 5 px."""
    stride = max(1, round(depth.camera.width / config.columns))
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
    torn = np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2])) > 0.1 * z  # a rim, no surface
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
    """How one view lies to another.

    Args:
        T_to_from: Pose of the source in the target.
        covariance: Rotation (rad^2), then translation (m^2), in the source's axes.
        share: Of the source's points that met the target.
        rms_m: Of what remains along the normals.
    """

    T_to_from: Pose3
    covariance: Float[np.ndarray, "6 6"]
    share: float
    rms_m: float


def align(
    target: Surface,
    source: Surface,
    start: Pose3,
    config: SurfaceConfig | None = None,
    still_m: float = math.inf,
) -> Alignment | None:
    """Lay the source upon the target.

    Args:
        target: The one that stays.
        source: The one that moves.
        start: T_target_source, good to a few degrees and half the first gate.
        config: Gates and rounds.
        still_m: Deviation of the start's position. Where a camera only turned, a wall that fills the
            overlap would else let it slide along. The covariance tells of the surfaces alone.

    Returns:
        None if too few points meet, or what meets leaves a direction open.
    """
    config = config or SurfaceConfig()
    known = np.isfinite(source.normals).all(axis=-1)
    points, normals, sigma = source.points[known], source.normals[known], source.sigma[known]
    rotation, translation = start.rotation, start.position
    square, share, hessian = np.nan, 0.0, np.eye(6)
    for gate in config.gates_m:
        for _ in range(config.rounds):
            met = _meet(target, points, normals, rotation, translation, gate, config)
            share = len(met[0]) / max(len(points), 1)
            if share < config.least_share:
                return None
            index, normal, off = met
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
            hold[3:] = config.alike * square * float(np.mean(weight)) / still_m**2
            gradient[3:] += hold[3:] * (rotation.T @ (translation - start.position))
            step = -np.linalg.solve(hessian + np.diag(hold), gradient)
            translation = translation + rotation @ step[3:]
            rotation = rotation @ Rotation.from_rotvec(step[:3]).as_matrix()
            hessian *= len(index) / np.sum(weight)
    covariance = config.alike * max(square, config.least_m**2) * np.linalg.inv(hessian)
    return Alignment(
        Pose3.from_rotation(rotation, translation), covariance, share, float(np.sqrt(square))
    )


def _meet(
    target: Surface,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
    gate_m: float,
    config: SurfaceConfig,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points meet the target, the normals there, and how far off they are along these, m."""
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
        alike = np.einsum("ij,ij->i", normal, normals[index] @ rotation.T) > config.least_cosine
    kept = near & alike
    return index[kept], normal[kept], np.einsum("ij,ij->i", normal[kept], gap[kept])
