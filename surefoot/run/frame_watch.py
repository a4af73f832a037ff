"""Checks on each frame before it is processed: stamps that increase, images that can be used."""

from __future__ import annotations

from dataclasses import replace

from perception.depth.self_filter import blackened
from perception.monitoring.clock import RunClock, ends
from perception.monitoring.pictures import PictureWatch
from perception.monitoring.status import SLOW, Doubt
from perception.primitives.frame import Frame
from perception.primitives.own_body import OwnBody

GAP = "gap in stamps"
"""Status while the interval between two frames is longer than usual."""


class FrameWatch:
    """Checks stamps and images of one run.

    Args:
        own_body: Finds the pixels of the robot's own body; None if no camera sees it.
        walks: Whether a walking robot carries the sensors: then its pose is doubtful after a gap.
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
