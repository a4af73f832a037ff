"""Redwood and Open3D folders: `color/`, `depth/`, intrinsics as Open3D's JSON, optional `trajectory.log`.

Depth is in millimetres unless the JSON has a `depth_scale`; 0 means no depth. The matrix in the JSON is
column-major, the log has camera-to-world matrices, and the frame rate is 30 Hz.

The vertical axis depends on the data set. Rendered rooms (after ICL-NUIM) have y up; they are recognised by cameras
that never roll about it. For others a recording.toml may give it.

Source: Choi et al., CVPR 2015; open3d.org, RGBD data sets and PinholeCameraIntrinsic.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError

from .description import Description, complete
from .folder import KINECT_HZ, FolderRecording, FrameFiles, camera_of, pair, pictures
from .images import DepthUnit
from .poses import pose_of_matrix, read_log
from .recording import RecordingInfo

_COLOUR_FOLDERS = ("color", "image", "rgb", "colour")
_NO_ROLL = 1e-6  # sine of the roll of a rendered camera, printed with 16 digits


def is_redwood(path: Path) -> bool:
    """Whether the folder has depth images and intrinsics as Open3D writes them."""
    return (path / "depth").is_dir() and _intrinsics_file(path) is not None


def open_redwood(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a folder of this layout.

    Raises:
        RecordingError: Intrinsics or trajectory cannot be parsed, or images do not match.
    """
    source = _intrinsics_file(path)
    if source is None:
        raise RecordingError(f"{path}: no JSON file with an intrinsic_matrix next to depth/")
    camera, unit = _intrinsics(source)
    if description is not None and description.camera is not None:
        camera = description.camera
    depths = pictures(path / "depth")
    colours = next((found for name in _COLOUR_FOLDERS if (found := pictures(path / name))), [])
    remarks: list[str] = []
    matches = pair(depths, colours, path, remarks)
    matrices = read_log(path / "trajectory.log") if (path / "trajectory.log").is_file() else []
    if matrices and len(matrices) != len(depths):
        raise RecordingError(
            f"{path}: {len(depths)} depth images but {len(matrices)} poses in trajectory.log; "
            "one pose per frame was expected"
        )
    files = [
        FrameFiles(
            depth.name,
            i / KINECT_HZ,
            depth,
            colour,
            partial(pose_of_matrix, matrices[i]) if matrices else None,
        )
        for i, (depth, colour) in enumerate(zip(depths, matches, strict=True))
    ]
    info = RecordingInfo(
        name=path.resolve().name,
        kind="redwood",
        poses_given=bool(matrices),
        frames=len(files),
        gravity_up_world=(0.0, 1.0, 0.0) if _rendered_upright(matrices) else None,
    )
    return FolderRecording(path, complete(info, description), files, camera, unit, remarks=remarks)


def _intrinsics_file(path: Path) -> Path | None:
    for candidate in sorted(path.glob("*.json")):
        try:
            if '"intrinsic_matrix"' in candidate.read_text(encoding="utf-8"):
                return candidate
        except (OSError, UnicodeDecodeError):
            continue
    return None


def _intrinsics(source: Path) -> tuple[Camera, DepthUnit]:
    try:
        values: dict[str, Any] = json.loads(source.read_text(encoding="utf-8"))
        k = [float(value) for value in values["intrinsic_matrix"]]
        width, height = int(values["width"]), int(values["height"])
        scale = float(values.get("depth_scale", 1000.0))
    except (json.JSONDecodeError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(
            f"{source}: cannot be read as intrinsics of Open3D ({error}); width, height and a list "
            "intrinsic_matrix of 9 numbers were expected"
        ) from error
    if len(k) != 9:
        raise RecordingError(f"{source}: intrinsic_matrix has {len(k)} numbers, 9 were expected")
    camera = camera_of(source, width=width, height=height, fx=k[0], fy=k[4], cx=k[6], cy=k[7])
    try:
        return camera, DepthUnit(scale, (0,))
    except ConfigError as error:
        raise RecordingError(f"{source}: {error}") from error


def _rendered_upright(matrices: list[np.ndarray]) -> bool:
    """Whether no camera rolls, with world y up."""
    if not matrices:
        return False
    rotations = np.array([matrix[:3, :3] for matrix in matrices])
    level = np.abs(rotations[:, 1, 0]) < _NO_ROLL  # the camera's x axis is horizontal
    upright = rotations[:, 1, 1] < 0.0  # its y axis points down
    return bool(np.all(level & upright))
