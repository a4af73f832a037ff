"""Tags detected by geometry, as the colour camera does, without images.

A tag is detected if rays reach its corners; the corners have the noise measured on rendered tags, and the pose of the
tag is computed by the product. The tests compare both kinds of detection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from perception.localisation.landmarks import (
    LandmarkConfig,
    constrained_to_height,
    range_and_bearing,
    tag_centre,
    to_body_frame,
)
from perception.primitives.landmark import Landmark, Sighting
from perception.primitives.pose import Pose3
from sim.rendering.rays import RayCaster
from sim.scene import Scene
from sim.sensors.cameras import ImageConfig
from sim.shapes import Box


@dataclass(frozen=True)
class TagNoise:
    """Errors of tag corners in images, measured on 160 rendered tags of two homes."""

    corner_px: float = 0.06  # standard deviation of each corner
    grow_px: float = 0.09  # outward shift of all corners: black bleeds
    lower_px: float = 0.13  # downward shift of all corners: the renderer's pixel centres
    max_oblique_deg: float = 70.0  # at larger angles its cells are not decoded


class TagSensor:
    """Detects tags as the colour camera does, without images."""

    def __init__(
        self, scene: Scene, noise: TagNoise, config: LandmarkConfig, rng: np.random.Generator
    ) -> None:
        self._marks = scene.landmarks
        self._noise, self._config, self._rng = noise, config, rng
        yaws = {
            thing.name: part.yaw_rad
            for thing in scene.static_objects
            for part in thing.parts
            if isinstance(part, Box)
        }
        self._yaws = [yaws[f"tag {mark.identity}"] for mark in self._marks]
        self._corners = [
            corners(mark, yaw) for mark, yaw in zip(self._marks, self._yaws, strict=True)
        ]

    def look(
        self, rays: RayCaster, image: ImageConfig, T_world_camera: Pose3, T_body_camera: Pose3
    ) -> list[Sighting]:
        """Sightings of one instant.

        Args:
            rays: Ray caster of the world.
            image: The colour camera.
            T_world_camera: True camera pose.
            T_body_camera: Camera pose on the body by the joints.
        """
        found = []
        for mark, yaw, four in zip(self._marks, self._yaws, self._corners, strict=True):
            seen = T_world_camera.inverse().apply(four)
            pixels = image.camera.project(seen)
            away = T_world_camera.position - np.array(mark.position)
            facing = away @ np.array([math.cos(yaw), math.sin(yaw), 0.0]) / np.linalg.norm(away)
            if (
                facing < math.cos(math.radians(self._noise.max_oblique_deg))
                or not bool(np.all(image.camera.contains(pixels)))
                or not _reached(rays, T_world_camera.position, four)
            ):
                continue
            outward = pixels - pixels.mean(axis=0)
            outward /= np.linalg.norm(outward, axis=1, keepdims=True)
            pixels = pixels + self._noise.grow_px * outward + np.array([0.0, self._noise.lower_px])
            pixels = pixels + self._noise.corner_px * self._rng.standard_normal((4, 2))
            centre = tag_centre(pixels, mark.side_m, image.camera, self._config)
            if centre is None:
                continue
            in_body = to_body_frame(centre, T_body_camera, self._config)
            at_height = constrained_to_height(in_body, mark.position[2])
            if at_height is not None:
                found.append(range_and_bearing(at_height, mark.identity))
        return found


def corners(mark: Landmark, yaw_rad: float) -> Float[np.ndarray, "4 3"]:
    """Corners of a tag on a vertical face with normal `yaw_rad`, clockwise from the upper left, world frame, m."""
    half = mark.side_m / 2.0
    right = np.array([-math.sin(yaw_rad), math.cos(yaw_rad), 0.0]) * half  # as seen from in front
    up = np.array([0.0, 0.0, half])
    middle = np.array(mark.position)
    return np.array(
        [middle - right + up, middle + right + up, middle + right - up, middle - right - up]
    )


def _reached(rays: RayCaster, origin: Float[np.ndarray, "3"], places: np.ndarray) -> bool:
    """Whether rays from an origin reach all points without hitting anything."""
    paths = places - origin
    lengths = np.linalg.norm(paths, axis=1)
    hits = rays.cast(origin, (paths / lengths[:, None]).astype(np.float32))
    return bool(np.all(hits.distance_m > lengths - 0.02))
