"""Camera images of a scene: its textured meshes, whose textures carry the shading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, UInt8

from perception.primitives.camera import Camera
from perception.primitives.pose import Pose3

from ..scene import Scene
from .painting import paint_scene
from .renderer import BEHIND, Renderer, depth_m

NEAR_M = 0.05  # ours
BACKGROUND = (214, 222, 230)  # ours: outside the walls


class Pictures:
    """A painted scene in a renderer."""

    def __init__(self, scene: Scene, renderer: Renderer) -> None:
        self._renderer = renderer
        still, moving_objects = paint_scene(scene)
        for mesh in still:
            renderer.show(mesh)
        self._moving = [renderer.show(mesh) for mesh in moving_objects]

    def place(self, where: Sequence[tuple[float, float]]) -> None:
        """Move the moving objects to these (x, y), m."""
        for body, (x, y) in zip(self._moving, where, strict=True):
            self._renderer.place(body, x, y)

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
