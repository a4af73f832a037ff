"""Redwood, Open3D and RealSense folders: `color/`, `depth/`, intrinsics as JSON, optional `trajectory.log`.

The JSON is Open3D's (`intrinsic_matrix`, column-major, also inside `intrinsic`) or RealSense's (`fx`, `fy`, `ppx`,
`ppy`, `width`, `height`, `coeffs`, also inside `depth` or `color`). Depth is in millimetres unless the JSON has a
`depth_scale`, in units per metre as Open3D has it or in metres per unit as RealSense has it; 0 means no depth. The
log has camera-to-world matrices. Images are numbered at 30 Hz, or their names are times.

The vertical axis depends on the data set. Rendered rooms (after ICL-NUIM) have y up; they are recognised by cameras
that never roll about it. For others a recording.toml may give it.

Source: Choi et al., CVPR 2015; open3d.org, RGBD data sets and PinholeCameraIntrinsic; librealsense, rs2_intrinsics.
"""

from __future__ import annotations

import contextlib
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.safe_input import UnreadableError

from .description import Description, known_layout
from .folder import (
    FolderRecording,
    FrameFiles,
    camera_of,
    depth_images,
    pair,
    pictures,
    pose_lines,
    stamps_of_names,
)
from .images import DepthUnit
from .poses import pose_of_matrix, read_log
from .recording import RecordingInfo

_COLOUR_FOLDERS = ("color", "image", "rgb", "colour")
_INTRINSICS = re.compile(r'"(?:intrinsic_matrix|ppx)"')
_PARTS = ("depth", "intrinsic", "intrinsics", "color", "colour")
Lens = tuple[float, float, float, float, float]
NO_LENS: Lens = (0.0, 0.0, 0.0, 0.0, 0.0)
_NO_ROLL = 1e-6  # sine of the roll of a rendered camera, printed with 16 digits


def is_redwood(path: Path) -> bool:
    """Whether the folder has depth images and intrinsics as Open3D writes them."""
    return (path / "depth").is_dir() and bool(_intrinsics_files(path))


def open_redwood(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a folder of this layout.

    Raises:
        RecordingError: Intrinsics or trajectory cannot be parsed, or images do not match.
    """
    camera, unit = _intrinsics_of_depth(path)
    if description is not None and description.camera is not None:
        camera = description.camera
    depths = depth_images(path / "depth")
    colours = next((found for name in _COLOUR_FOLDERS if (found := pictures(path / name))), [])
    remarks: list[str] = []
    matches = pair(depths, colours, path, remarks)
    matrices = read_log(path / "trajectory.log") if (path / "trajectory.log").is_file() else []
    source = path / "trajectory.log"
    lines = pose_lines(depths, len(matrices), source) if matrices else []
    files = [
        FrameFiles(
            depth.name,
            stamp_s,
            depth,
            colour,
            partial(pose_of_matrix, matrices[lines[i]]) if matrices else None,
        )
        for i, (depth, colour, stamp_s) in enumerate(
            zip(depths, matches, stamps_of_names(depths), strict=True)
        )
    ]
    info = RecordingInfo(
        name=path.resolve().name,
        kind="redwood",
        poses_given=bool(matrices),
        frames=len(files),
        gravity_up_world=(0.0, 1.0, 0.0) if _rendered_upright(matrices) else None,
    )
    return known_layout(path, info, files, camera, unit, remarks, description)


def _intrinsics_files(path: Path) -> list[Path]:
    """The JSON files with intrinsics."""
    found = []
    for candidate in sorted(path.glob("*.json")):
        with contextlib.suppress(UnreadableError):
            if _INTRINSICS.search(safe_input.text(candidate)):
                found.append(candidate)
    return found


def _intrinsics_of_depth(path: Path) -> tuple[Camera, DepthUnit]:
    """Of the file named after depth, else of one not named after colour."""
    found = _intrinsics_files(path)
    if not found:
        raise RecordingError(
            f"{path}: no JSON file with an intrinsic_matrix, or fx and ppx, next to depth/"
        )
    named = [one for one in found if "depth" in one.name.lower()]
    others = [one for one in found if not any(c in one.name.lower() for c in _COLOUR_FOLDERS)]
    chosen = named or others or found
    first = _intrinsics(chosen[0])
    if any(_intrinsics(one) != first for one in chosen[1:]):
        raise RecordingError(
            f"{path}: {' and '.join(one.name for one in chosen)} have different intrinsics; one file for the depth "
            "images was expected: name it depth_intrinsics.json"
        )
    return first


def _intrinsics(source: Path) -> tuple[Camera, DepthUnit]:
    try:
        whole: dict[str, Any] = safe_input.json(safe_input.text(source))
        values = _part(whole)
        (fx, fy, cx, cy), lens = (
            _of_open3d(values) if "intrinsic_matrix" in values else _of_realsense(values)
        )
        width, height = int(values["width"]), int(values["height"])
        scale = float(values.get("depth_scale", whole.get("depth_scale", 1000.0)))
    except (*(AttributeError, KeyError, TypeError, ValueError, OverflowError),) as error:
        raise RecordingError(
            f"{source}: cannot be read as intrinsics of Open3D or RealSense ({error}); width, height, and a list "
            "intrinsic_matrix of 9 numbers or fx, fy, ppx, ppy were expected"
        ) from error
    if 0.0 < scale < 1.0:  # metres per unit
        scale = 1.0 / scale
    try:
        return camera_of(source, width, height, fx, fy, cx, cy, lens), DepthUnit(scale, (0,))
    except ConfigError as error:
        raise RecordingError(f"{source}: {error}") from error


def _part(values: dict[str, Any]) -> dict[str, Any]:
    """The table with the intrinsics of the depth images: the whole one, or one inside it."""
    inside = [values.get(name) for name in _PARTS]
    tables = [values, *(one for one in inside if isinstance(one, dict))]
    return next((one for one in tables if "intrinsic_matrix" in one or "ppx" in one), values)


def _of_open3d(values: dict[str, Any]) -> tuple[tuple[float, ...], Lens]:
    """(fx, fy, cx, cy) of a list of columns, or of three rows."""
    matrix = values["intrinsic_matrix"]
    if len(matrix) == 3:
        matrix = [row[column] for column in range(3) for row in matrix]
    if len(matrix) != 9:
        raise ValueError(f"intrinsic_matrix has {len(matrix)} numbers, 9 were expected")
    k = [float(value) for value in matrix]
    return (k[0], k[4], k[6], k[7]), NO_LENS


def _of_realsense(values: dict[str, Any]) -> tuple[tuple[float, ...], Lens]:
    """(fx, fy, cx, cy), and the coefficients where they are those of a lens."""
    k = tuple(float(values[key]) for key in ("fx", "fy", "ppx", "ppy"))
    model = str(values.get("model", "")).lower().replace("_", " ")
    lens = tuple(float(value) for value in values.get("coeffs", NO_LENS))
    if any(lens) and "inverse" not in model and "none" not in model:
        if len(lens) != 5:
            raise ValueError(f"coeffs has {len(lens)} numbers, 5 were expected")
        return k, (lens[0], lens[1], lens[2], lens[3], lens[4])
    return k, NO_LENS


def _rendered_upright(matrices: list[np.ndarray]) -> bool:
    """Whether no camera rolls, with world y up."""
    if not matrices:
        return False
    rotations = np.array([matrix[:3, :3] for matrix in matrices])
    level = np.abs(rotations[:, 1, 0]) < _NO_ROLL  # the camera's x axis is horizontal
    upright = rotations[:, 1, 1] < 0.0  # its y axis points down
    return bool(np.all(level & upright))
