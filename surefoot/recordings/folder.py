"""A folder of images as a recording: one frame read at a time, the damaged ones skipped and counted."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3

from .images import DepthUnit, read_colour, read_depth
from .recording import FrameError, Journal, RecordingInfo, SkippedFrame

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp")
KINECT_HZ = 30.0  # of Kinect, Xtion and their rendered like, for layouts that write no stamps


@dataclass(frozen=True)
class FrameFiles:
    """Where one frame lies on the disk.

    Args:
        name: For messages.
        stamp_s: In the recording's own clock, s.
        depth, colour: Image files.
        pose: Reads the pose of the depth camera in the world; None where none is given.
    """

    name: str
    stamp_s: float
    depth: Path
    colour: Path | None = None
    pose: Callable[[], Pose3] | None = None


class FolderRecording:
    """Depth images, perhaps with colour and poses.

    Args:
        path: For messages.
        info: `frames` is filled in here.
        files: One entry a frame, in the order of time.
        camera: Of the depth images.
        unit: How to read them.
        colour_camera: Where the colour images have intrinsics of their own.
        remarks: What the user should know.

    Raises:
        RecordingError: when there is no frame at all.
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
        self._journal = Journal()

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._journal.skipped

    def frames(self) -> Iterator[Frame]:
        """The readable frames, one in memory at a time.

        Raises:
            RecordingError: when none can be read.
        """
        journal = self._journal = Journal()
        for files in self._files:
            try:
                journal.check_stamp(files.stamp_s)
                frame = self._read(files)
            except FrameError as error:
                journal.skip(files.name, str(error))
                continue
            journal.note(frame.stamp_s)
            yield frame
        if journal.given == 0:
            raise RecordingError(f"{self._path}: no frame can be used{journal.why()}")

    def _read(self, files: FrameFiles) -> Frame:
        pose = None if files.pose is None else files.pose()
        depth = DepthView(read_depth(files.depth, self._camera, self._unit), self._camera)
        colour = None
        if files.colour is not None:
            colour = ColourView(read_colour(files.colour, self._colour_camera), self._colour_camera)
        return Frame(files.stamp_s, depth=depth, colour=colour, T_world_camera=pose)


def pictures(folder: Path, pattern: str = "*") -> list[Path]:
    """Image files of a folder in the order of their numbers (9 before 10); empty if there is none."""
    if not folder.is_dir():
        return []
    found = [p for p in folder.glob(pattern) if p.suffix.lower() in IMAGE_SUFFIXES and p.is_file()]
    return sorted(found, key=_natural)


def number_in(path: Path) -> int | None:
    """The last whole number in a file's name; None if it has none."""
    found = re.findall(r"\d+", path.stem)
    return int(found[-1]) if found else None


def is_stamp(path: Path) -> bool:
    """Whether a file's name is a time in s with a fraction, as in 1341841278.8427.png."""
    return re.fullmatch(r"\d+\.\d+", path.stem) is not None


def pair(depths: Sequence[Path], colours: Sequence[Path], where: Path) -> list[Path | None]:
    """The colour image of each depth image, by the number in their names, else by their order.

    Returns:
        All None where there are no colour images.

    Raises:
        RecordingError: when there are some, but not one for each.
    """
    if not colours:
        return [None] * len(depths)
    by_number = {number_in(path): path for path in colours}
    wanted = [number_in(path) for path in depths]
    unique = len(by_number) == len(colours) and len(set(wanted)) == len(wanted)
    if unique and None not in by_number and None not in wanted:
        lonely = [path.name for path in depths if number_in(path) not in by_number]
        if not lonely and len(colours) == len(depths):
            return [by_number[number] for number in wanted]
        extra = f"{lonely[0]} has no partner" if lonely else "some colour images have no partner"
    elif len(colours) == len(depths):
        return list(colours)
    else:
        extra = "they cannot be paired by order"
    raise RecordingError(
        f"{where}: {len(depths)} depth images but {len(colours)} colour images ({extra}); complete "
        "the pairs, or move the colour folder away to go without"
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
    """A camera, px, its complaints led by the file they are about.

    Raises:
        RecordingError: for intrinsics that cannot be.
    """
    try:
        return Camera(width, height, float(fx), float(fy), float(cx), float(cy), distortion)
    except ConfigError as error:
        raise RecordingError(f"{where}: {error}") from error


def _natural(path: Path) -> list[tuple[int, str]]:
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdigit() else (-1, word) for word in words]
