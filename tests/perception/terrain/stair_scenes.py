"""Depth of stairs and ramps in closed form: rays against rectangles."""

from __future__ import annotations

import math

import cv2
import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.frame import Depth, StereoView
from perception.primitives.plane import Plane
from perception.primitives.pose import Pose3, head_rotation

CAMERA = Camera.from_view(320, 240, math.radians(70.0), math.radians(55.0))
HALF_M = 0.7  # half the width of stairs and ramps
TILT_SIGMA = math.radians(1.2)
Rectangle = tuple[tuple[float, float], tuple[float, float], float]
"""Start and end (x ahead, z up) of a surface, and half its width, m."""


def stairs(
    riser: float, tread: float, steps: int, away: float, down: bool = False
) -> list[Rectangle]:
    """Treads and risers; down: seen from the top landing, which is at height 0."""
    sign = -1.0 if down else 1.0
    found: list[Rectangle] = [((-2.0, 0.0), (away, 0.0), 3.0)]
    for k in range(steps):
        x, low, high = away + k * tread, sign * k * riser, sign * (k + 1) * riser
        end = x + tread if k + 1 < steps else x + 3.0
        found += [((x, low), (x, high), HALF_M), ((x, high), (end, high), HALF_M)]
    return found


def ramp(slope_rad: float, away: float, length: float = 2.0) -> list[Rectangle]:
    """Level ground, then a ramp that rises by a slope."""
    end = (away + length, length * math.tan(slope_rad))
    return [((-2.0, 0.0), (away, 0.0), 3.0), ((away, 0.0), end, HALF_M)]


def pose(height: float, tilt: float, yaw: float = 0.0) -> Pose3:
    """A camera above the origin, tilted down."""
    return Pose3.from_rotation(head_rotation(yaw, tilt), np.array([0.0, 0.0, height]))


def look(
    surfaces: list[Rectangle], T: Pose3, noise_m: float, seed: int = 0, camera: Camera = CAMERA
) -> Depth:
    """Depth of the nearest surface along each ray, with independent noise; NaN beyond 4 m."""
    z, _ = _met(surfaces, T, camera)
    z[z > 4.0] = np.nan
    z = z + noise_m * np.random.default_rng(seed).standard_normal(z.shape)
    sigma = np.where(np.isfinite(z), noise_m, np.nan)
    return Depth(z.astype(np.float32), sigma.astype(np.float32), camera)


def _met(surfaces: list[Rectangle], T: Pose3, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the nearest surface along each ray, infinite without one, and the place on it: along, across, which."""
    rays = camera.rays @ T.rotation.T
    z, on = np.full(rays.shape[:2], np.inf), np.zeros((*rays.shape[:2], 3))
    for number, ((x0, z0), (x1, z1), half) in enumerate(surfaces):
        normal = np.array([z0 - z1, 0.0, x1 - x0])
        corner = np.array([x0, 0.0, z0])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = normal @ (corner - T.position) / (rays @ normal)
        place = T.position + np.where(np.isfinite(depth), depth, 0.0)[..., None] * rays
        long = math.hypot(x1 - x0, z1 - z0)
        along = (place - corner) @ np.array([x1 - x0, 0.0, z1 - z0]) / long
        inside = (along >= 0.0) & (along <= long) & (np.abs(place[..., 1]) <= half)
        nearest = (depth > 0.05) & inside & (depth < z)
        z = np.where(nearest, depth, z)
        on[nearest] = np.stack(np.broadcast_arrays(along, place[..., 1], number), -1)[nearest]
    return z, on


def surface_of(surfaces: list[Rectangle], T: Pose3, camera: Camera) -> np.ndarray:
    """Index of the surface that each pixel sees, -1 if none."""
    z, on = _met(surfaces, T, camera)
    return np.where(np.isfinite(z), on[..., 2], -1.0).astype(int)


def stereo_pair(surfaces: list[Rectangle], T: Pose3, seed: int) -> StereoView:
    """Pictures of the surfaces, each with a texture of its own, by two cameras 8 cm apart."""
    camera = Camera.from_view(320, 240, math.radians(60.0), math.radians(47.0))
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (1024, 1024)).astype(np.float32), (0, 0), 1)
    pictures = []
    for shift in (0.0, 0.08):
        place = T.position + shift * T.rotation[:, 0]
        _, on = _met(surfaces, Pose3.from_rotation(T.rotation, place), camera)
        x, y = on[..., 0] / 0.004 + 97.0 * on[..., 2], on[..., 1] / 0.004 + 300.0 * on[..., 2]
        grey = cv2.remap(
            texture, (x % 1023).astype(np.float32), (y % 1023).astype(np.float32), cv2.INTER_LINEAR
        )
        noisy = 3.0 * (grey - 127.5) + 127.5 + rng.normal(0.0, 2.0, grey.shape)
        pictures.append(np.clip(noisy, 0.0, 255.0).astype(np.uint8))
    return StereoView(pictures[0], pictures[1], 0.08, camera)


def matched(surfaces: list[Rectangle], T: Pose3, seed: int) -> Depth:
    """The same through a wide camera that matches a pattern: errors of disparity are alike in blocks of pixels, and claimed
    half as large again; where disparity jumps by a pixel or more, a block shows the nearer surface."""
    camera = Camera.from_view(424, 240, math.radians(87.0), math.radians(58.0))
    pull = 2.0 * camera.fx * 0.05  # half a pixel of the pictures that are matched, 5 cm apart
    exact = pull / look(surfaces, T, 0.0, camera=camera).z.astype(np.float64)
    nearer = cv2.dilate(np.nan_to_num(exact), np.ones((3, 3), np.uint8))
    exact = np.where(nearer - exact > 1.0, nearer, exact)
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(exact.shape), (9, 9), 1.5)
    z = pull / (exact + 0.08 * noise / noise.std())
    return Depth(z.astype(np.float32), (0.12 * z * z / pull).astype(np.float32), camera)


def prior(T: Pose3) -> Plane:
    """The true ground z = 0 in the camera frame, known to a degree and a centimetre."""
    true = Plane(np.array([0.0, 0.0, 1.0]), 0.0).moved(T.inverse())
    return Plane(true.normal, true.offset_m, np.diag([TILT_SIGMA**2, TILT_SIGMA**2, 1e-4]))
