"""Ranges, incidence and albedo from one image of PyBullet's camera.

The scene has a twin beside it in flat-coloured triangles: the colour of a triangle is its number. One image gives, per
pixel, the depth, and by the number the exact normal and albedo of the surface. The twin is in the client of the
camera images, too far aside to be seen in them.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from ..scene import Scene
from ..shapes import Solid
from .renderer import FAR_M, Renderer, TexturedMesh, depth_m
from .surfaces import Hits, Surfaces, link_surfaces, scene_surfaces, unit_rays

NEAR_M = 0.1  # ours: steps of EGL's depth of 0.15 mm at 1 m; an SR-4000 measures from 0.3 m
ASIDE_M = 64.0  # ours: neither scene sees the other; single precision is 4e-6 m there
_DOT_PX = 4  # ours: side of a number's square in the texture, so that no renderer mixes two


class NumberedScene:
    """The twin of a scene in a renderer; `place` the moving objects before looking."""

    def __init__(
        self, scene: Scene, renderer: Renderer, links: Sequence[Sequence[Solid]] = ()
    ) -> None:
        self._renderer = renderer
        self._aside_m = max(ASIDE_M, scene.extent[2] - scene.extent[0] + 2.0 * FAR_M)
        still, moving_objects = scene_surfaces(scene)
        everything = [still, *moving_objects, *link_surfaces(links)]
        normals = np.concatenate([_normals(part) for part in everything])
        self._normals = normals.astype(np.float32)
        self._albedo = np.concatenate([part.albedo for part in everything])
        first, bodies, spans = 0, [], []
        for part in everything:
            bodies.append(renderer.show(_numbered(part, first)))
            spans.append(slice(first, first + len(part.triangles)))
            first += len(part.triangles)
        renderer.place(bodies[0], self._aside_m, 0.0)
        count = 1 + len(moving_objects)
        self._moving = bodies[1:count]
        self._links = list(zip(bodies[count:], spans[count:], strict=True))
        self._link_normals = [normals[span] for span in spans[count:]]

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m."""
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._renderer.place(body, self._aside_m + x, y)

    def pose_links(self, poses: Sequence[Pose3]) -> None:
        """Move and turn the links of the robot."""
        placed = zip(self._links, self._link_normals, poses, strict=True)
        for (body, span), normals, T_world_link in placed:
            x, y, z = T_world_link.translation
            self._renderer.pose(body, replace(T_world_link, translation=(self._aside_m + x, y, z)))
            self._normals[span] = normals @ T_world_link.rotation.T

    def look(self, camera: Camera, T_world_camera: Pose3) -> Hits:
        """What the ray of each pixel meets between `NEAR_M` and `FAR_M` of depth, row by row."""
        position = T_world_camera.position + np.array([self._aside_m, 0.0, 0.0])
        aside = Pose3.from_rotation(T_world_camera.rotation, position)
        rgba, buffer = self._renderer.render(camera, aside, NEAR_M)
        rays, length = unit_rays(camera)
        depth = depth_m(buffer, NEAR_M).ravel().astype(np.float32)
        met = np.isfinite(depth)
        red, green, blue = (rgba[..., k].ravel().astype(np.int32) for k in range(3))
        number = np.where(met, red + (green << 8) + (blue << 16), 0)
        seen = self._normals @ T_world_camera.rotation.astype(np.float32)  # in the camera frame
        cosine = np.abs(np.einsum("ij,ij->i", seen[number], rays)) * met
        distance = np.where(met, depth * length, np.float32(np.inf))
        return Hits(distance, cosine, self._albedo[number] * met)


def _numbered(part: Surfaces, first: int) -> TexturedMesh:
    """Surfaces whose triangles show their numbers, from `first` on: one small square of the texture each."""
    count = len(part.triangles)
    side = math.ceil(math.sqrt(count))
    number = first + np.arange(side**2).reshape(side, side)
    colours = np.stack([number & 255, number >> 8 & 255, number >> 16 & 255], axis=-1)
    texture = np.kron(colours.astype(np.uint8), np.ones((_DOT_PX, _DOT_PX, 1), np.uint8))
    row, column = np.divmod(np.arange(count), side)
    uv = np.stack([column + 0.5, row + 0.5], axis=1) / side
    corners = part.vertices[part.triangles].reshape(-1, 3).astype(np.float64)
    triangles = np.arange(3 * count).reshape(count, 3)
    return TexturedMesh(corners, triangles, np.repeat(uv, 3, axis=0), texture)


def _normals(part: Surfaces) -> Float[np.ndarray, "m 3"]:
    """Unit normals of triangles; zero for one without area, which is not seen."""
    a, b, c = (part.vertices[part.triangles[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30))
