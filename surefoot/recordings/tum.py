"""TUM RGB-D benchmark folders, complete or thinned.

Complete: `depth.txt` and `rgb.txt` list stamps and files (without these lists the file names are the stamps),
`groundtruth.txt` has the poses; all are associated by time, poses between two of them.
Thinned: only `depth/` and `rgb/`, and a line of `groundtruth.txt` for each image, see `folder.pose_lines`.
Depth of the benchmark has 5000 units per metre, and 0 without depth. The intrinsics are those of the benchmark's page
for its three cameras; the folder name, or the comment of depth.txt that names the bag, selects the camera (freiburg1,
fr1, ...), or a recording.toml gives them. World z is up.

ETH3D adds `calibration.txt`, a line of `fx fy cx cy`, and has the same scale. Its world has no stated vertical.

Recordings of other cameras have this layout too, often with millimetres. A recording.toml states their camera and, in
a table [depth], their scale: with a wrong one a room would be five times as small.

Source: Sturm et al., IROS 2012; cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats; Schöps et al., CVPR 2019
(ETH3D), and the README of BAD SLAM (calibration.txt, pixel centres at integers).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3

from .description import EXAMPLE, Description, known_layout
from .folder import (
    FolderRecording,
    FrameFiles,
    camera_of,
    depth_images,
    is_stamp,
    pair,
    pictures,
    pose_lines,
)
from .images import DepthUnit, first_size
from .poses import (
    ASSOCIATION_S,
    associate,
    numbers,
    pose_of_row,
    poses_at,
    read_comments,
    read_lines,
    read_tum,
)
from .recording import RecordingInfo

UNIT = DepthUnit(5000.0, (0,))
CAMERAS = {
    "1": Camera(640, 480, 517.3, 516.5, 318.6, 255.3, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": Camera(640, 480, 520.9, 521.0, 325.1, 249.7, (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": Camera(640, 480, 535.4, 539.2, 320.1, 247.6),
}
"""Colour cameras of the benchmark's page; depth is registered to them."""
UP = (0.0, 0.0, 1.0)


def is_tum(path: Path) -> bool:
    """Whether the folder has the benchmark's layout."""
    listed = (path / "depth.txt").is_file()
    return listed or ((path / "depth").is_dir() and (path / "groundtruth.txt").is_file())


def open_tum(path: Path, description: Description | None = None) -> FolderRecording:
    """Open a folder of the benchmark.

    Raises:
        RecordingError: A list cannot be parsed, the camera is unknown, or images do not match.
    """
    remarks: list[str] = []
    timed = (path / "depth.txt").is_file() or all(is_stamp(p) for p in depth_images(path / "depth"))
    files = _timed(path, remarks) if timed else _counted(path, remarks)
    camera, unit, up = _camera(path, files, description, remarks)
    info = RecordingInfo(
        name=path.resolve().name,
        kind="tum",
        poses_given=any(frame.pose is not None for frame in files),
        frames=len(files),
        gravity_up_world=up,
    )
    return known_layout(path, info, files, camera, unit, remarks, description)


def _camera(
    path: Path, files: list[FrameFiles], description: Description | None, remarks: list[str]
) -> tuple[Camera, DepthUnit, tuple[float, float, float] | None]:
    """Intrinsics, depth scale and vertical: of the description, the camera of the benchmark, or ETH3D's calibration."""
    given = None if description is None else description.camera
    stated = None if description is None else description.unit
    if given is not None and stated is not None:
        return given, stated, UP
    names = [f"folder name {folder.name}" for folder in (path.resolve(), path.resolve().parent)]
    if (path / "depth.txt").is_file():
        names += [f"comment {one!r} of depth.txt" for one in read_comments(path / "depth.txt")]
    for name in names:
        found = re.search(r"(?<![a-z])(?:freiburg|fr)([123])(?!\d)", name.lower())
        if found:
            if given is None:
                remarks.append(
                    f"intrinsics of camera freiburg{found[1]} of the benchmark's page, chosen by the {name}"
                )
            return given or CAMERAS[found[1]], stated or UNIT, UP
    calibration = path / "calibration.txt"
    if calibration.is_file():
        remarks.append(
            f"{calibration.name} of ETH3D: its intrinsics, and {(stated or UNIT).per_metre:g} units of depth per metre"
        )
        return given or _of_eth3d(calibration, files), stated or UNIT, None
    raise RecordingError(
        f"{path}: neither the folder name nor depth.txt has a TUM camera (freiburg1, freiburg2, freiburg3), and there is "
        "no calibration.txt (fx fy cx cy, as of ETH3D); rename the folder or put a recording.toml beside the images with "
        f"its intrinsics and depth scale\n{_tables()}"
    )


def _of_eth3d(source: Path, files: list[FrameFiles]) -> Camera:
    """The camera of a line of intrinsics, with the size of the first image."""
    line, words = read_lines(source)[0]
    fx, fy, cx, cy = numbers(source, line, words, 4, "fx fy cx cy")
    size = first_size(source.parent, [frame.depth for frame in files])
    return camera_of(source, *size, fx, fy, cx, cy)


def _tables() -> str:
    lines = EXAMPLE[EXAMPLE.index("[camera]") : EXAMPLE.index("encoding")].splitlines()
    return "\n".join(line for line in lines if not line.startswith("folder"))


def _timed(path: Path, remarks: list[str]) -> list[FrameFiles]:
    """Frames associated by time: stamps of the lists or, without them, of the file names."""
    stamps, depths = _with_stamps(path, "depth")
    colour_of = np.full(len(stamps), -1)
    colour_stamps, colours = _with_stamps(path, "rgb")
    if colours:
        colour_of = associate(stamps, colour_stamps)
        _remark_unmatched((colour_of >= 0).tolist(), "colour image", remarks)
    poses: list[Callable[[], Pose3] | None] = [None] * len(stamps)
    if (path / "groundtruth.txt").is_file():
        pose_stamps, rows = read_tum(path / "groundtruth.txt")
        poses = poses_at(stamps, pose_stamps, lambda row: pose_of_row(rows[row]))
        _remark_unmatched([pose is not None for pose in poses], "pose", remarks)
    return [
        FrameFiles(
            depth.name,
            float(stamp),
            depth,
            colours[colour] if colour >= 0 else None,
            pose,
        )
        for stamp, depth, colour, pose in zip(stamps, depths, colour_of, poses, strict=True)
    ]


def _with_stamps(path: Path, kind: str) -> tuple[np.ndarray, list[Path]]:
    if (path / f"{kind}.txt").is_file():
        return _list(path / f"{kind}.txt")
    files = [file for file in depth_images(path / kind) if is_stamp(file)]
    return np.array([float(file.stem) for file in files]), files


def _list(path: Path) -> tuple[np.ndarray, list[Path]]:
    stamps, files = [], []
    for line, words in read_lines(path):
        try:
            stamps.append(float(words[0]))
            files.append(path.parent / words[1])
        except (ValueError, IndexError) as error:
            raise RecordingError(
                f"{path}, line {line}: {' '.join(words)!r}; expected: timestamp filename"
            ) from error
    return np.array(stamps), files


def _remark_unmatched(matched: list[bool], what: str, remarks: list[str]) -> None:
    unmatched = matched.count(False)
    if unmatched:
        remarks.append(
            f"{unmatched} of {len(matched)} depth images have no {what} within {ASSOCIATION_S} s"
        )


def _counted(path: Path, remarks: list[str]) -> list[FrameFiles]:
    """Frames of the thinned layout: line K of the poses is image K."""
    depths = depth_images(path / "depth")
    colours = pair(depths, pictures(path / "rgb"), path, remarks)
    stamps, rows = read_tum(path / "groundtruth.txt")
    lines = pose_lines(depths, len(rows), path / "groundtruth.txt", stamps.tolist())
    return [
        FrameFiles(depth.name, float(stamps[line]), depth, colour, partial(pose_of_row, rows[line]))
        for depth, colour, line in zip(depths, colours, lines, strict=True)
    ]
