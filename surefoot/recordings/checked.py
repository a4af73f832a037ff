"""The frames of a reader of the user's own, checked as ours check theirs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from perception.depth.time_of_flight import raw_amplitude
from perception.primitives.frame import Frame

from .codec import fault_of
from .recording import FrameError, RecordingInfo, SkipLog, SkippedFrame, with_following


@runtime_checkable
class OwnRecording(Protocol):
    """What a reader of the user's own needs; it may have `skipped` and `remarks` of a `Recording` too."""

    info: RecordingInfo

    def frames(self) -> Iterator[Frame]:
        """The frames in order of time."""
        ...


class CheckedRecording:
    """A recording without the frames that cannot be used; these are skipped and counted."""

    def __init__(self, recording: OwnRecording) -> None:
        self._recording = recording
        self._log = SkipLog()

    @property
    def info(self) -> RecordingInfo:
        """Information about the recording."""
        return self._recording.info

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Frames skipped by the reader, then those that it returned and that cannot be used."""
        return [*getattr(self._recording, "skipped", []), *self._log.skipped]

    @property
    def remarks(self) -> list[str]:
        """Remarks of the reader, if it has any."""
        return list(getattr(self._recording, "remarks", []))

    def frames(self) -> Iterator[Frame]:
        """The frames of which no stamp, pose, image or other number is impossible.

        Raises:
            RecordingError: None is left.
        """
        self._log = log = SkipLog(self.info.name)
        frames = with_following(self._recording.frames(), lambda one: one.stamp_s)
        for number, (frame, following) in enumerate(frames):
            try:
                log.check_stamp(frame.stamp_s, following)
                fault = fault_of(frame) or raw_amplitude(frame.tof)
                if fault:
                    raise FrameError(fault)
            except FrameError as error:
                log.skip(f"frame {number}", str(error))
                continue
            log.note(frame.stamp_s)
            yield frame
        log.check_use(self.info.name)
