"""Placed images fused into what a map folder holds: surface, floor layers, occupancy, and the moments of the replay."""

from __future__ import annotations

from functools import partial

import numpy as np

from mapping.grid.world_map import WorldMap
from mapping.io import world_file
from mapping.io.clouds import save_ply
from mapping.surface.background import Background
from mapping.surface.meshes import save_mesh
from mapping.surface.surface_map import surface_map
from mapping.surface.traversability import save_layers, save_nav2, traversability
from perception.depth.flying import without_flying_pixels
from perception.depth.points import from_depth
from perception.floor import classify
from perception.floor.segmented_view import sees_through
from perception.primitives.errors import InputError

from ..config.schema import Config
from ..progress import Say
from ..results.run_folder import RunFolder
from .camera_moments import CameraMoments
from .placed_images import PlacedImage


class Fusion:
    """Fuses images one after the other; `write` ends it.

    Args:
        folder: Where the files are written.
        config: Voxels, ranges and classes.
    """

    def __init__(self, folder: RunFolder, config: Config) -> None:
        self._folder, self._config = folder, config
        self._surface = Background(surface_map(config.surface))
        self._world = WorldMap(config.world_map)
        self._moments = CameraMoments(folder, config)

    def add(self, image: PlacedImage, number: float) -> None:
        """Fuse an image; `number` counts the frames."""
        image = image._replace(depth=without_flying_pixels(image.depth))
        self._surface.integrate(image.depth, image.T_map_camera, image.rgb)
        add_to_map(self._world, image, number, self._config)
        self._moments.add(
            image.stamp_s,
            image.sensor,
            image.depth.camera,
            image.T_map_camera,
            image.depth,
            image.rgb,
            image.pose,
        )

    def close(self) -> None:
        """End the moments; no image may follow."""
        self._moments.close()

    def write(self, say: Say) -> tuple[int, float]:
        """Write mesh, cloud, layers and maps.

        Returns:
            Vertices of the mesh, and the area on which a robot can walk, m^2.

        Raises:
            InputError: No surface was near enough.
        """
        folder = self._folder
        mesh = self._surface.mesh()
        if not len(mesh.vertices):
            raise InputError(
                "map: no surface was measured within surface.farthest_m="
                f"{self._config.surface.farthest_m:g}; check the scale of depth, else set it higher"
            )
        say(f"mesh of {len(mesh.vertices)} vertices")
        save_mesh(folder.path("mesh.ply"), mesh)
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        save_ply(folder.path("cloud.ply"), vertices, mesh.colours)
        layers = traversability(mesh)
        save_nav2(folder.root, "map", layers)
        save_layers(folder.path("layers.npz"), layers)
        world_file.save(folder.root, self._world)
        walkable = layers.known & ~layers.occupied & (np.nan_to_num(layers.probability) > 0.5)
        return len(vertices), float(walkable.sum()) * layers.cell_m**2


def add_to_map(world: WorldMap, image: PlacedImage, stamp_s: float, config: Config) -> None:
    """Add an image to the map of the whole run, as the pipeline does with its views."""
    reach = config.reach.of(image.sensor, image.depth)
    points = from_depth(image.depth, reach.nearest_m, reach.farthest_m, reach.stride)
    below = image.floor.moved(image.T_map_camera.inverse())
    classes = classify.classify(points, below, config.classes)
    used = classes != classify.OVERHANG
    xyz = points.xyz[used]
    upright = image.T_map_camera.apply(xyz)
    upright[:, 2] = below.distance(xyz)
    world.update(
        upright,
        classes[used] != classify.FLOOR,
        stamp_s,
        np.array([*image.T_map_camera.position[:2], below.offset_m]),
        sigma_m=points.sigma[used] * np.linalg.norm(xyz, axis=1) / xyz[:, 2],
        floor=image.floor,
        pose=image.pose,
        sees_through=partial(sees_through, image.depth, image.T_map_camera, below.offset_m),
    )
