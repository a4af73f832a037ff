"""The map of a whole recording: where the camera went, the surface it saw, and where one can walk on it.

Two passes, so that no frame has to be kept: the first finds the way, with places known again, the second lays
every depth image into the surface from where its camera then is. Poses that came with the recording are taken
as they are, and one pass is enough.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mapping.io.atomic_write import atomic_path
from mapping.io.clouds import save_ply
from mapping.surface.meshes import save_mesh
from mapping.surface.surface_map import surface_map
from mapping.surface.traversability import save_layers, save_nav2, traversability
from mapping.surface.tsdf_config import SurfaceMap, TsdfConfig
from perception.depth import structured_light
from perception.floor.levelling import UP, rotation_between
from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.pose_uncertainty import PoseUncertainty
from perception.odometry.rgbd_odometry import Odometer
from perception.primitives.errors import RecordingError
from perception.primitives.frame import Depth, Frame
from perception.primitives.pose import Pose3
from perception.smoothing.smoother import Solution

from ..config.schema import Config
from ..recordings.recording import Recording
from ..results.run_folder import RunFolder
from ..results.trajectory_uncertainty import write_claims
from .g2o import write_g2o

Say = Callable[[str], None]


@dataclass(frozen=True)
class Mapped:
    """What came of it.

    Args:
        folder: Where everything is.
        frames: Laid into the surface.
        skipped: That could not be read.
        lost: Of which nobody knew where the camera was.
        doubtful: Followed, but not surely.
        closures: Places known again.
        vertices: Of the surface.
        walkable_m2: Floor that one can stand on.
    """

    folder: str
    frames: int
    skipped: int
    lost: int
    doubtful: int
    closures: int
    vertices: int
    walkable_m2: float

    def lines(self) -> list[str]:
        """For people."""
        return [
            f"{self.frames} frames; skipped {self.skipped}, lost {self.lost}, doubtful {self.doubtful}; "
            f"{self.closures} places known again",
            f"surface of {self.vertices} vertices, {self.walkable_m2:.1f} m^2 to walk on",
            f"map folder: {self.folder}",
        ]


@dataclass(frozen=True)
class _Way:
    """Camera poses by stamp, upright world, and what is known of their making."""

    poses: dict[float, Pose3]
    states: tuple[str, ...] = ()
    solution: Solution | None = None
    odometer: Odometer | None = None
    claims: PoseUncertainty | None = None


def map_recording(
    recording: Recording,
    out: Path | None,
    config: Config,
    say: Say,
    surface: TsdfConfig | None = None,
) -> Mapped:
    """Make the map of a recording of depth images.

    Writes trajectory.txt (TUM), trajectory_covariance.csv and space_covariance.csv (`way_claims`), graph.g2o,
    mesh.ply, cloud.ply, map.yaml with map.pgm (Nav2), layers.npz (height, slope, step, traversability) and
    summary.json.

    Args:
        recording: Depth images, perhaps with colour and poses.
        out: Folder; None takes the next free one below runs/.
        config: Of the odometry, and the seed.
        say: Progress.
        surface: Size of its voxels, and whose method.

    Raises:
        RecordingError: Not a single depth image could be placed.
        OutputError: The folder cannot be written.
    """
    folder = RunFolder.create(out, name=f"{recording.info.name}-map")
    way = _given(recording) if recording.info.poses_given else _found(recording, config, say)
    if not way.poses:
        raise RecordingError(
            f"{recording.info.name}: no depth image along the axis whose place is known; a recording of an "
            "RGB-D camera is expected, whose images overlap or come with poses"
        )
    _write_way(folder.path("trajectory.txt"), way)
    if way.claims is not None:
        write_claims(folder, list(way.poses), list(way.poses.values()), way.claims)
    if way.solution is not None and way.odometer is not None and way.odometer.back_end is not None:
        write_g2o(folder.path("graph.g2o"), way.odometer.back_end.factors, way.solution)
    fused = surface_map(surface)
    laid = _lay(recording, way, fused, config, say)
    mesh = fused.mesh()
    say(f"surface of {len(mesh.vertices)} vertices")
    save_mesh(folder.path("mesh.ply"), mesh)
    save_ply(folder.path("cloud.ply"), np.asarray(mesh.vertices, dtype=np.float64), mesh.colours)
    layers = traversability(mesh)
    save_nav2(folder.root, "map", layers)
    save_layers(folder.path("layers.npz"), layers)
    walkable = layers.known & ~layers.occupied & (np.nan_to_num(layers.probability) > 0.5)
    mapped = Mapped(
        str(folder.root),
        laid,
        len(recording.skipped),
        sum(state in (LOST, RESTARTED) for state in way.states),
        sum(state == "doubtful" for state in way.states),
        0
        if way.odometer is None or way.odometer.back_end is None
        else way.odometer.back_end.closures,
        len(mesh.vertices),
        float(walkable.sum()) * layers.cell_m**2,
    )
    folder.write_text("summary.json", json.dumps(asdict(mapped), indent=1) + "\n")
    return mapped


def _given(recording: Recording) -> _Way:
    """The poses of the recording, its world turned upright."""
    up = recording.info.gravity_up_world
    turn = Pose3()
    if up is not None:
        turn = Pose3.from_rotation(rotation_between(np.array(up), UP), np.zeros(3))
    return _Way(
        {
            frame.stamp_s: turn @ frame.T_world_camera
            for frame in recording.frames()
            if frame.T_world_camera is not None
        }
    )


def _found(recording: Recording, config: Config, say: Say) -> _Way:
    """The camera's own way, with loops closed."""
    odometer = Odometer(
        np.random.default_rng(config.seed), config.odometer, config.floor, config.structured_light
    )
    stamps = []
    for number, frame in enumerate(_with_depth(recording)):
        step = odometer.track(frame)
        stamps.append(frame.stamp_s)
        say(f"way: frame {number + 1}{_of(recording)}, {step.state}")
    poses, solution = odometer.trajectory() if stamps else ([], None)
    placed = {
        stamp: pose
        for stamp, pose, state in zip(stamps, poses, odometer.states, strict=True)
        if state not in (LOST, RESTARTED)
    }
    claims = odometer.uncertainty(solution)
    if claims is not None:
        told = [state not in (LOST, RESTARTED) for state in odometer.states]
        claims = PoseUncertainty(claims.from_start[told], claims.aligned[told])
    return _Way(placed, tuple(odometer.states), solution, odometer, claims)


def _lay(recording: Recording, way: _Way, fused: SurfaceMap, config: Config, say: Say) -> int:
    """Every image that has a place into the surface; how many there were."""
    count = 0
    for frame in _with_depth(recording):
        pose = way.poses.get(frame.stamp_s)
        if pose is None:
            continue
        depth, rgb = _images(frame, config)
        fused.integrate(depth, pose, rgb)
        count += 1
        say(f"surface: frame {count} of {len(way.poses)}")
    return count


def _images(frame: Frame, config: Config) -> tuple[Depth, np.ndarray | None]:
    assert frame.depth is not None
    depth = structured_light.depth(frame.depth, config.structured_light)
    rgb = None if frame.colour is None else frame.colour.rgb
    return depth, rgb if rgb is not None and rgb.shape[:2] == depth.z.shape else None


def _with_depth(recording: Recording) -> Iterator[Frame]:
    return (frame for frame in recording.frames() if frame.depth is not None)


def _write_way(path: Path, way: _Way) -> None:
    with atomic_path(path) as part, part.open("w", encoding="utf-8") as text:
        text.write("# stamp tx ty tz qx qy qz qw\n")
        for stamp, pose in way.poses.items():
            numbers = (stamp, *pose.translation, *pose.quat_xyzw)
            text.write(" ".join(repr(float(number)) for number in numbers) + "\n")


def _of(recording: Recording) -> str:
    return f" of {recording.info.frames}" if recording.info.frames else ""
