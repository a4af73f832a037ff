"""The surfaces of a scene as a time-of-flight camera meets them, and what it measures there.

Ray casting (`rays`) and PyBullet's cameras (`numbered`) answer alike: both show these surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32, Int

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from ..scene import Scene
from ..shapes import Patch, Solid, patches, rectangle

LINK_ALBEDO = 0.5  # ours: infrared reflectance of a robot's shell


@dataclass(frozen=True, eq=False)
class Hits:
    """Results of n rays.

    Args:
        distance_m: Along the ray, infinite without a hit.
        cosine: Of the angle between ray and surface normal, 0 without a hit.
        albedo: Of the surface, 0 without a hit.
    """

    distance_m: Float32[np.ndarray, "n"]
    cosine: Float32[np.ndarray, "n"]
    albedo: Float32[np.ndarray, "n"]


@runtime_checkable
class RangeSource(Protocol):
    """What is seen of a scene from a pose."""

    def look(self, camera: Camera, T_world_camera: Pose3) -> Hits:
        """What the ray of each pixel meets, row by row."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Triangles, and the infrared reflectance of each, world frame or about the origin of a moving object, m."""

    vertices: Float32[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    albedo: Float32[np.ndarray, "m"]


def scene_surfaces(scene: Scene) -> tuple[Surfaces, list[Surfaces]]:
    """Surfaces of all static objects with the floor, and of each moving body."""
    still = [(floor_patch(scene), scene.floor_albedo)]
    for item in scene.static_objects:
        still += [(patch, item.albedo) for part in item.parts for patch in patches(part)]
    moving = [
        [(patch, albedo) for part in parts for patch in patches(part)]
        for _, parts, albedo in scene.moving_bodies
    ]
    return _joined(still), [_joined(parts) for parts in moving]


def link_surfaces(links: Sequence[Sequence[Solid]]) -> list[Surfaces]:
    """Surfaces of the robot's own links, each about its own frame."""
    return [
        _joined([(patch, LINK_ALBEDO) for part in parts for patch in patches(part)])
        for parts in links
    ]


def floor_patch(scene: Scene) -> Patch:
    """The floor inside the walls."""
    x0, y0, x1, y1 = scene.extent
    return rectangle(
        np.array([x0, y1, 0.0]),
        np.array([x1 - x0, 0.0, 0.0]),
        np.array([0.0, y0 - y1, 0.0]),
        scene.floor[0].material,
    )


@cache
def unit_rays(camera: Camera) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """Unit rays of a camera's pixels, row by row, in its frame, and their length at depth 1; cached."""
    rays = camera.rays.reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    return (rays / length[:, None]).astype(np.float32), length.astype(np.float32)


def _joined(surfaces: list[tuple[Patch, float]]) -> Surfaces:
    vertices, triangles, albedo = [], [], []
    count = 0
    for patch, value in surfaces:
        vertices.append(patch.vertices)
        triangles.append(patch.triangles + count)
        albedo.append(np.full(len(patch.triangles), value, np.float32))
        count += len(patch.vertices)
    return Surfaces(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(triangles).astype(np.int64),
        np.concatenate(albedo),
    )
