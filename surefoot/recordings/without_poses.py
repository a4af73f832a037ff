"""A recording whose poses are set aside: they serve as truth for the estimated trajectory, not as input."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from perception.primitives.errors import RecordingError
from perception.primitives.frame import Frame
from perception.primitives.pose import Pose3

from .given_poses import GivenPoses
from .open import open_recording
from .recording import Recording, RecordingInfo, SkippedFrame, odd_intrinsics, slow_stamps


class WithoutPoses:
    """A recording as if it had come without poses.

    `poses` holds the stamped poses of the frames given so far, in the recording's world.
    """

    def __init__(self, recording: Recording) -> None:
        if not recording.info.poses_given:
            raise RecordingError(
                f"{recording.info.name}: has no poses that could be ignored; leave out --ignore-poses"
            )
        self._recording = recording
        self.poses: dict[float, Pose3] = {}
        self._odd = ""

    @property
    def info(self) -> RecordingInfo:
        """As the recording's, without what is known of the world of its poses."""
        return replace(
            self._recording.info,
            poses_given=False,
            gravity_up_world=None,
            floor_height_world_m=None,
        )

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._recording.skipped

    @property
    def remarks(self) -> list[str]:
        """The recording's own, and that its poses were ignored."""
        ignored = "poses of the recording ignored; kept as truth/"
        found = (self._odd, slow_stamps(list(self.poses)), ignored)
        return [*self._recording.remarks, *(one for one in found if one)]

    def frames(self) -> Iterator[Frame]:
        """The readable frames, without their poses."""
        for frame in self._recording.frames():
            self._odd = self._odd or odd_intrinsics(frame)
            if frame.T_world_camera is not None:
                self.poses[frame.stamp_s] = frame.T_world_camera
            yield replace(frame, T_world_camera=None)


def open_input(
    path: Path, description: Path | None = None, ignore_poses: bool = False, reader: str = ""
) -> Recording:
    """Open a recording, with poses that must lie near the origin, or on request without poses.

    Args:
        path: A file or folder.
        description: A recording.toml kept elsewhere.
        ignore_poses: Set the recording's poses aside.
        reader: A reader of the user's own, "package.module:Class".

    Raises:
        RecordingError: The recording cannot be read, or has no poses to ignore.
    """
    recording = open_recording(path, description, reader)
    return WithoutPoses(recording) if ignore_poses else GivenPoses(recording)
