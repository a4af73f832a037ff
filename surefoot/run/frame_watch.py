"""The frames of a run before anything measures in them: by one clock, with pictures that can be used."""

from __future__ import annotations

from dataclasses import replace

from perception.depth.self_filter import blackened
from perception.monitoring.clock import RunClock, ends
from perception.monitoring.pictures import PictureWatch
from perception.monitoring.status import SLOW, Doubt
from perception.primitives.frame import Frame
from perception.primitives.own_body import OwnBody

GAP = "gap in stamps"
"""What the status says of frames that are missing."""


class FrameWatch:
    """Watches clock and pictures of one run.

    Args:
        own_body: What the cameras see of the robot itself; None for nothing.
        walks: Whether the pose is that of a walking robot, which a gap in the stamps makes doubtful.
    """

    def __init__(self, own_body: OwnBody | None, walks: bool) -> None:
        self._own_body, self._walks = own_body, walks
        self._clock, self._pictures = RunClock(), PictureWatch()

    def check(self, frame: Frame) -> tuple[Frame, list[Doubt]]:
        """The frame by the clock of the run, with the pictures that can be used, and what is wrong with it."""
        stamp_s = self._clock.read(frame.stamp_s, ends(frame))
        frame, doubts = self._pictures.check(replace(frame, stamp_s=stamp_s))
        if frame.colour is not None and self._own_body is not None:
            frame = replace(frame, colour=blackened(frame.colour, self._own_body, frame.joints))
        if self._clock.set_back:
            doubts.append(Doubt("clock set back"))
        if self._clock.missing_s > 0.0 and self._walks:
            doubts.append(Doubt(GAP, SLOW))
        return frame, doubts
