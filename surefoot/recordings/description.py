"""recording.toml: description of a folder of depth images.

It describes a folder of unknown layout completely; in a folder of a known layout (TUM, 7-Scenes, ...) it adds what
is missing there, such as the intrinsics. Unknown keys are refused.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from jaxtyping import Float

from perception.primitives import safe_input
from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.pose import CAMERA_IN_BODY_AXES
from perception.primitives.safe_input import UnreadableError

from .folder import FolderRecording, FrameFiles, camera_of
from .images import UNSTATED, DepthUnit
from .recording import RecordingInfo

EXAMPLE = """\
rate_hz = 30.0              # or: stamps = "stamps.txt" (one time in s per line), stamps = "name" (file names)
calibrated = false          # true: depth does not bend, since its bend was calibrated, or it was rendered
scale_checked = false       # true: the scene is nearer than 0.1 m or farther than 20 m, the scale is right
[camera]
width = 640
height = 480
fx = 525.0
fy = 525.0
cx = 319.5
cy = 239.5
distortion = [0, 0, 0, 0, 0]  # k1, k2, p1, p2, k3, and k4, k5, k6 of a rational lens; optional
[depth]
folder = "depth"            # optional, as is pattern = "*.png"
scale_per_metre = 1000      # 1000: millimetres, 5000: TUM, 1: metres as floats
none = [0, 65535]           # values of pixels without depth
encoding = "depth"          # optional; "rotated": SUN RGB-D, "kinect-disparity": raw values of the first Kinect
[colour]                    # optional
folder = "color"
[poses]                     # optional
file = "groundtruth.txt"    # timestamp tx ty tz qx qy qz qw; or for each image, in order, 7 numbers without timestamp,
                            # the 12 of a 3x4 matrix or the 16 of a 4x4 one; or: folder = "pose", a matrix in a file each
convention = "camera-to-world"
axes = "optical"            # of the camera: "optical" (x right, y down, z ahead), "y-up" (x right, y up, z back: T265,
                            # OpenGL, ARKit), "body" (x ahead, y left, z up: ROS base_link)
[world]                     # optional
up = [0, 0, 1]
floor_height = 0.0
"""

_CAMERA_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "distortion")
_KEYS: dict[str, tuple[str, ...]] = {
    "": (
        "name",
        "scene",
        "rate_hz",
        "stamps",
        "calibrated",
        "scale_checked",
        "camera",
        "depth",
        "colour",
        "poses",
        "world",
    ),
    "camera": _CAMERA_KEYS,
    "depth": ("folder", "pattern", "scale_per_metre", "none", "encoding"),
    "colour": ("folder", "pattern", "camera"),
    "colour.camera": _CAMERA_KEYS,
    "poses": ("file", "folder", "pattern", "convention", "axes"),
    "world": ("up", "floor_height"),
}
_BESIDE_A_LAYOUT = ("name", "scene", "calibrated", "scale_checked", "camera", "world")
_CONVENTIONS = ("camera-to-world", "world-to-camera")
AXES = {
    "optical": np.eye(3),
    "y-up": np.diag([1.0, -1.0, -1.0]),
    "body": CAMERA_IN_BODY_AXES,
}
"""Rotation from optical axes to the camera axes of the poses."""


@dataclass(frozen=True, eq=False)
class Description:
    """Checked content of a recording.toml; absent values are None.

    Args:
        path: The file.
        rate_hz, stamps: Frame rate, or source of the stamps: a file, or "name" for the file names.
        colour_camera: Intrinsics of the colour images, if they differ.
        world_to_camera: Whether the poses are T_camera_world.
        R_given_optical: Rotation from optical axes to the camera axes of the poses.
        calibrated: The depth does not bend; see `RecordingInfo`.
        scale_checked: The depth scale is right, however near or far the scene is.
        mirrored: fy is printed negative, so that the y axes of camera and world point the other way, as in
            ICL-NUIM; `camera` has the positive one.
        up: Vertical unit vector in the world of the poses.
        keys: Keys at the top level of the file.
    """

    path: Path
    name: str | None = None
    scene: str = ""
    rate_hz: float | None = None
    stamps: str | None = None
    camera: Camera | None = None
    unit: DepthUnit | None = None
    depth_folder: str | None = None
    depth_pattern: str = "*"
    colour_folder: str | None = None
    colour_pattern: str = "*"
    colour_camera: Camera | None = None
    poses_file: str | None = None
    poses_folder: str | None = None
    poses_pattern: str = "*.txt"
    world_to_camera: bool = False
    R_given_optical: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    calibrated: bool = False
    scale_checked: bool = False
    mirrored: bool = False
    up: tuple[float, float, float] | None = None
    floor_height_m: float | None = None
    keys: tuple[str, ...] = ()


def read_description(path: Path) -> Description:
    """Read and check a recording.toml.

    Raises:
        RecordingError: A key or value is invalid; the message names it and the expected value.
    """
    table = _load(path)
    _refuse_unknown(path, table)
    depth, colour = table.get("depth", {}), table.get("colour", {})
    poses, world = table.get("poses", {}), table.get("world", {})
    reader = _Reader(path)
    convention = reader.text(poses, "poses.convention") or _CONVENTIONS[0]
    if convention not in _CONVENTIONS:
        raise RecordingError(
            f"{path}: poses.convention = {convention!r}; expected one of {', '.join(_CONVENTIONS)}"
        )
    axes = reader.text(poses, "poses.axes") or "optical"
    if axes not in AXES:
        raise RecordingError(f"{path}: poses.axes = {axes!r}; expected one of {', '.join(AXES)}")
    flags = {key: table.get(key, False) for key in ("calibrated", "scale_checked")}
    for key, value in flags.items():
        if not isinstance(value, bool):
            raise RecordingError(f"{path}: {key} = {value!r} must be true or false")
    if "poses" in table and ("file" in poses) == ("folder" in poses):
        raise RecordingError(
            f"{path}: [poses] needs file = a text file of TUM lines, or of a pose for each image, or folder = a folder "
            "with a file of one pose for each image; one of the two"
        )
    rate = reader.number(table, "rate_hz")
    if rate is not None and rate <= 0.0:
        raise RecordingError(f"{path}: rate_hz = {rate} must be positive, frames per second")
    return Description(
        path=path,
        name=reader.text(table, "name"),
        scene=reader.text(table, "scene") or "",
        rate_hz=rate,
        stamps=reader.text(table, "stamps"),
        camera=reader.camera(table.get("camera"), "camera"),
        unit=reader.unit(table.get("depth")),
        depth_folder=reader.text(depth, "depth.folder"),
        depth_pattern=reader.pattern(depth, "depth.pattern"),
        colour_folder=reader.text(colour, "colour.folder"),
        colour_pattern=reader.pattern(colour, "colour.pattern"),
        colour_camera=reader.camera(colour.get("camera"), "colour.camera"),
        poses_file=reader.text(poses, "poses.file"),
        poses_folder=reader.text(poses, "poses.folder"),
        poses_pattern=reader.pattern(poses, "poses.pattern", "*.txt"),
        world_to_camera=convention == _CONVENTIONS[1],
        R_given_optical=AXES[axes],
        **flags,
        mirrored=(reader.number(table.get("camera", {}), "camera.fy") or 0.0) < 0.0,
        up=reader.up(world),
        floor_height_m=reader.number(world, "world.floor_height"),
        keys=tuple(table),
    )


def adds_scale(description: Description) -> bool:
    """Whether a description states the depth scale, and neither images nor times nor poses: these are of the layout."""
    others = set(description.keys) - {*_BESIDE_A_LAYOUT, "depth"}
    images = description.depth_folder is not None or description.depth_pattern != "*"
    return description.unit is not None and not others and not images


def complete(info: RecordingInfo, description: Description | None) -> RecordingInfo:
    """Information about a known layout, completed by the description.

    Raises:
        RecordingError: The description has a key that the layout defines.
    """
    if description is None:
        return info
    if description.mirrored and info.kind != "icl_nuim":
        raise RecordingError(
            f"{description.path}: camera.fy is negative; the poses of this folder ({info.kind}) have y down in the "
            "image, so fy must be positive"
        )
    beside: tuple[str, ...] = _BESIDE_A_LAYOUT
    if info.kind == "tum" and adds_scale(description):
        beside = (*beside, "depth")
    beyond = [key for key in description.keys if key not in beside]
    if beyond:
        raise RecordingError(
            f"{description.path}: {beyond[0]} is defined by the layout ({info.kind}) of this folder; "
            f"in addition only {', '.join(_BESIDE_A_LAYOUT)} may be given, or a table [depth] to "
            "describe the whole folder"
        )
    return replace(
        info,
        name=description.name or info.name,
        scene=description.scene or info.scene,
        calibrated=description.calibrated or info.calibrated,
        gravity_up_world=description.up or info.gravity_up_world,
        floor_height_world_m=description.floor_height_m
        if description.floor_height_m is not None
        else info.floor_height_world_m,
    )


def known_layout(
    path: Path,
    info: RecordingInfo,
    files: Sequence[FrameFiles],
    camera: Camera,
    unit: DepthUnit,
    remarks: Sequence[str],
    description: Description | None,
    colour_camera: Camera | None = None,
) -> FolderRecording:
    """The recording of a folder in a known layout; a description may add to its information.

    Raises:
        RecordingError: There is no frame, or the description has a key that the layout defines.
    """
    checked = description is not None and description.scale_checked
    known = complete(info, description)
    return FolderRecording(path, known, files, camera, unit, colour_camera, remarks, checked)


def _load(path: Path) -> dict[str, Any]:
    try:
        return safe_input.toml(safe_input.text(path))
    except UnreadableError as error:
        raise RecordingError(f"{path}: {error}; a recording.toml was expected") from error


def _refuse_unknown(path: Path, table: Mapping[str, Any], prefix: str = "") -> None:
    known = _KEYS[prefix]
    for key, value in table.items():
        whole = f"{prefix}.{key}" if prefix else key
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(known)}"
            raise RecordingError(f"{path}: unknown key {whole}; {hint}")
        if whole in _KEYS:
            if not isinstance(value, dict):
                raise RecordingError(f"{path}: {whole} = {value!r} must be a table [{whole}]")
            _refuse_unknown(path, value, whole)


class _Reader:
    """Reads values from tables; errors name the file and the key."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def text(self, table: Mapping[str, Any], key: str) -> str | None:
        """A string; None if absent."""
        value = table.get(key.split(".")[-1])
        if value is not None and not isinstance(value, str):
            raise RecordingError(f"{self._path}: {key} = {value!r} must be a text in quotes")
        return value

    def pattern(self, table: Mapping[str, Any], key: str, otherwise: str = "*") -> str:
        """A pattern of file names; another one if absent."""
        value = self.text(table, key) or otherwise
        if PurePath(value).is_absolute() or ".." in PurePath(value).parts:
            raise RecordingError(f"{self._path}: {key} = {value!r} must be below its folder")
        return value

    def number(self, table: Mapping[str, Any], key: str) -> float | None:
        """A finite number; None if absent."""
        value = table.get(key.split(".")[-1])
        if value is None:
            return None
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise RecordingError(f"{self._path}: {key} = {value!r} must be a finite number")
        return float(value)

    def numbers(self, table: Mapping[str, Any], key: str, count: int | None) -> tuple[float, ...]:
        """A list of finite numbers."""
        values = table[key.split(".")[-1]]
        if not isinstance(values, list) or (count is not None and len(values) != count):
            many = "" if count is None else f"{count} "
            raise RecordingError(
                f"{self._path}: {key} = {values!r} must be a list of {many}numbers"
            )
        wrong = [
            v
            for v in values
            if isinstance(v, bool) or not isinstance(v, int | float) or not math.isfinite(v)
        ]
        if wrong:
            raise RecordingError(f"{self._path}: {key} holds {wrong[0]!r}; numbers were expected")
        return tuple(float(value) for value in values)

    def camera(self, table: Mapping[str, Any] | None, prefix: str) -> Camera | None:
        """Intrinsics; None without their table."""
        if table is None:
            return None
        values: dict[str, Any] = {}
        for key in _CAMERA_KEYS[:6]:
            value = self.number(table, f"{prefix}.{key}")
            if value is None:
                raise RecordingError(f"{self._path}: {prefix}.{key} is missing; a number in px")
            values[key] = value
        for key in ("width", "height"):
            if values[key] != int(values[key]):
                raise RecordingError(f"{self._path}: {prefix}.{key} = {values[key]} must be whole")
            values[key] = int(values[key])
        values["fy"] = abs(values["fy"])  # negative: see `Description.mirrored`
        if "distortion" in table:
            rational = isinstance(table["distortion"], list) and len(table["distortion"]) == 8
            values["distortion"] = self.numbers(table, f"{prefix}.distortion", 8 if rational else 5)
        return camera_of(self._path, **values)

    def unit(self, table: Mapping[str, Any] | None) -> DepthUnit | None:
        """Depth scale and no-depth values; None without the table [depth]."""
        if table is None:
            return None
        scale = self.number(table, "depth.scale_per_metre")
        if scale is None and table.get("encoding") == "kinect-disparity":
            return DepthUnit(1.0, (), "kinect-disparity")
        if scale is None:
            raise RecordingError(
                f"{self._path}: depth.scale_per_metre is missing; 1000 for millimetres, 5000 for TUM, 1 for "
                "metres as floats"
            )
        if "none" not in table:
            raise RecordingError(
                f"{self._path}: depth.none is missing; the values of pixels without depth, such as [0]"
            )
        marks = self.numbers(table, "depth.none", None)
        try:
            return DepthUnit(
                scale,
                tuple(int(mark) for mark in marks),
                self.text(table, "depth.encoding") or UNSTATED,
            )
        except ConfigError as error:
            raise RecordingError(f"{self._path}: [depth] {error}") from error

    def up(self, table: Mapping[str, Any]) -> tuple[float, float, float] | None:
        """Vertical unit vector; None if absent."""
        if "up" not in table:
            return None
        x, y, z = self.numbers(table, "world.up", 3)
        length = math.hypot(x, y, z)
        if not 0.0 < length < math.inf:
            raise RecordingError(f"{self._path}: world.up = {[x, y, z]} is not a direction")
        return x / length, y / length, z / length
