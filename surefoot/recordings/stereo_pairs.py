"""Folders of rectified stereo pairs with the calibration files of ROS, OpenCV or KITTI.

Images are in `left/` and `right/` (or `image_0/` and `image_1/`, `image_2/` and `image_3/`), or in one folder with
`left` and `right` in their names. Calibration: `left.yaml` and `right.yaml`, or `NAME_left.yaml` and `NAME_right.yaml`,
as ROS camera_calibration writes them; one `.yaml`, `.yml` or `.xml` file of OpenCV with P1 and P2, as stereoRectify
gives them; or `calib.txt` of KITTI's odometry benchmark with P0 to P3. The calibration is in the folder or one folder up.

Stamps are those of `times.txt`, one a line, s, or the file names where these are times, in s with a fraction or in
ns; else 30 Hz are assumed.

Source: ROS sensor_msgs/CameraInfo; OpenCV, samples/cpp/stereo_calib.cpp (extrinsics.yml); Geiger et al., CVPR 2012.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import UInt8

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError
from perception.primitives.frame import Frame, StereoView

from .description import Description, complete
from .folder import KINECT_HZ, is_stamp, pair, pictures
from .images import first_size, read_colour
from .poses import numbers, read_lines
from .recording import FrameError, RecordingInfo, SkipLog, SkippedFrame, with_following
from .stereo_calibration import (
    has_opencv_pair,
    read_kitti_pair,
    read_opencv_pair,
    read_rectified_pair,
)

Grey: TypeAlias = UInt8[np.ndarray, "h w"]

_FOLDERS = (
    ("left", "right"),
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("image_left", "image_right"),
)
_KITTI = "calib.txt"
_KITTI_MATRICES = {"image_0": ("P0", "P1"), "image_2": ("P2", "P3")}
_SUFFIXES = (".yaml", ".yml")
_NS_DIGITS = 16  # a name of this many digits or more is a time in ns


def is_stereo(path: Path) -> bool:
    """Whether the folder has images of both sides, and a calibration."""
    return has_pairs(path) and (_ros(path) or _opencv(path) or _kitti(path)) is not None


def has_pairs(path: Path) -> bool:
    """Whether the folder has images of both sides."""
    left, right = _images(path)
    return bool(left) and bool(right)


def without_calibration(path: Path) -> RecordingError:
    """The error for a folder of pairs without a calibration."""
    return RecordingError(
        f"{path}: stereo images without a calibration; expected there or one folder up left.yaml and right.yaml of ROS, a "
        f"yaml or xml file of OpenCV with P1 and P2, or {_KITTI} of KITTI beside image_0 and image_1"
    )


def open_stereo(path: Path, description: Description | None = None) -> StereoRecording:
    """Open a folder of rectified pairs.

    Raises:
        RecordingError: The calibration cannot be read, or images do not match.
    """
    lefts, rights = _images(path)
    remarks: list[str] = []
    camera, baseline_m, source = _calibration(path, lefts)
    matches = pair(lefts, rights, path, remarks, "right image")
    pairs = [(a, b) for a, b in zip(lefts, matches, strict=True) if b is not None]
    remarks.append(f"taken as rectified, baseline {baseline_m:.4f} m by {source.name}")
    times = dict(zip(lefts, _times(path, lefts), strict=True))
    stamps = [times[left] for left, _ in pairs]
    known = None not in stamps
    if not known and len(pairs) > 1:
        remarks.append(
            f"no times.txt, and no times in the names of the images: {KINECT_HZ:.0f} pairs a second assumed"
        )
    files = [
        (s if known and s is not None else k / KINECT_HZ, *one)
        for k, (s, one) in enumerate(zip(stamps, pairs, strict=True))
    ]
    info = RecordingInfo(name=path.resolve().name, kind="stereo", frames=len(files))
    return StereoRecording(
        path,
        complete(info, description),
        files,
        camera,
        lambda left, right: StereoView(left, right, baseline_m, camera),
        remarks,
    )


class StereoRecording:
    """Stereo pairs, rectified.

    Attributes:
        SOURCE: How stamps are read, for messages.

    Args:
        path: Folder, for messages.
        info: Information about the recording.
        files: Stamp, s, left and right image of every pair, in order of time.
        camera: Of the size of all images.
        view: The rectified pair of two images.
        remarks: Remarks for the user.

    Raises:
        RecordingError: There is no pair.
    """

    SOURCE = "times.txt is read as s, names of images as s with a fraction or as ns"

    def __init__(
        self,
        path: Path,
        info: RecordingInfo,
        files: list[tuple[float, Path, Path]],
        camera: Camera,
        view: Callable[[Grey, Grey], StereoView],
        remarks: list[str],
    ) -> None:
        if not files:
            raise RecordingError(
                f"{path}: no left image matches a right one; equal numbers in their names were expected"
            )
        self.info, self.remarks = info, remarks
        self._path, self._files, self._camera, self._view = path, files, camera, view
        self._skips = SkipLog()

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Pairs skipped so far by the latest `frames()`."""
        return self._skips.skipped

    def frames(self) -> Iterator[Frame]:
        """The readable pairs, one in memory at a time.

        Raises:
            RecordingError: No pair can be read.
        """
        skips = self._skips = SkipLog(self._path, self.SOURCE)
        before: int | None = None
        pairs = with_following(self._files, lambda one: one[0])
        for number, ((stamp_s, *files), following) in enumerate(pairs):
            try:
                skips.check_stamp(stamp_s, following)
                left, right = (_grey(file, self._camera) for file in files)
                frame = self._frame(number, before, self._view(left, right))
            except FrameError as error:
                skips.skip(files[0].name, str(error))
                continue
            skips.note(stamp_s)
            before = number
            yield frame
        skips.check_use(self._path)

    def _frame(self, number: int, before: int | None, view: StereoView) -> Frame:
        """The frame of a pair; `before` is the number of the frame returned last.

        Raises:
            FrameError: The frame cannot be used.
        """
        return Frame(self._files[number][0], stereo=view)


def _images(path: Path) -> tuple[list[Path], list[Path]]:
    """Images of the left and of the right camera."""
    for names in _FOLDERS:
        left, right = (pictures(path / name / "data") or pictures(path / name) for name in names)
        if left and right:
            return left, right
    return pictures(path, "*left*"), pictures(path, "*right*")


def _ros(path: Path) -> tuple[Path, Path] | None:
    """The two calibration files of ROS."""
    for place in (path, path.resolve().parent):
        for suffix in _SUFFIXES:
            for left in sorted(place.glob(f"*left{suffix}")):
                right = left.with_name(left.name.replace("left", "right"))
                if right.is_file():
                    return left, right
    return None


def _opencv(path: Path) -> Path | None:
    """The calibration file of OpenCV."""
    for place in (path, path.resolve().parent):
        for suffix in (*_SUFFIXES, ".xml"):
            found = [file for file in sorted(place.glob(f"*{suffix}")) if has_opencv_pair(file)]
            if found:
                return found[0]
    return None


def _kitti(path: Path) -> Path | None:
    """The calibration file of KITTI, of images in its folders."""
    lefts, _ = _images(path)
    if not lefts or lefts[0].parent.name not in _KITTI_MATRICES:
        return None
    found = [place / _KITTI for place in (path, path.resolve().parent)]
    return next((file for file in found if file.is_file()), None)


def _calibration(path: Path, lefts: list[Path]) -> tuple[Camera, float, Path]:
    """Camera, baseline in m, and the file that gives them."""
    ros, opencv, kitti = _ros(path), _opencv(path), _kitti(path)
    if ros is not None:
        return *read_rectified_pair(*ros), ros[0]
    if opencv is not None:
        return *read_opencv_pair(opencv, *first_size(path, lefts, "left")), opencv
    if kitti is not None:
        names = _KITTI_MATRICES[lefts[0].parent.name]
        return *read_kitti_pair(kitti, names, *first_size(path, lefts, "left")), kitti
    raise without_calibration(path)


def _times(path: Path, lefts: list[Path]) -> list[float | None]:
    """The time of each left image, s; None if its name is not a time."""
    source = path / "times.txt"
    if not source.is_file():
        return [_stamp(left) for left in lefts]
    lines = read_lines(source)
    if len(lines) != len(lefts):
        raise RecordingError(
            f"{source}: {len(lines)} times for {len(lefts)} left images; one per image was expected"
        )
    return [numbers(source, line, words, 1, "a time in s")[0] for line, words in lines]


def _stamp(path: Path) -> float | None:
    """The time in a file name, s; None if the name is not a time."""
    if is_stamp(path):
        return float(path.stem)
    is_ns = path.stem.isascii() and path.stem.isdigit() and len(path.stem) >= _NS_DIGITS
    return 1e-9 * int(path.stem) if is_ns else None


def _grey(path: Path, camera: Camera) -> Grey:
    return np.asarray(cv2.cvtColor(read_colour(path, camera), cv2.COLOR_RGB2GRAY), np.uint8)
