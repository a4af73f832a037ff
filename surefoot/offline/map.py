"""The map of a whole recording: camera trajectory, surface mesh, and where a robot can walk on it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mapping.grid.world_map import WorldMap
from mapping.io import world_file
from mapping.io.clouds import save_ply
from mapping.surface.background import Background
from mapping.surface.meshes import save_mesh
from mapping.surface.surface_map import surface_map
from mapping.surface.traversability import save_layers, save_nav2, traversability
from perception.depth.points import from_depth
from perception.floor import classify
from perception.primitives.errors import RecordingError

from ..config.schema import Config
from .camera_moments import CameraMoments
from .job import Job, Say, count_reasons
from .placed_images import PlacedImage, PlacedImages, WalkingBody, placed_images


@dataclass(frozen=True)
class MapSummary:
    """Result of `map_recording`.

    Args:
        folder: Where the files are.
        frames: Frames fused into the surface.
        skipped: Number of frames that could not be read, by reason.
        lost: Frames whose camera pose could not be found.
        doubtful: Frames whose camera pose is uncertain.
        closures: Closed loops.
        vertices: Vertices of the mesh.
        walkable_m2: Area that a robot can walk on.
        notes: Remarks on how the recording was read.
    """

    folder: str
    frames: int
    skipped: dict[str, int]
    lost: int
    doubtful: int
    closures: int
    vertices: int
    walkable_m2: float
    notes: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The summary for the terminal."""
        return [
            f"{self.frames} frames fused, {self.lost} lost, {self.doubtful} doubtful, "
            f"{self.closures} loops closed",
            *(f"skipped {count}: {reason}" for reason, count in self.skipped.items()),
            *self.notes,
            f"mesh of {self.vertices} vertices, {self.walkable_m2:.1f} m^2 walkable",
            f"map folder: {self.folder}",
        ]


def map_recording(job: Job, say: Say) -> MapSummary:
    """Make the map of a recording.

    Writes trajectory.txt (TUM) with its tables of covariances, graph.g2o, mesh.ply, cloud.ply, map.yaml with
    map.pgm (Nav2), layers.npz (height, slope, step, traversability), map_probability.yaml and map_layers.tif
    (occupancy and height of everything seen), estimates.mcap, summary.json, report.html and replay.html.

    Args:
        job: The recording, with depth of any kind, and the output folder.
        say: Progress.

    Raises:
        RecordingError: The recording has no depth, or none of its images could be placed.
        OutputError: The folder cannot be written.
    """
    recording, folder = job.recording, job.folder
    source = placed_images(recording, job.config, say)
    surface = Background(surface_map(job.config.surface))
    of = f" of {recording.info.frames}" if recording.info.frames else ""
    world = WorldMap(job.config.world_map)
    moments = CameraMoments(folder, job.config)
    for image in source.images():
        surface.integrate(image.depth, image.T_map_camera, image.rgb)
        add_to_map(world, image, float(source.frames), job.config)
        camera = image.depth.camera
        moments.add(
            image.stamp_s,
            image.sensor,
            camera,
            image.T_map_camera,
            image.depth.z,
            image.rgb,
            image.pose,
        )
        say(f"surface: frame {source.frames}{of}")
    moments.close()
    if not source.frames:
        raise _nothing_placed(source)
    source.write(folder)
    mesh = surface.mesh()
    say(f"mesh of {len(mesh.vertices)} vertices")
    save_mesh(folder.path("mesh.ply"), mesh)
    save_ply(folder.path("cloud.ply"), np.asarray(mesh.vertices, dtype=np.float64), mesh.colours)
    layers = traversability(mesh)
    save_nav2(folder.root, "map", layers)
    save_layers(folder.path("layers.npz"), layers)
    world_file.save(folder.root, world)
    walkable = layers.known & ~layers.occupied & (np.nan_to_num(layers.probability) > 0.5)
    mapped = MapSummary(
        str(folder.root),
        source.frames,
        count_reasons([reason for _, reason in recording.skipped]),
        source.lost,
        source.doubtful,
        source.closures,
        len(mesh.vertices),
        float(walkable.sum()) * layers.cell_m**2,
        (*recording.remarks, *source.remarks),
    )
    figures: dict[str, Any] = asdict(mapped)
    del figures["folder"]
    moves = "body" if isinstance(source, WalkingBody) else "camera"
    job.finish(**figures, trajectory=moves)
    return mapped


def add_to_map(world: WorldMap, image: PlacedImage, stamp_s: float, config: Config) -> None:
    """Add an image to the map of the whole run, as the pipeline does with its views."""
    reach = config.reach.of(image.sensor)
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
    )


def _nothing_placed(source: PlacedImages) -> RecordingError:
    name = source.recording.info.name
    if source.with_depth:
        return RecordingError(
            f"{name}: the camera pose of none of its {source.with_depth} depth images is known; "
            "a map needs poses, footsteps, or images that overlap"
        )
    return RecordingError(
        f"{name}: none of its frames has depth; a map needs time of flight, structured light, "
        "or stereo images"
    )
