"""The map of a whole recording: camera trajectory, surface mesh, and where a robot can walk on it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from perception.primitives.errors import RecordingError

from ..progress import Say
from ..words import count_of
from .fusion import Fusion
from .job import Job, count_reasons
from .placed_images import PlacedImages, WalkingBody, placed_images


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
            f"{count_of(self.frames, 'frame')} fused, {self.lost} lost, {self.doubtful} doubtful, "
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
    of = f" of {recording.info.frames}" if recording.info.frames else ""
    fusion = Fusion(folder, job.config)
    for image in source.images():
        fusion.add(image, float(source.frames))
        say(f"surface: frame {source.frames}{of}")
    fusion.close()
    if not source.frames:
        raise _nothing_placed(source)
    source.write(folder)
    vertices, walkable_m2 = fusion.write(say)
    mapped = MapSummary(
        str(folder.root),
        source.frames,
        count_reasons([reason for _, reason in recording.skipped]),
        source.lost,
        source.doubtful,
        source.closures,
        vertices,
        walkable_m2,
        (*recording.remarks, *source.remarks),
    )
    figures: dict[str, Any] = asdict(mapped)
    del figures["folder"]
    moves = "body" if isinstance(source, WalkingBody) else "camera"
    job.finish(**figures, trajectory=moves)
    return mapped


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
