"""The protocol of recordings: information about the whole, and its frames one after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.camera import Camera
from perception.primitives.errors import RecordingError, SurefootError
from perception.primitives.frame import Frame
from perception.primitives.landmark import Landmark
from perception.primitives.own_body import OwnBody
from perception.primitives.pose import Pose2

DESCRIPTION_FILE = "recording.toml"
"""What a user tells about a folder, see `description`."""
LAST_STAMP_S = 1.67e10  # ours: in 2499; stamps in ms or ns are later, and MCAP ends in 2554
INTERVALS_S = (2e-4, 3600.0)  # ours: between two frames of one recording
SLOW_S = 5.0  # ours: as ms 200 Hz; slower recordings are unlikely
OFF_CENTRE = 0.25  # ours: share of the image by which a principal point may be off its middle
UNEQUAL = 1.9  # ours: of fx and fy; a picture of 16:9 made square has 1.8
FOLLOWING = 8  # ours: stamps that show whether the one before is too late; four in a row may be
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class RecordingInfo:
    """Information about a recording, known before its first frame.

    Args:
        name: Name in titles and tables.
        kind: Format: "mcap", "rosbag", "tum", "icl_nuim", "seven_scenes", "redwood", "replica", "scannet",
            "stray_scanner", "euroc", "stereo", "plain" or "pcd"; "simulation" for a live run.
        poses_given: Whether frames have `T_world_camera`.
        frames: Number of frames, readable or not; None if unknown.
        landmarks: Known landmarks, world frame.
        start: Pose of the robot at the first frame, world frame.
        start_covariance: Covariance (3, 3) of (x, y, yaw) of `start`, m and rad.
        scene: Name or description of the place; may be empty.
        gravity_up_world: Vertical unit vector in the world of the given poses; None if unknown.
        floor_height_world_m: Height of the floor along `gravity_up_world`, m; None if unknown.
        calibrated: Whether depth hardly bends: rendered, or by cameras whose bend was calibrated.
        own_body: What the cameras may see of the robot itself; None if that is not known.
        levels: Whether the ground has several levels, over which a robot walks that tells where its feet are.
    """

    name: str
    kind: str
    poses_given: bool = False
    frames: int | None = None
    landmarks: tuple[Landmark, ...] = ()
    start: Pose2 | None = None
    start_covariance: Float[np.ndarray, "3 3"] | None = None
    scene: str = ""
    gravity_up_world: tuple[float, float, float] | None = None
    floor_height_world_m: float | None = None
    calibrated: bool = False
    own_body: OwnBody | None = None
    levels: bool = False


class SkippedFrame(NamedTuple):
    """A frame that cannot be used, and the reason; equal reasons have equal text, so they can be counted."""

    name: str
    reason: str


class FrameError(SurefootError):
    """One frame cannot be used; the reader skips it and keeps the message as the reason."""


@runtime_checkable
class Recording(Protocol):
    """Frames that can be played back any number of times."""

    @property
    def info(self) -> RecordingInfo:
        """Information about the recording."""
        ...

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        ...

    @property
    def remarks(self) -> list[str]:
        """Remarks for the user: assumptions, images without a match, an early end."""
        ...

    def frames(self) -> Iterator[Frame]:
        """The readable frames in order of time, one in memory at a time.

        Raises:
            RecordingError: No frame can be read.
        """
        ...


class SkipLog:
    """Counts the frames returned and skipped in one pass, and checks their stamps.

    Args:
        where: Recording, for messages.
        source: How the reader takes stamps, for messages.
    """

    def __init__(self, where: Path | str = "", source: str = "stamps are read as s") -> None:
        self.skipped: list[SkippedFrame] = []
        self.returned = 0
        self._where = f"{where}: " if where else ""
        self._source = source
        self._by_stamp = 0
        self._stamp_s: float | None = None

    def skip(self, name: str, reason: str) -> None:
        """Record a frame that cannot be used."""
        self.skipped.append(SkippedFrame(name, reason))

    def check_stamp(
        self, stamp_s: float, following: Sequence[float] = (), may_go_back: bool = False
    ) -> None:
        """Raise a FrameError for a stamp that is impossible, not later than the one before, or too late.

        Raise a RecordingError for intervals beyond `INTERVALS_S`: a wrong unit, or a clock that was set.

        Too late is a stamp if, of those that follow, as many go on from the stamp before as are late like it: the clock
        returns to its old course, and this stamp would cost all frames up to it. A clock that was set ahead does not.

        Args:
            stamp_s: The stamp.
            following: Stamps of the next frames, see `with_following`.
            may_go_back: Accept an earlier one: the frames are in order, and their clock was set.
        """
        fault = _impossible(stamp_s, may_go_back)
        before_s = -np.inf if self._stamp_s is None else self._stamp_s
        after = [one for one in following if before_s <= one and not _impossible(one)]
        if not fault and stamp_s == before_s:
            fault = "the stamp equals that of the frame before"
        if not fault and not may_go_back:
            if 2 * sum(one < stamp_s for one in after) > len(after):
                fault = "the stamp is later than those of the frames after"
            elif stamp_s < before_s:
                fault = "the stamp is earlier than that of the frame before"
        if fault:
            self._by_stamp += 1
            raise FrameError(fault)
        if not may_go_back:
            self._check_intervals(stamp_s, after)

    def _check_intervals(self, stamp_s: float, after: Sequence[float]) -> None:
        """Raise a RecordingError for a gap before a frame, or if the first frames are too near or too far apart."""
        least, most = INTERVALS_S
        steps = np.diff(np.unique([stamp_s, *after]))
        if self._stamp_s is None and len(steps):
            step = float(np.sort(steps)[(len(steps) - 1) // 2])
            if not least <= step <= most:
                raise RecordingError(
                    f"{self._where}frames are {step:.3g} s apart (median of the first ones); {least:g} to {most:g} s "
                    f"were expected. {self._source[:1].upper()}{self._source[1:]}{_likely(step)}; correct the stamps"
                )
        elif self._stamp_s is not None and stamp_s - self._stamp_s > most:
            raise RecordingError(
                f"{self._where}stamps jump from {self._stamp_s:.10g} to {stamp_s:.10g} s, after {self.returned} frames; "
                f"at most {most:g} s between two frames were expected. The clock was set, or these are two recordings: "
                "correct the stamps, or give the parts one by one"
            )

    def note(self, stamp_s: float) -> None:
        """Record a frame that is returned."""
        self._stamp_s = stamp_s
        self.returned += 1

    def check_use(self, where: Path | str) -> None:
        """Raise a RecordingError after the last frame if none was returned, or if their stamps cost most of them."""
        if self.returned == 0:
            raise RecordingError(f"{where}: no frame can be used{self.why()}")
        if self._by_stamp > self.returned:
            raise RecordingError(
                f"{where}: {self.returned} of {self.returned + len(self.skipped)} frames can be used, because of "
                f"their stamps{self.why()}; correct the stamps"
            )

    def why(self) -> str:
        """Reason of the first skipped frame, as the end of a message; empty without skipped frames."""
        if not self.skipped:
            return ""
        first = self.skipped[0]
        return f" ({len(self.skipped)} skipped; {first.name}: {first.reason})"


def _likely(step_s: float) -> str:
    """The unit that would make an interval likely, as the end of a message; empty if none does."""
    if step_s < 1e-8:
        return ", and may be numbers of frames"
    for unit, scale in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if step_s > 1.0 and 1e-3 <= step_s * scale <= 1.0:
            return f", and may be in {unit}"
        if step_s < 1.0 and 1e-3 <= step_s / scale < 1.0:
            return f", and may be in a unit {1 / scale:g} times as long"
    return ""


def slow_stamps(stamps_s: Sequence[float]) -> str:
    """A remark on the first stamps of a recording if they are likely to be in ms; empty if not."""
    steps = np.diff(stamps_s)
    if len(steps) < 2 or any(stamp % 1.0 for stamp in stamps_s) or np.median(steps) < SLOW_S:
        return ""
    return (
        f"frames are {np.median(steps):g} s apart, and their stamps are whole numbers{_likely(float(np.median(steps)))}; "
        "divide them by 1000 if so, since speeds of obstacles depend on them"
    )


def odd_intrinsics(frame: Frame) -> str:
    """A remark on intrinsics that are likely to be those of images of another size; empty if they are not."""
    view = frame.depth or frame.stereo or frame.colour
    if view is None:
        return ""
    return odd_camera(view.camera)


def odd_camera(camera: Camera) -> str:
    """A remark on the intrinsics of a camera, see `odd_intrinsics`."""
    aside = [(camera.cx + 0.5) / camera.width, (camera.cy + 0.5) / camera.height]
    ratio = camera.fx / camera.fy
    if all(abs(one - 0.5) <= OFF_CENTRE for one in aside) and 1 / UNEQUAL <= ratio <= UNEQUAL:
        return ""
    return (
        f"focal length ({camera.fx:g}, {camera.fy:g}) and principal point ({camera.cx:g}, {camera.cy:g}) px are unusual for "
        f"images of {camera.width}x{camera.height} px; if they belong to another size, scale them by the ratio of the sizes"
    )


def with_following(
    items: Iterable[T], stamp: Callable[[T], float]
) -> Iterator[tuple[T, list[float]]]:
    """Every item, and the stamps of up to `FOLLOWING` items after it."""
    waiting: deque[T] = deque()
    for item in items:
        waiting.append(item)
        if len(waiting) > FOLLOWING:
            yield waiting.popleft(), [stamp(one) for one in waiting]
    while waiting:
        yield waiting.popleft(), [stamp(one) for one in waiting]


def _impossible(stamp_s: float, may_be_negative: bool = False) -> str:
    """What is wrong with a stamp by itself; empty if nothing is."""
    if not np.isfinite(stamp_s):
        return "the stamp is not a number"
    if stamp_s > LAST_STAMP_S:
        return "the stamp is beyond the year 2499; s were expected, not ms or ns"
    if stamp_s < 0.0 and not may_be_negative:
        return "the stamp is negative; 0 or more was expected"
    return ""
