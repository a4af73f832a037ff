"""What every recording answers: what it is, and its frames one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from perception.primitives.errors import SurefootError
from perception.primitives.frame import Frame
from perception.primitives.landmark import Landmark
from perception.primitives.pose import Pose2


@dataclass(frozen=True, eq=False)
class RecordingInfo:
    """What is known of a recording before its first frame.

    Args:
        name: For titles and tables.
        kind: Which reader gave it: "mcap", "rosbag", "tum", "icl_nuim", "seven_scenes", "redwood", "replica",
            "euroc", "plain", "pcd"; a live run says "simulation".
        poses_given: Whether frames come with `T_world_camera`.
        frames: How many frames it holds, readable or not; None if that is not known beforehand.
        landmarks: Known beforehand, world frame.
        start: Where the robot knew it stood at the first frame, world frame.
        start_covariance: (3, 3) of (x, y, yaw) of `start`, m and rad.
        scene: Name or description of the place; "" if nobody said.
        gravity_up_world: Unit vector that points up, in the world of the given poses; None if neither
            the format nor the recording says.
        floor_height_world_m: Height of the floor along `gravity_up_world`, m; None if nobody says.
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


class SkippedFrame(NamedTuple):
    """A frame that could not be used, and why; reasons are worded so that equal ones can be counted."""

    name: str
    reason: str


class FrameError(SurefootError):
    """One frame cannot be used; the reader skips it and keeps the message as the reason."""


@runtime_checkable
class Recording(Protocol):
    """Frames that can be played back, as often as one likes."""

    @property
    def info(self) -> RecordingInfo:
        """What is known beforehand."""
        ...

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        ...

    @property
    def remarks(self) -> list[str]:
        """What the user should know: assumptions made, parts without a partner, an early end."""
        ...

    def frames(self) -> Iterator[Frame]:
        """The readable frames in the order of time, one in memory at a time.

        Raises:
            RecordingError: when not a single frame can be read.
        """
        ...


class Journal:
    """Bookkeeping of one pass, shared by all readers: frames given and skipped, order of time."""

    def __init__(self) -> None:
        self.skipped: list[SkippedFrame] = []
        self.given = 0
        self._stamp_s: float | None = None

    def skip(self, name: str, reason: str) -> None:
        """Count a frame that cannot be used."""
        self.skipped.append(SkippedFrame(name, reason))

    def check_stamp(self, stamp_s: float) -> None:
        """Refuse a stamp that is not a number or does not follow the one before."""
        if not np.isfinite(stamp_s):
            raise FrameError("its stamp is not a number")
        if self._stamp_s is not None and stamp_s <= self._stamp_s:
            fault = "repeats" if stamp_s == self._stamp_s else "lies before"
            raise FrameError(f"its stamp {fault} the one of the frame before")

    def note(self, stamp_s: float) -> None:
        """A frame of this stamp is handed out."""
        self._stamp_s = stamp_s
        self.given += 1

    def why(self) -> str:
        """What the first skipped frame suffered from, to end a message; "" if none was skipped."""
        if not self.skipped:
            return ""
        first = self.skipped[0]
        return f" ({len(self.skipped)} skipped; {first.name}: {first.reason})"
