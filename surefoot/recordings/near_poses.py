"""A recording whose given poses must lie near the origin of their world.

Maps hold single precision and hash keys of voxels: at map coordinates of the country, such as UTM, millimetres are lost and
the keys run out, so that cloud and mesh would be empty or torn.
"""

from __future__ import annotations

from collections.abc import Iterator

from perception.primitives.errors import RecordingError
from perception.primitives.frame import Frame

from .recording import Recording, RecordingInfo, SkippedFrame

FARTHEST_M = 1e4  # ours: of a given pose along an axis; single precision is then 1 mm


def far_pose(frame: Frame) -> str:
    """What is wrong with the place of a given pose, and what to do; empty if nothing is."""
    pose = frame.T_world_camera
    if pose is None or max(map(abs, pose.translation)) <= FARTHEST_M:
        return ""
    place = ", ".join(f"{metres:.1f}" for metres in pose.translation)
    return (
        f"its pose is at ({place}) m; poses within {FARTHEST_M:.0f} m of the origin of their world were expected. Subtract "
        "the same offset from all of them, check that they are in m, or ignore them (--ignore-poses)"
    )


class NearPoses:
    """A recording that is refused at the first pose too far away; otherwise as it is."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    @property
    def info(self) -> RecordingInfo:
        """As the recording's."""
        return self._recording.info

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped so far by the latest `frames()`."""
        return self._recording.skipped

    @property
    def remarks(self) -> list[str]:
        """As the recording's."""
        return self._recording.remarks

    def frames(self) -> Iterator[Frame]:
        """The readable frames.

        Raises:
            RecordingError: A pose is too far away.
        """
        for frame in self._recording.frames():
            if fault := far_pose(frame):
                raise RecordingError(f"{self.info.name}: frame at {frame.stamp_s} s: {fault}")
            yield frame
