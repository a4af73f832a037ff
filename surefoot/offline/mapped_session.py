"""A finished map folder as a session: its images at the poses that it found, and its pose graph.

A camera's poses are read from the folder; those of a walking body are found again by its recording and settings, to
the same bits, because the folder does not hold the pose of its head. The images come from the recording.
"""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.depth.sources import FOR_ODOMETRY
from perception.odometry.back_end import BackEndConfig
from perception.odometry.place_recognition import describe, for_any_camera
from perception.odometry.pyramid import build
from perception.odometry.session_graph import SessionGraph, relative_covariance
from perception.odometry.session_links import Session, View
from perception.odometry.view_errors import ViewErrorSize
from perception.primitives.errors import InputError
from perception.primitives.pose import Pose3
from perception.smoothing.factors import LoopClosure, Motion

from ..config import toml
from ..config.schema import Config
from ..evaluation.foreign_graph import read_g2o
from ..progress import Say
from ..recordings.recording import Recording
from ..recordings.without_poses import open_input
from ..results.run_folder import RECORDING, SPACE_HEADER, RunFolder
from ..results.trajectory_uncertainty import SPACE
from .placed_images import NO_FLOOR, CameraImages, PlacedImage, PlacedImages, WalkingBody

MOST_VIEWS = 80  # ours: images that are variables, unless the graph of the map has more
UNKNOWN = np.eye(6)  # of the motion between two images that nothing connects
BODY_SIGMA = 0.005  # ours: of a head on a walking body that its pose does not know, m and rad


class MappedCamera(CameraImages):
    """A camera at the poses of its map.

    Args:
        recording: Its recording.
        config: The settings of the map.
        poses: T_map_camera by stamp.
        covariances: Of each, relative to the first, map axes.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config,
        poses: dict[float, Pose3],
        covariances: dict[float, Float[np.ndarray, "6 6"]],
    ) -> None:
        super().__init__(recording, config)
        self._poses, self._covariances = poses, covariances

    def images(self) -> Iterator[PlacedImage]:
        """The images, one after the other."""
        none = np.zeros((6, 6))
        for frame in self.recording.frames():
            pose = self._poses.get(frame.stamp_s)
            if pose is not None:
                covariance = self._covariances.get(frame.stamp_s, none)
                yield from self._of_camera(frame, pose, covariance)

    def write(self, folder: RunFolder) -> None:
        """Nothing: the map is there."""


@dataclass(frozen=True, eq=False)
class MappedSession:
    """A session that can be merged.

    Args:
        folder: Of its map.
        name: Of its recording.
        path: Of its recording.
        digest: Of its content: sessions are sorted by it.
        config: The settings of its map.
        has_floor: Whether its height zero is a floor that it saw.
        frames: Poses of its trajectory.
    """

    folder: RunFolder
    name: str
    path: Path
    digest: str
    config: Config
    has_floor: bool
    frames: int
    _description: Path | None = None

    @staticmethod
    def open(path: Path) -> MappedSession:
        """The session of a map folder.

        Raises:
            InputError: It is no finished map, or its recording is gone.
            RecordingError: One of its files is damaged.
        """
        run = RunFolder.open(path)
        summary = run.read_json("summary.json")
        trajectory = run.read_trajectory("trajectory.txt")
        if summary is None or trajectory is None or not run.has("config.toml"):
            raise InputError(
                f"{path} is no finished map: summary.json, trajectory.txt and config.toml were expected; "
                "make one with `surefoot map RECORDING`"
            )
        if run.has("sessions.json"):
            raise InputError(f"{path} is a merged map; give the maps that it was merged from")
        recording = Path(summary.get("recording") or run.path(RECORDING))
        if not recording.exists():
            raise InputError(
                f"{path}: its recording {recording} is gone; merging reads its images again. Put it back there, "
                "or map it again where it is now"
            )
        digest = hashlib.sha256(str(summary.get("recording_identity", "")).encode())
        digest.update(run.path("trajectory.txt").read_bytes())
        return MappedSession(
            run,
            str(summary.get("name") or path.name),
            recording,
            digest.hexdigest(),
            toml.read(Config, run.path("config.toml")),
            NO_FLOOR not in summary.get("notes", []),
            len(trajectory),
            _description_of(summary.get("command") or ""),
        )

    def placed(self) -> PlacedImages:
        """Its images at the poses of its map."""
        config = self.config
        recording = open_input(self.path, self._description, config.ignore_poses, config.reader)
        if not recording.info.poses_given and recording.info.start is not None:
            return WalkingBody(recording, config)
        trajectory = self.folder.read_trajectory("trajectory.txt")
        assert trajectory is not None
        poses = {
            stamp: Pose3(tuple(place), tuple(quat))
            for stamp, place, quat in zip(
                trajectory.stamps.tolist(),
                trajectory.positions.tolist(),
                trajectory.quats_xyzw.tolist(),
                strict=True,
            )
        }
        return MappedCamera(recording, config, poses, self.covariances())

    def covariances(self) -> dict[float, Float[np.ndarray, "6 6"]]:
        """Covariances relative to the first image, by stamp."""
        table = self.folder.read_csv(SPACE)
        if table is None:
            return {}
        numbers = table.matrix(*SPACE_HEADER[: 1 + 21])
        found = np.zeros((len(numbers), 6, 6))
        rows, columns = np.triu_indices(6)
        found[:, rows, columns] = found[:, columns, rows] = numbers[:, 1:]
        return dict(zip(numbers[:, 0].tolist(), found, strict=True))


@dataclass(frozen=True, eq=False)
class SessionImages:
    """What of a session is linked and optimised.

    Args:
        session: Its images with their features.
        graph: Their motion; the same images in the same order.
        stamps: Of them, s.
        view_error: Size of the error that depends on the view.
    """

    session: Session
    graph: SessionGraph
    stamps: list[float]
    view_error: ViewErrorSize


def read_images(mapped: MappedSession, say: Say) -> SessionImages:
    """Read the images of a session that are variables of the graph.

    Raises:
        InputError: The recording has none of the images of the map.
    """
    trajectory = mapped.folder.read_trajectory("trajectory.txt")
    assert trajectory is not None
    vertices, edges = _edges(mapped, set(trajectory.stamps.tolist()))
    chosen = set(vertices)
    if len(chosen) < MOST_VIEWS:
        chosen |= set(trajectory.stamps[:: -(-len(trajectory) // MOST_VIEWS)].tolist())
    source = mapped.placed()
    places = BackEndConfig().places
    views: list[View] = []
    stamps: list[float] = []
    covariances: list[np.ndarray] = []
    view_error, config = ViewErrorSize(), mapped.config
    for image in _main_images(source, chosen):
        say(f"{mapped.name}: image {len(views) + 1} of {len(chosen)}")
        floor = image.floor.moved(image.T_map_camera.inverse())
        distortion = config.floor_of(source.recording.info.calibrated).distortion.of(image.sensor)
        pyramid = build(image.depth, image.rgb, floor, config.odometer.pyramid, distortion)
        view_error.add(pyramid)
        place = describe(len(views), pyramid, for_any_camera(places, pyramid))
        views.append(View(place, image.T_map_camera))
        stamps.append(image.stamp_s)
        covariances.append(_in_space(image))
    if not views:
        raise InputError(
            f"{mapped.folder.root}: its recording {mapped.path} has none of the {mapped.frames} images of the map; "
            "has it changed? Map it again"
        )
    poses = [view.T_session_camera for view in views]
    body = isinstance(source, WalkingBody)
    if not body:
        of_stamp = mapped.covariances()
        covariances = [of_stamp.get(stamp, np.zeros((6, 6))) for stamp in stamps]
    factors = _factors(stamps, poses, covariances, vertices, edges, body)
    return SessionImages(Session(views), SessionGraph(poses, factors), stamps, view_error)


Edge = tuple[float, float, Motion | LoopClosure]
"""Stamps of two images, and the motion between them."""


def _main_images(source: PlacedImages, chosen: AbstractSet[float]) -> Iterator[PlacedImage]:
    """One image of each chosen stamp: of the sensor that odometry prefers."""
    for stamp, images in groupby(source.images(), lambda image: image.stamp_s):
        if stamp in chosen:
            preferred = {sensor: k for k, sensor in enumerate(FOR_ODOMETRY)}
            yield min(images, key=lambda image: preferred.get(image.sensor, len(preferred)))


def _edges(mapped: MappedSession, known: AbstractSet[float]) -> tuple[list[float], list[Edge]]:
    """Stamps of the vertices of the map's pose graph, and its edges; none without a graph in space.

    Args:
        mapped: The session.
        known: Stamps of its trajectory; vertices whose pose was lost are not among them.
    """
    table = mapped.folder.read_csv("tracking.csv")
    if table is None or not mapped.folder.has("graph.g2o"):
        return [], []
    path = mapped.folder.path("graph.g2o")
    graph = read_g2o(path)
    stamps = table.numbers("stamp_s").tolist()
    if graph.planar or graph.numbers[0] < 0 or graph.numbers[-1] >= len(stamps):
        raise InputError(
            f"{path}: its vertices are not the frames of tracking.csv beside it; map the recording again"
        )
    edges = []
    for one in graph.factors:
        assert isinstance(one, (Motion, LoopClosure))
        before, after = stamps[one.before], stamps[one.after]
        if before in known and after in known:
            edges.append((before, after, one))
    vertices = [stamps[number] for number in graph.numbers.tolist()]
    return [stamp for stamp in vertices if stamp in known], edges


def _factors(
    stamps: Sequence[float],
    poses: Sequence[Pose3],
    covariances: Sequence[Float[np.ndarray, "6 6"]],
    vertices: Sequence[float],
    edges: Sequence[Edge],
    body: bool,
) -> list[Motion | LoopClosure]:
    """The graph's own edges, and the motion to every other image from the vertex, or else the image, before it."""
    at = {stamp: k for k, stamp in enumerate(stamps)}
    joined = list(range(len(stamps)))  # parts of the graph
    factors: list[Motion | LoopClosure] = []

    def add(factor: Motion | LoopClosure) -> None:
        factors.append(factor)
        kept, gone = sorted((joined[factor.before], joined[factor.after]))
        joined[:] = [kept if part == gone else part for part in joined]

    for one, other, factor in edges:
        if one in at and other in at:
            add(replace(factor, before=at[one], after=at[other]))
    is_vertex = [stamp in set(vertices) for stamp in stamps]
    for k in range(1, len(stamps)):
        if is_vertex[k]:
            continue
        before = next((n for n in range(k - 1, -1, -1) if is_vertex[n]), k - 1)
        P = relative_covariance(covariances[before], covariances[k], poses[before], poses[k])
        P = P + BODY_SIGMA**2 * np.eye(6) if body else P
        add(Motion(before, k, poses[before].inverse() @ poses[k], P))
    for k in range(1, len(stamps)):
        if joined[k] != joined[0]:
            add(Motion(k - 1, k, poses[k - 1].inverse() @ poses[k], UNKNOWN))
    return factors


def _in_space(image: PlacedImage) -> Float[np.ndarray, "6 6"]:
    """Covariance of the pose of a walking body's camera; its height and tilt are those of the floor."""
    covariance = np.zeros((6, 6))
    level = [0, 1, 5]
    covariance[np.ix_(level, level)] = image.pose.covariance
    return covariance


def _description_of(command: str) -> Path | None:
    """The recording.toml that a map was made with, if it was kept elsewhere."""
    try:
        words = shlex.split(command)
    except ValueError:
        return None
    where = words.index("--description") + 1 if "--description" in words else len(words)
    return Path(words[where]) if where < len(words) else None
