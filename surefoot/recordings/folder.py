"""A folder of images as a recording: reads frame by frame, a little ahead of its user, and skips damaged ones."""

from __future__ import annotations

import itertools
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from perception.primitives.camera import Camera
from perception.primitives.errors import ConfigError, RecordingError
from perception.primitives.frame import ColourView, DepthView, Frame
from perception.primitives.pose import Pose3

from ..words import count_of
from .images import DEPTH_ADVICE, DepthUnit, plausible, read_colour, read_depth, trusted
from .recording import (
    DESCRIPTION_FILE,
    FrameError,
    RecordingInfo,
    SkipLog,
    SkippedFrame,
    with_following,
)

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp")
_UNREAD = (".exr", ".npz", ".pfm", ".hdr", ".raw", ".bin", ".dpt")
KINECT_HZ = 30.0  # of Kinect, Xtion and rendered data sets, for layouts without stamps
MOST_FRAMES = 1_000_000  # ours: nine hours at 30 Hz; larger numbers in names are times
AHEAD = 2  # ours: frames that a second thread decodes meanwhile
PLAUSIBLE_M = (0.1, 20.0)  # ours: a median depth outside means a wrong depth scale, or no room


@dataclass(frozen=True)
class FrameFiles:
    """Files of one frame.

    Args:
        name: Name in messages.
        stamp_s: Stamp in the clock of the recording, s.
        depth, colour: Image files.
        pose: Function that reads T_world_camera of the depth camera, and gives None where tracking was lost; None
            without a pose.
        confidence: Image file with 0 where the depth is not to be used; None without one.
    """

    name: str
    stamp_s: float
    depth: Path
    colour: Path | None = None
    pose: Callable[[], Pose3 | None] | None = None
    confidence: Path | None = None


Read = tuple[Frame, SkippedFrame | None]
"""A frame, and why its colour image cannot be used."""


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
        scale_checked: The user says that the depth scale is right, however far or near the scene is.

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
        scale_checked: bool = False,
    ) -> None:
        if not files:
            raise RecordingError(f"{path}: no depth image found; at least one frame was expected")
        self.info = info
        self._remarks = list(remarks)
        self._without_colour: list[SkippedFrame] = []
        self._lost: list[str] = []
        self._scale_checked = scale_checked
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

    @property
    def remarks(self) -> list[str]:
        """Remarks for the user, with the colour images and poses that the latest `frames()` could not use."""
        found = list(self._remarks)
        if self._without_colour:
            first = self._without_colour[0]
            found.append(
                f"{len(self._without_colour)} colour images cannot be used, their depth is "
                f"(first: {first.name}, {first.reason})"
            )
        if self._lost:
            found.append(
                f"{count_of(len(self._lost), 'frame')} without pose: it is not finite (first: {self._lost[0]})"
            )
        return found

    def frames(self) -> Iterator[Frame]:
        """The readable frames; a few are in memory at a time.

        Raises:
            RecordingError: No frame can be read, or the depth of the first one is not that of a room.
        """
        skips = self._skips = SkipLog(self._path)
        self._without_colour = []
        self._lost = []
        for files, following, reading in self._ahead():
            try:
                skips.check_stamp(files.stamp_s, following)
                frame, fault = reading.result()
            except FrameError as error:
                skips.skip(files.name, str(error))
                continue
            if fault is not None:
                self._without_colour.append(fault)
            if files.pose is not None and frame.T_world_camera is None:
                self._lost.append(files.name)
            if skips.returned == 0 and not self._scale_checked:
                assert frame.depth is not None
                check_scale(
                    self._path,
                    frame.depth.depth,
                    f"at {self._unit.per_metre:g} units per metre",
                    f"Give the right scale ([depth] scale_per_metre in a {DESCRIPTION_FILE}; 1 for metres, 1000 for "
                    "millimetres)",
                )
            skips.note(frame.stamp_s)
            yield frame
        skips.check_use(self._path)

    def _ahead(self) -> Iterator[tuple[FrameFiles, list[float], Future[Read]]]:
        """Every frame with the stamps that follow, being read by a second thread, in order."""
        waiting: deque[tuple[FrameFiles, list[float], Future[Read]]] = deque()
        with ThreadPoolExecutor(1, "images") as reader:
            try:
                for files, following in with_following(self._files, lambda one: one.stamp_s):
                    waiting.append((files, following, reader.submit(self._read, files)))
                    if len(waiting) > AHEAD:
                        yield waiting.popleft()
                while waiting:
                    yield waiting.popleft()
            finally:
                for *_, reading in waiting:
                    reading.cancel()

    def _read(self, files: FrameFiles) -> Read:
        pose = None if files.pose is None else files.pose()
        image = read_depth(files.depth, self._camera, self._unit)
        if files.confidence is not None:
            image = trusted(image, files.confidence, self._camera)
        depth = DepthView(image, self._camera)
        colour = fault = None
        if files.colour is not None:
            try:
                rgb = read_colour(files.colour, self._colour_camera)
                colour = ColourView(rgb, self._colour_camera)
            except FrameError as error:
                fault = SkippedFrame(files.colour.name, str(error))
        return Frame(files.stamp_s, depth=depth, colour=colour, T_world_camera=pose), fault


def check_scale(where: Path, depth: Float32[np.ndarray, "h w"], read_as: str, advice: str) -> None:
    """Ask about an implausible depth of the first frame, m.

    Raises:
        RecordingError: Its median is not that of a room.
    """
    median_m = float(np.nanmedian(depth))
    low, high = PLAUSIBLE_M
    if not low <= median_m <= high:
        raise RecordingError(
            f"{where}: half of the first depth image is {'nearer' if median_m < low else 'farther'} than "
            f"{float(f'{median_m:.3g}'):g} m {read_as}; {low:g} to {high:g} m were expected. "
            f"{advice}, or, if the scene is that near or far, say so in a {DESCRIPTION_FILE}: scale_checked = true"
        )


def pictures(folder: Path, pattern: str = "*") -> list[Path]:
    """Image files of a folder in order of their numbers (9 before 10); empty without images."""
    return _files(folder, pattern, IMAGE_SUFFIXES)


def depth_images(folder: Path, pattern: str = "*") -> list[Path]:
    """As `pictures`; in a folder without images, its arrays of NumPy."""
    return pictures(folder, pattern) or _files(folder, pattern, (".npy",))


def pose_files(folder: Path, pattern: str = "*.txt") -> list[Path]:
    """Files of one pose each, in order of their numbers; empty without any."""
    return _files(folder, pattern)


def _files(folder: Path, pattern: str, suffixes: tuple[str, ...] = ()) -> list[Path]:
    if not folder.is_dir():
        return []
    found = [p for p in folder.glob(pattern) if not suffixes or p.suffix.lower() in suffixes]
    return sorted(found, key=_natural)


def check_suffixes(*folders: Path) -> None:
    """Raise a RecordingError for pictures or arrays of kinds that are not read."""
    inside = (one for folder in folders if folder.is_dir() for one in sorted(folder.iterdir()))
    unread = next((one for one in inside if one.suffix.lower() in _UNREAD), None)
    if unread is not None:
        raise RecordingError(
            f"{unread}: depth images of kind {unread.suffix} are not read; {DEPTH_ADVICE}"
        )


def number_in(path: Path) -> int | None:
    """The last integer in a file name; None without one."""
    found = re.findall(r"\d+", path.stem)
    return int(found[-1]) if found else None


def is_stamp(path: Path) -> bool:
    """Whether a file name is a time in s with a fraction, such as 1341841278.8427.png."""
    return re.fullmatch(r"\d+\.\d+", path.stem) is not None


def stamps_of_names(images: Sequence[Path]) -> list[float]:
    """Of each image, s, by its name: seconds, as 1341841278.8427.png, microseconds, as 0000002-000000033369.png, or a number.

    Numbers are of frames at 30 Hz; where they do not rise, or are too large for that, the order of the images counts.
    """
    if all(is_stamp(image) for image in images):
        return [float(image.stem) for image in images]
    clocks = [re.fullmatch(r"\d+-(\d{12})", image.stem) for image in images]
    if all(clocks):
        return [1e-6 * int(clock[1]) for clock in clocks if clock]
    numbers = [number for image in images if (number := number_in(image)) is not None]
    rise = all(a < b for a, b in itertools.pairwise(numbers))
    if len(numbers) < len(images) or not rise or max(numbers, default=0) > MOST_FRAMES:
        numbers = list(range(len(images)))
    return [number / KINECT_HZ for number in numbers]


def pair(
    images: Sequence[Path],
    others: Sequence[Path],
    where: Path,
    remarks: list[str],
    what: str = "colour image",
) -> list[Path | None]:
    """The colour image of each depth image, by the numbers in their names, else by their order.

    Args:
        images: Depth images, or left images, in order.
        others: Their colour images, right images or files of poses.
        where: Folder, for messages.
        remarks: Gets the number of images without a match.
        what: "colour image", "right image" or "pose".

    Returns:
        None for each image without a match. Colour images that cannot be matched are left out with a remark.

    Raises:
        RecordingError: Right images or poses whose names have no unique numbers in common with those of the images,
            and whose number differs.
    """
    if not others:
        return [None] * len(images)
    by_number = {number_in(path): path for path in others}
    wanted = [number_in(path) for path in images]
    unique = len(by_number) == len(others) and len(set(wanted)) == len(wanted)
    if unique and None not in by_number and None not in wanted:
        unmatched = [path.name for path in images if number_in(path) not in by_number]
        if len(unmatched) < len(images):
            if unmatched:
                remarks.append(
                    f"{len(unmatched)} of {len(images)} images have no {what} (first {unmatched[0]})"
                )
            return [by_number.get(number) for number in wanted]
    if len(others) == len(images):
        return list(others)
    fault = (
        f"{len(images)} images but {len(others)} {what}s, and their names do not match by number"
    )
    if what != "colour image":
        raise RecordingError(f"{where}: {fault}; complete the pairs")
    remarks.append(f"{fault}: colour left out")
    return [None] * len(images)


def pose_lines(
    images: Sequence[Path], count: int, where: Path, stamps: Sequence[float] = ()
) -> list[int]:
    """The line, from 0, of a file of poses that belongs to each image.

    As many lines as images: in their order. Else the number K in the name of an image is the stamp of its line,
    if the stamps are whole numbers; or it counts the lines from 0, or from 1 if no image has the number 0 and one
    has the number of the last line.

    Args:
        images: Image files in order.
        count: Number of lines.
        where: File of the poses, for messages.
        stamps: Stamp of each line, if the lines have stamps.

    Raises:
        RecordingError: An image has no line.
    """
    if count == len(images):
        return list(range(count))
    numbers = [number_in(image) for image in images]
    found: list[int | None] = [n if n is not None and n < count else None for n in numbers]
    at = {int(stamp): line for line, stamp in enumerate(stamps) if stamp == int(stamp)}
    if len(at) == count and all(n in at for n in numbers):
        found = [at[n] for n in numbers if n is not None]
    elif 0 not in numbers and max((n or 0 for n in numbers), default=0) == count:
        found = [None if n is None else n - 1 for n in numbers]
    lines = [line for line in found if line is not None]
    if len(set(lines)) < len(images):
        lost = next(
            (i.name for i, n in zip(images, found, strict=True) if n is None), images[0].name
        )
        raise RecordingError(
            f"{where}: {count} poses for {len(images)} images, none for {lost}; one line per image was "
            "expected, or names that number the lines, or lists of files with stamps"
        )
    return lines


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
        return plausible(
            Camera(width, height, float(fx), float(fy), float(cx), float(cy), distortion)
        )
    except ConfigError as error:
        raise RecordingError(f"{where}: {error}") from error


def _natural(path: Path) -> list[tuple[int, str]]:
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words]
