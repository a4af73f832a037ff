"""Scans of ScanNet as its exporter writes them: `depth/N.png`, `color/N.jpg`, `pose/N.txt` and `intrinsic/`.

Depth is in millimetres, 0 without depth. `intrinsic_depth.txt` and `intrinsic_color.txt` are 4x4 matrices; the colour
images are larger, and both cameras count as one in place, as the export has it (identity in `extrinsic_color.txt`).
A pose is a 4x4 matrix, camera to world, -inf where tracking was lost. World z is up. N counts frames at 30 Hz, also
where only some were exported. In the 25k subset the intrinsics lie beside the folders, as `intrinsics_depth.txt`.

Source: Dai et al., CVPR 2017 (section on orientation: z is up); ScanNet, SensReader.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError

from .description import Description, known_layout
from .folder import (
    FolderRecording,
    FrameFiles,
    camera_of,
    depth_images,
    pair,
    pictures,
    pose_files,
    stamps_of_names,
)
from .images import DepthUnit, first_size
from .poses import is_given, pose_in, read_matrix
from .recording import RecordingInfo, odd_camera

UNIT = DepthUnit(1000.0, (0,))


def is_scannet(path: Path) -> bool:
    """Whether the folder has the layout."""
    return (path / "depth").is_dir() and _intrinsics(path, "depth") is not None


def open_scannet(path: Path, description: Description | None = None) -> FolderRecording:
    """Open one scan.

    Raises:
        RecordingError: Intrinsics cannot be parsed, there is no depth image, or the files of poses do not match.
    """
    remarks: list[str] = []
    depths = depth_images(path / "depth")
    given = None if description is None else description.camera
    camera = given or _camera(path, "depth", depths)
    if camera is None:
        raise RecordingError(f"{path / 'depth'}: no depth image can be read")
    colours = pictures(path / "color")
    colour_camera = _camera(path, "color", colours)
    if colour_camera is not None and (odd := odd_camera(colour_camera)):
        remarks.append(f"colour left out: {odd}")
        colours = []
    found = pair(depths, pose_files(path / "pose"), path / "pose", remarks, "pose")
    poses = [None if file is None else partial(pose_in, file) for file in found]
    files = [
        FrameFiles(depth.name, stamp_s, depth, colour, pose)
        for depth, stamp_s, colour, pose in zip(
            depths,
            stamps_of_names(depths),
            pair(depths, colours, path, remarks),
            poses,
            strict=True,
        )
    ]
    info = RecordingInfo(
        name=path.resolve().name,
        kind="scannet",
        poses_given=any(map(is_given, poses)),
        frames=len(files),
        gravity_up_world=(0.0, 0.0, 1.0),
    )
    return known_layout(path, info, files, camera, UNIT, remarks, description, colour_camera)


def _intrinsics(path: Path, kind: str) -> Path | None:
    """The file with the intrinsics of the depth or color images."""
    places = (path / f"intrinsic/intrinsic_{kind}.txt", path / f"intrinsics_{kind}.txt")
    return next((place for place in places if place.is_file()), None)


def _camera(path: Path, kind: str, images: list[Path]) -> Camera | None:
    """The camera of the depth or color images; None without its file, or if no image can be read."""
    source = _intrinsics(path, kind)
    if source is None:
        return None
    k = read_matrix(source, (4, 4))
    try:
        size = first_size(path / kind, images, kind)
    except RecordingError:  # each of them is counted as damaged
        return None
    return camera_of(source, *size, fx=k[0, 0], fy=k[1, 1], cx=k[0, 2], cy=k[1, 2])
