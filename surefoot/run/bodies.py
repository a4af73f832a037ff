"""The bodies of the walking loop: a simulated robot, or the playback of a recording.

Both return the next frame, or None at the end. A live body executes commands; playback ignores them. Every live frame
is encoded and decoded in the recording's format before use, so that live and offline processing get identical data.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from perception.primitives.frame import Frame
from planning.commands import GazeCommand, WalkCommand

from ..recordings.codec import decode, encode
from ..recordings.mcap_format import RecordingWriter
from ..recordings.recording import Recording

if TYPE_CHECKING:
    from sim.faults.injection import FaultInjector
    from sim.robot import SimulatedRobot


@runtime_checkable
class Body(Protocol):
    """Sensors to read, legs and neck to command."""

    def read(self) -> Frame | None:
        """The next frame; None at the end."""
        ...

    def walk(self, command: WalkCommand) -> None:
        """Command the next footstep."""
        ...

    def look(self, gaze: GazeCommand) -> None:
        """Command the gaze."""
        ...


class LiveBody:
    """A simulated robot; records its frames if a writer is given."""

    def __init__(
        self,
        robot: SimulatedRobot,
        writer: RecordingWriter | None = None,
        faults: FaultInjector | None = None,
        lost: Callable[[], None] = lambda: None,
    ) -> None:
        """Take over a robot.

        Args:
            robot: Walks and measures.
            writer: Of the recording.
            faults: Change or drop its frames before they are recorded and processed.
            lost: Called at the instant of each frame that never arrives.
        """
        self._robot, self._writer = robot, writer
        self._faults, self._lost = faults, lost
        self._stamp_s: float | None = None
        self.fell_at_s: float | None = None

    def read(self) -> Frame | None:
        """The next frame, as a recording stores it; None once the robot has fallen.

        The pipeline assumes an upright robot, so frames of a fallen one are useless. A frame with the stamp of the
        previous one is dropped, here and in a recording.
        """
        while not self._robot.fallen:
            frame = self._robot.read()
            if self._robot.fallen:
                break
            if self._faults is not None:
                arrived = self._faults.apply(frame)
                if arrived is None or arrived.stamp_s == self._stamp_s:
                    self._lost()
                    continue
                frame = arrived
            return self._kept(frame)
        self.fell_at_s = self._robot.world.stamp_s
        return None

    def _kept(self, frame: Frame) -> Frame:
        """The frame as the recording has it."""
        self._stamp_s = frame.stamp_s
        encoded = encode(frame)
        if self._writer is not None:
            self._writer.write(encoded)
        return decode(encoded)

    def walk(self, command: WalkCommand) -> None:
        """Command the next footstep; it takes effect at the next double support."""
        self._robot.walk(command)

    def look(self, gaze: GazeCommand) -> None:
        """Command the gaze; the head turns at its maximum speed."""
        self._robot.look(gaze)


class Playback:
    """Playback of a recording, frame by frame."""

    def __init__(self, recording: Recording, skip: int = 0) -> None:
        """Open the recording.

        Args:
            recording: The recording.
            skip: Number of readable frames to skip first.
        """
        self._frames: Iterator[Frame] = itertools.islice(recording.frames(), skip, None)

    def read(self) -> Frame | None:
        """The next readable frame of the recording."""
        return next(self._frames, None)

    def walk(self, command: WalkCommand) -> None:
        """Ignored: the recorded steps are fixed."""

    def look(self, gaze: GazeCommand) -> None:
        """Ignored: the recorded gaze is fixed."""
