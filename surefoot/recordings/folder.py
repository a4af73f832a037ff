"""A folder of images as a recording: reads one frame at a time and skips damaged ones."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3

from .images import DepthUnit, read_colour, read_depth
from .recording import FrameError, RecordingInfo, SkipLog, SkippedFrame

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp")
KINECT_HZ = 30.0  # of Kinect, Xtion and rendered data sets, for layouts without stamps
PLAUSIBLE_M = (0.1, 20.0)  # ours: a median depth outside suggests a wrong depth scale


@dataclass(frozen=True)
class FrameFiles:
    """Files of one frame.

    Args:
        name: Name in messages.
        stamp_s: Stamp in the clock of the recording, s.
        depth, colour: Image files.
        pose: Function that reads T_world_camera of the depth camera; None without a pose.
    """

    name: str
    stamp_s: float
    depth: Path
    colour: Path | None = None
    pose: Callable[[], Pose3] | None = None


class FolderRecording:
    """Depth images, optionally with colour images and poses.

    Args:
        path: Folder, for messages.
        info: Information about the recording.
        files: One entry per frame, in order of time.
        camera: Camera of the depth images.
        unit: Depth scale, and values without depth.
        colour_camera: Camera of the colour images, if it differs.
        remarks: Remarks for the user.

    Raises:
        RecordingError: There is no frame.
    """

    def __init__(
        self,
        path: Path,
        info: RecordingInfo,
        files: Sequence[FrameFiles],
        camera: Camera,
        unit: DepthUnit,
        colour_camera: Camera | None = None,
        remarks: Sequence[str] = (),
    ) -> None:
        if not files:
            raise RecordingError(f"{path}: no depth image found; at least one frame was expected")
        self.info = info
        self.remarks = list(remarks)
        self._path = path
        self._files = files
        self._camera = camera
        self._unit = unit
        self._colour_camera = colour_camera or camera
        self._skips = SkipLog()

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._skips.skipped

    def frames(self) -> Iterator[Frame]:
        """The readable frames, one in memory at a time.

        Raises:
            RecordingError: No frame can be read.
        """
        skips = self._skips = SkipLog()
        for files in self._files:
            try:
                skips.check_stamp(files.stamp_s)
                frame = self._read(files)
            except FrameError as error:
                skips.skip(files.name, str(error))
                continue
            if skips.returned == 0:
                self._check_scale(frame)
            skips.note(frame.stamp_s)
            yield frame
        if skips.returned == 0:
            raise RecordingError(f"{self._path}: no frame can be used{skips.why()}")

    def _check_scale(self, frame: Frame) -> None:
        """Remark on an implausible depth of the first frame."""
        assert frame.depth is not None
        median_m = float(np.nanmedian(frame.depth.depth))
        low, high = PLAUSIBLE_M
        remark = (
            f"median depth of the first frame is {median_m:.3g} m at {self._unit.per_metre:g} units per metre; "
            "check the depth scale"
        )
        if not low <= median_m <= high and remark not in self.remarks:
            self.remarks.append(remark)

    def _read(self, files: FrameFiles) -> Frame:
        pose = None if files.pose is None else files.pose()
        depth = DepthView(read_depth(files.depth, self._camera, self._unit), self._camera)
        colour = None
        if files.colour is not None:
            colour = ColourView(read_colour(files.colour, self._colour_camera), self._colour_camera)
        return Frame(files.stamp_s, depth=depth, colour=colour, T_world_camera=pose)


def pictures(folder: Path, pattern: str = "*") -> list[Path]:
    """Image files of a folder in order of their numbers (9 before 10); empty without images."""
    if not folder.is_dir():
        return []
    found = [p for p in folder.glob(pattern) if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file()]
    return sorted(found, key=_natural)


def number_in(path: Path) -> int | None:
    """The last integer in a file name; None without one."""
    found = re.findall(r"\d+", path.stem)
    return int(found[-1]) if found else None


def is_stamp(path: Path) -> bool:
    """Whether a file name is a time in s with a fraction, such as 1341841278.8427.png."""
    return re.fullmatch(r"\d+\.\d+", path.stem) is not None


def pair(
    depths: Sequence[Path], colours: Sequence[Path], where: Path, remarks: list[str]
) -> list[Path | None]:
    """The colour image of each depth image, by the numbers in their names, else by their order.

    Args:
        depths, colours: Image files in order.
        where: Folder, for messages.
        remarks: Gets the number of depth images without a colour image.

    Returns:
        None for each depth image without a colour image.

    Raises:
        RecordingError: The names have no unique numbers in common and the counts differ.
    """
    if not colours:
        return [None] * len(depths)
    by_number = {number_in(path): path for path in colours}
    wanted = [number_in(path) for path in depths]
    unique = len(by_number) == len(colours) and len(set(wanted)) == len(wanted)
    if unique and None not in by_number and None not in wanted:
        unmatched = [path.name for path in depths if number_in(path) not in by_number]
        if len(unmatched) < len(depths):
            if unmatched:
                first = f" (first {unmatched[0]})"
                remarks.append(
                    f"{len(unmatched)} of {len(depths)} depth images have no colour image{first}"
                )
            return [by_number.get(number) for number in wanted]
    if len(colours) == len(depths):
        return list(colours)
    raise RecordingError(
        f"{where}: {len(depths)} depth images but {len(colours)} colour images, and their names do not match "
        "by number; complete the pairs, or move the colour folder away to use depth only"
    )


def camera_of(
    where: Path,
    width: int,
    height: int,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> Camera:
    """A camera from intrinsics in px; errors name the file.

    Raises:
        RecordingError: The intrinsics are invalid.
    """
    try:
        return Camera(width, height, float(fx), float(fy), float(cx), float(cy), distortion)
    except ConfigError as error:
        raise RecordingError(f"{where}: {error}") from error


def _natural(path: Path) -> list[tuple[int, str]]:
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdigit() else (-1, word) for word in words]
