"""Recordings of an iPhone's or iPad's LiDAR by the app Stray Scanner.

`depth/NNNNNN.png` has millimetres, 0 without depth; `confidence/NNNNNN.png` 0, 1 or 2 for each pixel, and depth of
confidence 0 is not used. `camera_matrix.csv` has the intrinsics of the video, 1920 px wide, in which the depth image
covers the same view. A line of `odometry.csv` is the pose of ARKit for one frame: camera to world, optical axes,
world y up. The video is not read.

Source: Stray Scanner, Data Specification; StrayVisualizer (axes of the poses, use of the confidence).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from perception.primitives.camera import Camera

from .description import Description, known_layout
from .folder import FolderRecording, FrameFiles, camera_of, depth_images, number_in, pictures
from .images import DepthUnit, first_size
from .poses import numbers, pose_of_row, read_lines, read_matrix
from .recording import RecordingInfo

UNIT = DepthUnit(1000.0, (0,))
VIDEO_PX = 1920  # width of ARKit's video, for which the intrinsics hold
_CAMERA, _POSES = "camera_matrix.csv", "odometry.csv"
_FIELDS = 9


def is_stray_scanner(path: Path) -> bool:
    """Whether the folder has the layout."""
    return (path / "depth").is_dir() and all((path / one).is_file() for one in (_CAMERA, _POSES))


def open_stray_scanner(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a recording of the app.

    Raises:
        RecordingError: Intrinsics or poses cannot be parsed, or there is no depth image.
    """
    depths = depth_images(path / "depth")
    confidence = {number_in(one): one for one in pictures(path / "confidence")}
    rows = _rows(path / _POSES)
    remarks = ["the video is not read; depth and poses are"]
    without = [depth.name for depth in depths if number_in(depth) not in rows]
    if without:
        remarks.append(
            f"{len(without)} of {len(depths)} depth images have no line in {_POSES} (first {without[0]}) and are left out"
        )
    files = [
        FrameFiles(
            depth.name,
            rows[number][0],
            depth,
            pose=partial(pose_of_row, rows[number][1:]),
            confidence=confidence.get(number),
        )
        for depth in depths
        if (number := number_in(depth)) in rows
    ]
    info = RecordingInfo(
        name=path.resolve().name,
        kind="stray_scanner",
        poses_given=True,
        frames=len(files),
        gravity_up_world=(0.0, 1.0, 0.0),
    )
    given = None if description is None else description.camera
    camera = given or _camera(path / _CAMERA, depths)
    return known_layout(path, info, files, camera, UNIT, remarks, description)


def _rows(source: Path) -> dict[int | None, tuple[float, ...]]:
    """(stamp_s, tx, ty, tz, qx, qy, qz, qw) of each frame."""
    found: dict[int | None, tuple[float, ...]] = {}
    for line, words in read_lines(source):
        if words[0] == "timestamp":
            continue
        stamp_s, frame, *pose = numbers(
            source, line, words[:_FIELDS], _FIELDS, "timestamp frame x y z qx qy qz qw"
        )
        found[int(frame)] = (stamp_s, *pose)
    return found


def _camera(source: Path, depths: list[Path]) -> Camera:
    """Intrinsics of the depth images; pixel centres at integers."""
    matrix = read_matrix(source, (3, 3))
    width, height = first_size(source.parent / "depth", depths)
    share = width / VIDEO_PX
    (fx, _, cx), (_, fy, cy), _ = matrix
    return camera_of(
        source,
        *(width, height),
        *(fx * share, fy * share),
        *((cx + 0.5) * share - 0.5, (cy + 0.5) * share - 0.5),
    )
