"""A plain folder of depth images, described by a recording.toml."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import RecordingError
from perception.primitives.pose import Pose3

from .description import EXAMPLE, Description
from .folder import (
    FolderRecording,
    FrameFiles,
    check_suffixes,
    depth_images,
    is_stamp,
    pair,
    pictures,
    pose_files,
    pose_lines,
)
from .poses import (
    ASSOCIATION_S,
    associate,
    is_finite,
    is_given,
    mirrored,
    numbers,
    pose_in,
    pose_of,
    pose_of_row,
    poses_at,
    read_lines,
    read_trajectory,
)
from .recording import RecordingInfo

_DEPTH_FOLDERS = ("depth", ".")
RATE_HZ = 30.0  # of most depth cameras; assumed where a description gives no times
_COLOUR_FOLDERS = ("color", "colour", "rgb", "image")


def open_plain(path: Path, description: Description) -> FolderRecording:
    """Open a folder by its description.

    Raises:
        RecordingError: The description is incomplete, or images, stamps and poses do not match.
    """
    camera, unit = description.camera, description.unit
    for part, name in ((camera, "camera"), (unit, "depth")):
        if part is None:
            raise RecordingError(
                f"{description.path}: table [{name}] is missing; for example\n{EXAMPLE}"
            )
    assert camera is not None
    assert unit is not None
    depths = _depths(path, description)
    remarks: list[str] = []
    if description.stamps is None and description.rate_hz is None and len(depths) > 1:
        description, remark = _with_times(description, depths)
        remarks.append(remark)
    colours = _colours(path, description, depths, remarks)
    stamps = _stamps(path, description, depths)
    poses = _poses(path, description, depths, stamps, remarks)
    files = [
        FrameFiles(depth.name, float(stamp), depth, colour, pose)
        for depth, stamp, colour, pose in zip(depths, stamps, colours, poses, strict=True)
    ]
    info = RecordingInfo(
        name=description.name or path.resolve().name,
        kind="plain",
        poses_given=any(map(is_given, poses)),
        frames=len(files),
        scene=description.scene,
        gravity_up_world=_up(description),
        calibrated=description.calibrated,
        floor_height_world_m=description.floor_height_m,
    )
    return FolderRecording(
        path,
        info,
        files,
        camera,
        unit,
        description.colour_camera,
        remarks,
        description.scale_checked,
    )


def _up(description: Description) -> tuple[float, float, float] | None:
    """The vertical in the world of the poses, mirrored as these are."""
    if description.up is None or not description.mirrored:
        return description.up
    x, y, z = description.up
    return x, -y, z


def needs_description(path: Path, found: list[Path]) -> RecordingError:
    """The error for a folder of images without a description."""
    return RecordingError(
        f"{path}: {len(found)} images (first {found[0].name}) but no recording.toml with their "
        "intrinsics, depth scale and no-depth values; write one like this there, or give it with "
        f"--description:\n{EXAMPLE}"
    )


def _depths(path: Path, description: Description) -> list[Path]:
    folders = _DEPTH_FOLDERS if description.depth_folder is None else (description.depth_folder,)
    for name in folders:
        found = depth_images(path / name, description.depth_pattern)
        if found:
            return found
    check_suffixes(*(path / name for name in folders))
    where = " or ".join(str(path / name) for name in folders)
    raise RecordingError(
        f"{where}: no image matches {description.depth_pattern!r}; check [depth] folder and pattern "
        f"in {description.path}"
    )


def _colours(
    path: Path, description: Description, depths: list[Path], remarks: list[str]
) -> list[Path | None]:
    named = description.colour_folder
    same_place = description.colour_pattern != "*"
    folders = (named,) if named is not None else (*_COLOUR_FOLDERS, *(["."] * same_place))
    for name in folders:
        found = [p for p in pictures(path / name, description.colour_pattern) if p not in depths]
        if found and all(map(is_stamp, [*found, *depths])):
            depth_s, colour_s = (np.array([float(p.stem) for p in f]) for f in (depths, found))
            return [found[i] if i >= 0 else None for i in associate(depth_s, colour_s)]
        if found:
            return pair(depths, found, path, remarks)
    if named is not None:
        raise RecordingError(
            f"{path / named}: no image matches {description.colour_pattern!r}; check [colour] in "
            f"{description.path}"
        )
    return [None] * len(depths)


def _with_times(description: Description, depths: list[Path]) -> tuple[Description, str]:
    """A description without times, completed: by the names of the images if these are times, else by a rate."""
    if all(is_stamp(depth) for depth in depths):
        return replace(description, stamps="name"), "times taken from the names of the depth images"
    remark = f"no times given: {RATE_HZ:.0f} frames per second assumed (rate_hz in recording.toml)"
    return replace(description, rate_hz=RATE_HZ), remark


def _stamps(path: Path, description: Description, depths: list[Path]) -> Float[np.ndarray, "n"]:
    if description.stamps == "name":
        try:
            return np.array([float(depth.stem) for depth in depths])
        except ValueError as error:
            raise RecordingError(
                f'{description.path}: stamps = "name", but {str(error).split(": ")[-1]} is not a time in s'
            ) from error
    if description.stamps is not None:
        source = path / description.stamps
        lines = read_lines(source)
        if len(lines) != len(depths):
            raise RecordingError(
                f"{source}: {len(lines)} stamps for {len(depths)} depth images; one per image was expected"
            )
        return np.array([numbers(source, n, words[:1], 1, "a time in s")[0] for n, words in lines])
    return np.arange(len(depths)) / (description.rate_hz or RATE_HZ)


def _poses(
    path: Path,
    description: Description,
    depths: list[Path],
    stamps: Float[np.ndarray, "n"],
    remarks: list[str],
) -> Sequence[Callable[[], Pose3 | None] | None]:
    """Poses of files by the number in their names, of lines with stamps by time, else of line k for frame k."""
    if description.poses_folder is not None:
        folder = path / description.poses_folder
        files = pose_files(folder, description.poses_pattern)
        if not files:
            raise RecordingError(
                f"{folder}: no file matches {description.poses_pattern!r}; check [poses] in {description.path}"
            )
        return [
            None if file is None else partial(_pose, description, partial(pose_in, file))
            for file in pair(depths, files, folder, remarks, "pose")
        ]
    if description.poses_file is None:
        return [None] * len(stamps)
    source = path / description.poses_file
    pose_stamps, rows = read_trajectory(source)
    if pose_stamps is None:
        return [
            partial(_pose, description, partial(pose_of, rows[line]))
            for line in pose_lines(depths, len(rows), source)
        ]
    if description.stamps is not None:
        return _by_time(description, source, stamps, pose_stamps, rows, remarks)
    if len(rows) != len(stamps):
        raise RecordingError(
            f"{source}: {len(rows)} poses for {len(stamps)} depth images; one per image was expected, or "
            "stamps to associate them by time"
        )
    return [partial(_pose, description, partial(pose_of, row)) for row in rows]


def _by_time(
    description: Description,
    source: Path,
    stamps: Float[np.ndarray, "n"],
    pose_stamps: Float[np.ndarray, "m"],
    rows: list[tuple[float, ...]],
    remarks: list[str],
) -> list[Callable[[], Pose3] | None]:
    """Poses at the stamps of the images, of those that are finite."""
    known = [row for row in rows if is_finite(row)]
    known_s = pose_stamps[[is_finite(row) for row in rows]]
    poses = poses_at(stamps, known_s, lambda row: _turned(description, pose_of_row(known[row])))
    unmatched = poses.count(None)
    if unmatched == len(stamps):
        raise RecordingError(
            f"{source}: no pose within {ASSOCIATION_S} s of any frame: poses span "
            f"{pose_stamps.min():.3f} to {pose_stamps.max():.3f} s, frames {stamps.min():.3f} to "
            f"{stamps.max():.3f} s; check that both use one clock"
        )
    if unmatched:
        remarks.append(f"{unmatched} of {len(stamps)} depth images have no pose within 0.02 s")
    return poses


def _pose(description: Description, given: Callable[[], Pose3 | None]) -> Pose3 | None:
    pose = given()
    return None if pose is None else _turned(description, pose)


def _turned(description: Description, given: Pose3) -> Pose3:
    """T_world_camera of optical axes."""
    if description.world_to_camera:
        given = given.inverse()
    if description.mirrored:
        given = mirrored(given)
    return given @ Pose3.from_rotation(description.R_given_optical, np.zeros(3))
