"""Ground-truth depth images by ray casting, and the noise of simulated structured-light depth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from perception.depth.structured_light import StructuredLightConfig
from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3
from sim.world import World


def true_depth(world: World, camera: Camera, T_world_camera: Pose3) -> Float[np.ndarray, "h w"]:
    """Depth of the surface that each pixel's ray meets, along the optical axis, m."""
    length = np.linalg.norm(camera.rays, axis=-1)
    rays = (camera.rays / length[..., None]).reshape(-1, 3) @ T_world_camera.rotation.T
    hits = world.rays.cast(T_world_camera.position, rays.astype(np.float32))
    return np.asarray(hits.distance_m.reshape(length.shape) / length, dtype=np.float64)


def structured_light_sigma(z: np.ndarray) -> np.ndarray:
    """Standard deviation of structured-light depth, m, at a true depth z, m.

    Source: Nguyen, Izadi, Lovell 2012, axial noise.
    """
    noise = StructuredLightConfig()
    return np.asarray(noise.floor_m + noise.growth_per_m * (z - noise.start_m) ** 2)
