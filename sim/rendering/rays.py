"""Ray casting by Embree through Open3D: distance, incidence angle and albedo; imported on first use.

All simulated ranges come from here. They agree with the images because both use the same patches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from perception.primitives.errors import SurefootError

from ..scene import Scene
from ..shapes import Patch, patches, rectangle

MISSING_LIBRARIES = (
    "Open3D does not load ({reason}); on Debian or Ubuntu run: "
    "apt-get install --no-install-recommends libegl1 libgl1 libx11-6 libusb-1.0-0"
)


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


class RayCaster:
    """The scene as triangles; `place` the moving objects before casting."""

    def __init__(self, scene: Scene) -> None:
        self._o3d = open3d_library()
        floor = floor_patch(scene)
        still = [(floor, scene.floor_albedo)]
        for item in scene.static_objects:
            still += [(patch, item.albedo) for part in item.parts for patch in patches(part)]
        self._still = _mesh(still)
        self._moving = [
            _mesh(
                [
                    (patch, moving_object.albedo)
                    for part in moving_object.parts
                    for patch in patches(part)
                ]
            )
            for moving_object in scene.moving_objects
        ]
        self._places: tuple[tuple[float, float], ...] | None = None
        self._embree: Any = None
        self._albedo = [
            self._still.albedo,
            *(moving_object.albedo for moving_object in self._moving),
        ]

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m; rebuilding takes 1 to 2 ms."""
        if self._embree is not None and tuple(where) == self._places:
            return
        self._places = tuple(where)
        tensor = self._o3d.core.Tensor
        self._embree = self._o3d.t.geometry.RaycastingScene()
        self._embree.add_triangles(tensor(self._still.vertices), tensor(self._still.triangles))
        for moving_object, (x, y) in zip(self._moving, self._places, strict=True):
            moved = moving_object.vertices + np.array([x, y, 0.0], np.float32)
            self._embree.add_triangles(tensor(moved), tensor(moving_object.triangles))

    def cast(self, origin: Float[np.ndarray, "3"], directions: Float32[np.ndarray, "n 3"]) -> Hits:
        """Cast rays from one point along unit directions, world frame, m."""
        if self._embree is None:
            raise SurefootError(
                "rays cast before the moving objects were placed; call place() first"
            )
        rays = np.empty((len(directions), 6), np.float32)
        rays[:, :3] = origin
        rays[:, 3:] = directions
        answer = self._embree.cast_rays(self._o3d.core.Tensor(rays))
        distance = answer["t_hit"].numpy()
        met = np.isfinite(distance)
        normals = answer["primitive_normals"].numpy()
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions)) * met
        albedo = np.zeros(len(rays), np.float32)
        geometry = answer["geometry_ids"].numpy()
        primitive = answer["primitive_ids"].numpy()
        for index, table in enumerate(self._albedo):
            mine = met & (geometry == index)
            albedo[mine] = table[primitive[mine]]
        return Hits(distance, cosine.astype(np.float32), albedo)


@dataclass(frozen=True, eq=False)
class _Mesh:
    vertices: Float32[np.ndarray, "n 3"]
    triangles: np.ndarray
    albedo: Float32[np.ndarray, "m"]


def floor_patch(scene: Scene) -> Patch:
    """The floor inside the walls."""
    x0, y0, x1, y1 = scene.extent
    return rectangle(
        np.array([x0, y1, 0.0]),
        np.array([x1 - x0, 0.0, 0.0]),
        np.array([0.0, y0 - y1, 0.0]),
        scene.floor[0].material,
    )


def _mesh(surfaces: list[tuple[Patch, float]]) -> _Mesh:
    vertices, triangles, albedo = [], [], []
    count = 0
    for patch, value in surfaces:
        vertices.append(patch.vertices)
        triangles.append(patch.triangles + count)
        albedo.append(np.full(len(patch.triangles), value, np.float32))
        count += len(patch.vertices)
    return _Mesh(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(triangles).astype(np.uint32),
        np.concatenate(albedo),
    )


def open3d_library() -> Any:
    """Import Open3D, which takes a second.

    Raises:
        SurefootError: Open3D does not load; says what to install.
    """
    try:
        import open3d
    except ImportError as error:
        raise SurefootError(MISSING_LIBRARIES.format(reason=error)) from error
    return open3d
