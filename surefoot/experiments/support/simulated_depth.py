"""Ground-truth depth images by ray casting, and the noise of simulated structured-light depth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from perception.depth.structured_light import StructuredLightConfig
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3
from sim.world import World

OUTLINE_M = 0.03  # a larger second difference of depth marks an edge
FOCAL_BASELINE_PX_M = 43.5  # Kinect: 580 px, 75 mm
BEND_PX = 0.2  # Herrera 2012 and Boehm 2014: disparity errors of Kinects before calibration
SCALE_SHARE = 0.01  # D400: 2 % at most; Sturm 2012: Kinects 0 to 3.5 %
FOCAL_SHARE = 0.005  # ours: of intrinsics that come with a recording


def true_depth(world: World, camera: Camera, T_world_camera: Pose3) -> Float[np.ndarray, "h w"]:
    """Depth of the surface that each pixel's ray meets, along the optical axis, m."""
    length = np.linalg.norm(camera.rays, axis=-1)
    rays = (camera.rays / length[..., None]).reshape(-1, 3) @ T_world_camera.rotation.T
    hits = world.rays.cast(T_world_camera.position, rays.astype(np.float32))
    return np.asarray(hits.distance_m.reshape(length.shape) / length, dtype=np.float64)


def on_one_surface(depth: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels on a smooth surface: the second difference of depth is small along rows and columns."""
    filled = np.where(np.isfinite(depth), depth, 1e3)
    bends = [np.abs(ndimage.convolve1d(filled, [1.0, -2.0, 1.0], axis=axis)) for axis in (0, 1)]
    smooth = np.maximum(*bends) < OUTLINE_M
    return np.asarray(ndimage.binary_erosion(smooth) & np.isfinite(depth))


def structured_light_bend(
    z: Float[np.ndarray, "h w"], rays: Float[np.ndarray, "h w 3"], rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """Random relative error of structured-light depth: scale, and a disparity error of second order.

    Args:
        z: True depth, m.
        rays: Slopes (right, down, 1) of the pixels.
        rng: Draws the seven coefficients.
    """
    u, v = (rays[..., axis] / float(np.max(np.abs(rays[..., 0]))) for axis in (0, 1))
    shapes = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    disparity_px = shapes @ (BEND_PX * rng.normal(size=6))
    return np.asarray(SCALE_SHARE * rng.normal() + z * disparity_px / FOCAL_BASELINE_PX_M)


def structured_light_sigma(z: np.ndarray) -> np.ndarray:
    """Standard deviation of structured-light depth, m, at a true depth z, m.

    Source: Nguyen, Izadi, Lovell 2012, axial noise.
    """
    noise = StructuredLightConfig()
    return np.asarray(noise.floor_m + noise.growth_per_m * (z - noise.start_m) ** 2)
