"""Ray casting by Embree through Open3D: distance, incidence angle and albedo; imported on first use.

The reference of the renderers, and optionally the source of the simulated ranges. Rays agree with the images because
both use the same patches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from perception.primitives.camera import Camera
from perception.primitives.errors import SurefootError
from perception.primitives.pose import Pose3

from ..scene import Scene
from ..shapes import Solid
from .surfaces import Hits, link_surfaces, scene_surfaces, unit_rays

MISSING_LIBRARIES = (
    "Open3D does not load ({reason}); on Debian or Ubuntu run: "
    "apt-get install --no-install-recommends libegl1 libgl1 libx11-6 libusb-1.0-0"
)


class RayCaster:
    """The scene as triangles; `place` the moving objects before casting."""

    def __init__(self, scene: Scene, links: Sequence[Sequence[Solid]] = ()) -> None:
        self._o3d = open3d_library()
        self._still, self._moving = scene_surfaces(scene)
        self._places: tuple[tuple[float, float], ...] | None = None
        self._links = link_surfaces(links)
        self._poses: tuple[Pose3, ...] = ()
        self._embree: Any = None
        self._albedo = [part.albedo for part in (self._still, *self._moving, *self._links)]

    def place(self, where: Sequence[tuple[float, float]], poses: Sequence[Pose3] = ()) -> None:
        """Move the moving objects to these (x, y), m, and the robot's links; rebuilding takes 1 to 2 ms."""
        same = tuple(where) == self._places and tuple(poses) == self._poses
        if self._embree is not None and same:
            return
        self._places, self._poses = tuple(where), tuple(poses)
        self._embree = self._o3d.t.geometry.RaycastingScene()
        self._add(self._still.vertices, self._still.triangles)
        for moving_object, (x, y) in zip(self._moving, self._places, strict=True):
            moved = moving_object.vertices + np.array([x, y, 0.0], np.float32)
            self._add(moved, moving_object.triangles)
        for link, T_world_link in zip(self._links, self._poses, strict=True):
            self._add(T_world_link.apply(link.vertices).astype(np.float32), link.triangles)

    def look(self, camera: Camera, T_world_camera: Pose3) -> Hits:
        """What the ray of each pixel meets, row by row."""
        rays, _ = unit_rays(camera)
        turned = rays @ np.ascontiguousarray(T_world_camera.rotation.T, dtype=np.float32)
        return self.cast(T_world_camera.position, turned)

    def shows_links(self, camera: Camera, T_world_camera: Pose3) -> Bool[np.ndarray, "n"]:
        """Which pixels show the robot itself, row by row."""
        rays, _ = unit_rays(camera)
        turned = rays @ np.ascontiguousarray(T_world_camera.rotation.T, dtype=np.float32)
        first = 1 + len(self._moving)
        geometry = self._answer(T_world_camera.position, turned)["geometry_ids"].numpy()
        return np.asarray((geometry >= first) & (geometry < first + len(self._links)))

    def cast(self, origin: Float[np.ndarray, "3"], directions: Float32[np.ndarray, "n 3"]) -> Hits:
        """Cast rays from one point along unit directions, world frame, m."""
        answer = self._answer(origin, directions)
        distance = answer["t_hit"].numpy()
        met = np.isfinite(distance)
        normals = answer["primitive_normals"].numpy()
        cosine = np.abs(np.einsum("ij,ij->i", normals, directions)) * met
        albedo = np.zeros(len(directions), np.float32)
        geometry = answer["geometry_ids"].numpy()
        primitive = answer["primitive_ids"].numpy()
        for index, table in enumerate(self._albedo):
            mine = met & (geometry == index)
            albedo[mine] = table[primitive[mine]]
        return Hits(distance, cosine.astype(np.float32), albedo)

    def _answer(
        self, origin: Float[np.ndarray, "3"], directions: Float32[np.ndarray, "n 3"]
    ) -> Any:
        if self._embree is None:
            raise SurefootError(
                "rays cast before the moving objects were placed; call place() first"
            )
        rays = np.empty((len(directions), 6), np.float32)
        rays[:, :3] = origin
        rays[:, 3:] = directions
        return self._embree.cast_rays(self._o3d.core.Tensor(rays))

    def _add(self, vertices: Float32[np.ndarray, "n 3"], triangles: Int[np.ndarray, "m 3"]) -> None:
        tensor = self._o3d.core.Tensor
        self._embree.add_triangles(tensor(vertices), tensor(triangles.astype(np.uint32)))


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
