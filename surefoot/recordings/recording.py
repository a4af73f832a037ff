"""The protocol of recordings: information about the whole, and its frames one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import SurefootError
from perception.primitives.frame import Frame
from perception.primitives.landmark import Landmark
from perception.primitives.own_body import OwnBody
from perception.primitives.pose import Pose2

DESCRIPTION_FILE = "recording.toml"
"""What a user tells about a folder, see `description`."""


@dataclass(frozen=True, eq=False)
class RecordingInfo:
    """Information about a recording, known before its first frame.

    Args:
        name: Name in titles and tables.
        kind: Format: "mcap", "rosbag", "tum", "icl_nuim", "seven_scenes", "redwood", "replica", "euroc",
            "plain" or "pcd"; "simulation" for a live run.
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
    """Counts the frames returned and skipped in one pass, and checks their stamps."""

    def __init__(self) -> None:
        self.skipped: list[SkippedFrame] = []
        self.returned = 0
        self._stamp_s: float | None = None

    def skip(self, name: str, reason: str) -> None:
        """Record a frame that cannot be used."""
        self.skipped.append(SkippedFrame(name, reason))

    def check_stamp(self, stamp_s: float, may_go_back: bool = False) -> None:
        """Raise a FrameError for a stamp that is not finite or not later than the one before.

        Args:
            stamp_s: The stamp.
            may_go_back: Accept an earlier one: the frames are in order, and their clock was set.
        """
        if not np.isfinite(stamp_s):
            raise FrameError("the stamp is not a number")
        back = self._stamp_s is not None and stamp_s < self._stamp_s and not may_go_back
        if back or stamp_s == self._stamp_s:
            fault = "equals" if stamp_s == self._stamp_s else "is earlier than"
            raise FrameError(f"the stamp {fault} that of the frame before")

    def note(self, stamp_s: float) -> None:
        """Record a frame that is returned."""
        self._stamp_s = stamp_s
        self.returned += 1

    def why(self) -> str:
        """Reason of the first skipped frame, as the end of a message; empty without skipped frames."""
        if not self.skipped:
            return ""
        first = self.skipped[0]
        return f" ({len(self.skipped)} skipped; {first.name}: {first.reason})"
