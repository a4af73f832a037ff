"""7-Scenes folders: `frame-NNNNNN.depth.png`, `.color.*` and `.pose.txt` in one folder.

Depth is in millimetres; 0 and 65535 mean no depth. Poses are camera-to-world matrices. Intrinsics come from
`camera-intrinsics.txt` in the folder or its parent (as tsdf-fusion writes it), else they are 585 585 320 240 of the
data set's page; `gravity-direction.txt`, in the same places, points down in the world. The number in the file name
counts frames at 30 Hz.

Source: Shotton et al., CVPR 2013; microsoft.com/research/project/rgb-d-dataset-7-scenes.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3

from .description import Description, known_layout
from .folder import (
    KINECT_HZ,
    FolderRecording,
    FrameFiles,
    camera_of,
    number_in,
    pictures,
)
from .images import DepthUnit, first_size
from .poses import pose_of_matrix, read_matrix
from .recording import FrameError, RecordingInfo

UNIT = DepthUnit(1000.0, (0, 65535))
_DEPTH = "frame-*.depth.png"


def is_seven_scenes(path: Path) -> bool:
    """Whether the folder has the layout."""
    return next(path.glob(_DEPTH), None) is not None


def open_seven_scenes(path: Path, description: Description | None = None) -> FolderRecording:
    """Open one sequence.

    Raises:
        RecordingError: Intrinsics or gravity cannot be parsed or are invalid.
    """
    remarks: list[str] = []
    depths = pictures(path, _DEPTH)
    camera = _camera(path, depths, description, remarks)
    files = [_frame(depth, i) for i, depth in enumerate(depths)]
    folder = path.resolve()
    info = RecordingInfo(
        name=f"{folder.parent.name}-{folder.name}",
        kind="seven_scenes",
        poses_given=any(frame.pose is not None for frame in files),
        frames=len(files),
        gravity_up_world=_up(path),
    )
    return known_layout(path, info, files, camera, UNIT, remarks, description)


def _frame(depth: Path, index: int) -> FrameFiles:
    stem = depth.name.removesuffix(".depth.png")
    pose = depth.with_name(f"{stem}.pose.txt")
    colour = next(
        (
            c
            for suffix in ("png", "jpg")
            if (c := depth.with_name(f"{stem}.color.{suffix}")).is_file()
        ),
        None,
    )
    number = number_in(Path(stem))
    stamp_s = (index if number is None else number) / KINECT_HZ
    return FrameFiles(
        stem, stamp_s, depth, colour, partial(_pose, pose) if pose.is_file() else None
    )


def _pose(path: Path) -> Pose3:
    try:
        matrix = read_matrix(path, (4, 4))
    except RecordingError as error:
        raise FrameError("pose file has no 4x4 matrix") from error
    return pose_of_matrix(matrix)


def _camera(
    path: Path, depths: list[Path], description: Description | None, remarks: list[str]
) -> Camera:
    if description is not None and description.camera is not None:
        return description.camera
    width, height = first_size(path, depths)
    source = _beside(path, "camera-intrinsics.txt")
    if source is None:
        remarks.append("no camera-intrinsics.txt: 585 585 320 240 of the data set's page are used")
        return camera_of(path, width, height, 585.0, 585.0, 320.0, 240.0)
    k = read_matrix(source, (3, 3))
    return camera_of(
        source, width=width, height=height, fx=k[0, 0], fy=k[1, 1], cx=k[0, 2], cy=k[1, 2]
    )


def _up(path: Path) -> tuple[float, float, float] | None:
    source = _beside(path, "gravity-direction.txt")
    if source is None:
        return None
    down = np.array([float(v) for v in read_matrix(source, (3, 1)).ravel()])
    length = float(np.linalg.norm(down))
    if not (np.isfinite(length) and abs(length - 1.0) < 0.01):
        raise RecordingError(
            f"{source}: gravity has length {length:.3g}; a unit vector in the world was expected"
        )
    x, y, z = (float(v) for v in -down / length)
    return x, y, z


def _beside(path: Path, name: str) -> Path | None:
    places = (path / name, path.resolve().parent / name)
    return next((place for place in places if place.is_file()), None)
