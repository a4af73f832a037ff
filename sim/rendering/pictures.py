"""Camera images of a scene: its textured meshes, whose textures carry the shading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from ..scene import Scene
from ..shapes import Solid
from .painting import paint_links, paint_scene
from .renderer import BEHIND, Renderer, depth_m

NEAR_M = 0.05  # ours
BACKGROUND = (214, 222, 230)  # ours: outside the walls


class Pictures:
    """A painted scene in a renderer."""

    def __init__(
        self, scene: Scene, renderer: Renderer, links: Sequence[Sequence[Solid]] = ()
    ) -> None:
        self._renderer = renderer
        still, moving_objects = paint_scene(scene)
        for mesh in still:
            renderer.show(mesh)
        self._moving = [renderer.show(mesh) for mesh in moving_objects]
        self._links = [renderer.show(mesh) for mesh in paint_links(links)]

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m."""
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._renderer.place(body, x, y)

    def pose_links(self, poses: Sequence[Pose3]) -> None:
        """Move and turn the links of the robot."""
        for body, T_world_link in zip(self._links, poses, strict=True):
            self._renderer.pose(body, T_world_link)

    def colour(self, camera: Camera, T_world_camera: Pose3) -> UInt8[np.ndarray, "h w 3"]:
        """Image of an ideal camera, red first."""
        rgba, buffer = self._renderer.render(camera, T_world_camera, NEAR_M)
        picture = rgba[..., :3].copy()
        picture[buffer >= BEHIND] = BACKGROUND
        return picture

    def depth(self, camera: Camera, T_world_camera: Pose3) -> Float32[np.ndarray, "h w"]:
        """Depth along the optical axis from the renderer's depth buffer, m, NaN for the background."""
        buffer = self._renderer.render(camera, T_world_camera, NEAR_M)[1]
        return depth_m(buffer, NEAR_M).astype(np.float32)
