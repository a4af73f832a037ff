"""What the cycle drives: a simulated robot, or a recording played back.

Both answer `read` with the next frame, or None at the end. A live body also takes commands; a recording
has long been walked and ignores them. A live frame goes through the recording's wire format before
anything sees it, so what is processed live is to the bit what a recording gives back.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from perception.primitives.frame import Frame
from planning.commands import GazeCommand, WalkCommand

from ..recordings.codec import decode, encode
from ..recordings.mcap_format import RecordingWriter
from ..recordings.recording import Recording

if TYPE_CHECKING:
    from sim.robot import SimulatedRobot


@runtime_checkable
class Body(Protocol):
    """Eyes to read and, where there are any, legs and a neck to command."""

    def read(self) -> Frame | None:
        """The next frame; None when there are no more."""
        ...

    def walk(self, command: WalkCommand) -> None:
        """Ask for the next footstep."""
        ...

    def look(self, gaze: GazeCommand) -> None:
        """Ask the head where to look."""
        ...


class LiveBody:
    """A simulated robot, its frames recorded on the way if a writer is given."""

    def __init__(self, robot: SimulatedRobot, writer: RecordingWriter | None = None) -> None:
        self._robot = robot
        self._writer = writer
        self.fell_at_s: float | None = None

    def read(self) -> Frame | None:
        """The next instant of the sensors, as a recording holds it; None once the robot has fallen.

        What the sensors of a robot say that lies on the floor means nothing to who takes it for upright.
        """
        frame = None if self._robot.fallen else self._robot.read()
        if frame is None or self._robot.fallen:
            self.fell_at_s = self._robot.world.stamp_s
            return None
        encoded = encode(frame)
        if self._writer is not None:
            self._writer.write(encoded)
        return decode(encoded)

    def walk(self, command: WalkCommand) -> None:
        """Taken up at the coming double support."""
        self._robot.walk(command)

    def look(self, gaze: GazeCommand) -> None:
        """The head turns as fast as it can."""
        self._robot.look(gaze)


class Playback:
    """A recording, frame by frame."""

    def __init__(self, recording: Recording, skip: int = 0) -> None:
        """From the beginning.

        Args:
            recording: To be played.
            skip: So many readable frames are passed over first.
        """
        self._frames: Iterator[Frame] = itertools.islice(recording.frames(), skip, None)

    def read(self) -> Frame | None:
        """The next readable frame of the recording."""
        return next(self._frames, None)

    def walk(self, command: WalkCommand) -> None:
        """The steps were made when it was recorded."""

    def look(self, gaze: GazeCommand) -> None:
        """So were the looks."""
