"""Replica rooms as rendered for NICE-SLAM: `frameNNNNNN.jpg`, `depthNNNNNN.png`, `traj.txt`, `cam_params.json`.

The JSON has intrinsics and depth scale (6553.5 units per metre); 0 means no depth. Line k of `traj.txt` is the
camera-to-world matrix of frame k, row by row. World z is up; the frame rate is 30 Hz.

Source: Straub et al. 2019; Zhu et al., CVPR 2022 (the renderings).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from perception.primitives import safe_input
from perception.primitives.errors import ConfigError, RecordingError

from .description import Description, known_layout
from .folder import (
    KINECT_HZ,
    FolderRecording,
    FrameFiles,
    camera_of,
    number_in,
    pair,
    pictures,
    pose_lines,
)
from .images import DepthUnit
from .poses import pose_of, read_trajectory
from .recording import RecordingInfo


def is_replica(path: Path) -> bool:
    """Whether the folder has the layout."""
    return (path / "traj.txt").is_file() and _parameters_file(path) is not None


def open_replica(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a room.

    Raises:
        RecordingError: Parameters or poses cannot be parsed, or a frame has no pose.
    """
    source = _parameters_file(path)
    if source is None:
        raise RecordingError(f"{path}: no cam_params.json here or one folder up")
    try:
        values = safe_input.json(safe_input.text(source))["camera"]
        scale = float(values["scale"])
        width, height = int(values["w"]), int(values["h"])
        fx, fy, cx, cy = (float(values[key]) for key in ("fx", "fy", "cx", "cy"))
        unit = DepthUnit(scale, (0,))
    except (KeyError, TypeError, ValueError, OverflowError, ConfigError) as error:
        raise RecordingError(
            f"{source}: cannot be read ({error}); camera with w h fx fy cx cy scale was expected"
        ) from error
    images = path / "results" if (path / "results").is_dir() else path
    depths = pictures(images, "depth*.png")
    remarks: list[str] = []
    matches = pair(depths, pictures(images, "frame*"), path, remarks)
    _, rows = read_trajectory(path / "traj.txt")
    lines = pose_lines(depths, len(rows), path / "traj.txt")
    files = [
        FrameFiles(
            depth.name,
            (number_in(depth) or 0) / KINECT_HZ,
            depth,
            colour,
            partial(pose_of, rows[line]),
        )
        for depth, colour, line in zip(depths, matches, lines, strict=True)
    ]
    info = RecordingInfo(
        name=path.resolve().name,
        kind="replica",
        poses_given=True,
        frames=len(files),
        gravity_up_world=(0.0, 0.0, 1.0),
        calibrated=True,
    )
    camera = camera_of(source, width, height, fx, fy, cx, cy)
    if description is not None and description.camera is not None:
        camera = description.camera
    return known_layout(path, info, files, camera, unit, remarks, description)


def _parameters_file(path: Path) -> Path | None:
    places = (path / "cam_params.json", path.resolve().parent / "cam_params.json")
    return next((place for place in places if place.is_file()), None)
