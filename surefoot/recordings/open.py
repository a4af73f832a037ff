"""Choice of the reader for a path."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from perception.primitives import plugins
from perception.primitives.errors import InputError, RecordingError

from .checked import CheckedRecording, OwnRecording
from .description import Description, adds_scale, read_description
from .euroc import is_euroc, open_euroc
from .folder import check_suffixes, depth_images
from .icl_nuim import is_icl_nuim, open_icl_nuim
from .mcap_format import McapRecording
from .pcd import PcdRecording
from .plain import needs_description, open_plain
from .recording import DESCRIPTION_FILE, Recording
from .redwood import is_redwood, open_redwood
from .replica import is_replica, open_replica
from .robot_log import robot_files
from .rosbag import RosbagRecording, is_rosbag
from .scannet import is_scannet, open_scannet
from .seven_scenes import is_seven_scenes, open_seven_scenes
from .stereo_pairs import has_pairs, is_stereo, open_stereo, without_calibration
from .stray_scanner import is_stray_scanner, open_stray_scanner
from .tum import is_tum, open_tum

MCAP_NAME = "recording.mcap"
LAYOUTS: tuple[
    tuple[Callable[[Path], bool], Callable[[Path, Description | None], Recording]], ...
] = (
    (is_euroc, open_euroc),
    (is_icl_nuim, open_icl_nuim),
    (is_seven_scenes, open_seven_scenes),
    (is_replica, open_replica),
    (is_redwood, open_redwood),
    (is_stray_scanner, open_stray_scanner),
    (is_scannet, open_scannet),
    (is_tum, open_tum),
    (is_stereo, open_stereo),
)
"""Layouts of folders: whether a folder has it, and its reader; the first that matches counts."""
KINDS = (
    "a run folder or .mcap file of `surefoot simulate --record`, a ROS 1 .bag, a ROS 2 bag (folder, .mcap or "
    ".db3), a TUM RGB-D, ETH3D, ICL-NUIM, 7-Scenes, ScanNet, EuRoC, Redwood/Open3D, Replica or Stray Scanner folder, a "
    "folder of rectified stereo pairs with the calibration of ROS, OpenCV or KITTI, an organised .pcd file, a folder of depth images with a "
    "recording.toml, or (process only) the log of a wheeled robot: an MRCLAM folder or Robot<n>_Odometry.dat of one, "
    "or a Plaza .mat file"
)


def open_recording(
    path: str | Path, description: str | Path | None = None, reader: str = ""
) -> Recording:
    """Open a recording of any known format, or by a reader of the user's own.

    Args:
        path: A file or folder.
        description: A recording.toml in another place; by default the one in the folder, if any. With a table
            [depth] it describes a plain folder completely; otherwise it completes a known layout.
        reader: "package.module:Class", called with the path; empty: by the format.

    Raises:
        RecordingError: There is no such path, its format is unknown, or it cannot be read as a whole.
    """
    path = Path(path)
    description = None if description is None else Path(description)
    if not path.exists():
        raise RecordingError(f"{path}: no such file or folder{_nearest(path)}; expected {KINDS}")
    if not (path.is_file() or path.is_dir()):
        raise RecordingError(f"{path}: is neither a file nor a folder; expected {KINDS}")
    if reader:
        return _open_with(reader, path)
    if description is None and robot_files(path):
        raise RecordingError(
            f"{path}: the log of a wheeled robot has no pictures; only `surefoot process` reads it"
        )
    if path.is_file():
        return _open_file(path, description)
    return _open_folder(path, _description(path, description))


def _open_with(reader: str, path: Path) -> Recording:
    """By a reader of the user's own."""
    recording: OwnRecording = plugins.load(reader, {}, "recording reader", ("frames",))(path)
    if not hasattr(recording, "info"):
        raise InputError(f"recording reader {reader!r} lacks info; see the protocol OwnRecording")
    return CheckedRecording(recording)


def _open_file(path: Path, description: Path | None) -> Recording:
    if path.name == DESCRIPTION_FILE:
        return _open_folder(path.parent, read_description(path))
    if is_rosbag(path):
        return RosbagRecording(path, None if description is None else read_description(description))
    if description is not None:
        raise RecordingError(
            f"{path}: a single file needs no description, but {description} was given; leave it out"
        )
    if path.suffix == ".mcap":
        return _own_mcap(path)
    if path.suffix == ".pcd":
        return PcdRecording(path)
    hint = "give its folder" if path.parent != path else "give a folder"
    raise RecordingError(
        f"{path}: a file of kind {path.suffix or path.name!r} is not read; {hint}; expected {KINDS}"
    )


def _own_mcap(path: Path) -> McapRecording:
    """Named by its folder or file as every other recording, not by the scene and seed it was made with."""
    recording = McapRecording(path)
    folder = path.resolve().parent
    recording.info = replace(
        recording.info, name=folder.name if path.name == MCAP_NAME else path.stem
    )
    return recording


def _open_folder(path: Path, description: Description | None) -> Recording:
    if description is not None and description.unit is not None:
        listed = is_tum(path) and adds_scale(description)
        return (open_tum if listed else open_plain)(path, description)
    if is_rosbag(path):
        return RosbagRecording(path, description)
    inside = path / MCAP_NAME
    if inside.is_file() and is_rosbag(inside):
        return RosbagRecording(inside, description)
    if inside.is_file() and description is None:
        return _own_mcap(inside)
    for recognised, opened in LAYOUTS:
        if recognised(path):
            return opened(path, description)
    if description is not None:
        return open_plain(path, description)  # its error names the missing table
    raise _nothing_known(path)


def _description(path: Path, given: Path | None) -> Description | None:
    if given is not None:
        return read_description(given)
    beside = path / DESCRIPTION_FILE
    return read_description(beside) if beside.is_file() else None


def _nothing_known(path: Path) -> RecordingError:
    """The error for a folder without a known recording."""
    if (path / "config.toml").is_file() and (path / "metrics.json").is_file():
        return RecordingError(
            f"{path}: this run was not recorded (no {MCAP_NAME}); run `surefoot simulate --record`"
        )
    if has_pairs(path):
        return without_calibration(path)
    found = depth_images(path / "depth") or depth_images(path)
    if found:
        return needs_description(path, found)
    check_suffixes(path, path / "depth")
    inside = [child.name for child in sorted(path.iterdir()) if holds_recording(child)]
    if inside:
        return RecordingError(
            f"{path}: contains no frames itself, but these folders in it can be read: "
            f"{', '.join(inside[:6])}; give one of them, or all of them to `surefoot batch`"
        )
    names = ", ".join(child.name for child in sorted(path.iterdir())[:6]) or "nothing"
    return RecordingError(f"{path}: no frames found (it contains {names}); expected {KINDS}")


def holds_recording(path: Path) -> bool:
    """Whether the names in a file or folder look like a recording; no content is read. No: it may not be looked into."""
    try:
        return _looks_like_one(path)
    except OSError:
        return False


def _looks_like_one(path: Path) -> bool:
    if path.is_file():
        return path.suffix in (".mcap", ".pcd", ".bag", ".db3") or bool(robot_files(path))
    ours = (path / MCAP_NAME).is_file() or (path / DESCRIPTION_FILE).is_file()
    return ours or is_rosbag(path) or any(recognised(path) for recognised, _ in LAYOUTS)


def _nearest(path: Path) -> str:
    if not path.parent.is_dir():
        return ""
    names = [child.name for child in path.parent.iterdir()]
    near = difflib.get_close_matches(path.name, names, n=1)
    return f" (did you mean {path.parent / near[0]}?)" if near else ""
