"""The clock of a run: it follows the stamps of the frames, and never goes back.

A recording and a live run are treated alike. Where a stamp is not later than the one before, the clock has been set:
the run goes on by its usual interval, and follows the new clock from there. A longer interval than usual means that
frames are missing, or that the clock was set ahead; nobody can tell, so what was measured meanwhile counts as lost.
"""

from __future__ import annotations

import math
from collections import deque

from ..primitives.frame import Frame

RECENT = 9  # ours: intervals of which the median is usual
LONG = 1.3  # ours: a step has two frames 0.2 and 0.45 s apart; without one of them they are 0.65 s apart
JITTER_S = 0.02  # ours: of stamps
LEAST_S = 0.001  # ours: of a usual interval
FIRST_S = 0.1  # ours: interval before one is known


Ends = tuple[bool, float]
"""What ends an interval: a frame at which a footstep is due or not, and the tenths of a footstep made since the last."""


def ends(frame: Frame) -> Ends:
    """What this frame ends: standing, a quick step and a long one have intervals of their own."""
    steps = 0.0 if frame.odometry is None else frame.odometry.steps
    return frame.footstep_due, round(steps, 1) if math.isfinite(steps) else 0.0


class UsualIntervals:
    """How far apart frames usually are, by what ends the interval."""

    def __init__(self) -> None:
        self._recent: dict[Ends, deque[float]] = {}

    def usual(self, by: Ends) -> float | None:
        """The median of the latest intervals, s; None before the first."""
        recent = self._recent.get(by)
        return sorted(recent)[len(recent) // 2] if recent else None

    def expected(self, by: Ends) -> float | None:
        """The usual interval, s; for a robot that stands the longest of all, since it may stand as long as a step takes."""
        usual_s = self.usual(by)
        if usual_s is None or by[1] != 0.0:
            return usual_s
        return max(one for other in self._recent if (one := self.usual(other)) is not None)

    def missing(self, by: Ends, elapsed_s: float) -> float:
        """Time without measurements in an interval, s; 0 for a usual one.

        Args:
            by: What ends it.
            elapsed_s: Its length.
        """
        usual_s = self.expected(by)
        self._recent.setdefault(by, deque(maxlen=RECENT)).append(elapsed_s)
        if usual_s is None or elapsed_s <= LONG * usual_s + JITTER_S:
            return 0.0
        return elapsed_s - usual_s


class RunClock:
    """The time of a run, from frame to frame."""

    def __init__(self) -> None:
        self._intervals = UsualIntervals()
        self._offset_s = 0.0
        self._last_s: float | None = None
        self.set_back = False
        """Whether the latest stamp was not later than the one before."""
        self.missing_s = 0.0
        """Time without measurements before the latest frame."""

    def read(self, stamp_s: float, by: Ends) -> float:
        """The time of a frame, s: its stamp, as long as no stamp goes back.

        Args:
            stamp_s: Its stamp.
            by: What the frame ends.
        """
        now_s, last_s = stamp_s + self._offset_s, self._last_s
        self.set_back = last_s is not None and now_s <= last_s
        if last_s is not None and self.set_back:
            usual_s = self._intervals.usual(by) or FIRST_S
            now_s = last_s + max(usual_s, LEAST_S)
            self._offset_s = now_s - stamp_s
        self.missing_s = 0.0
        if last_s is not None:
            self.missing_s = self._intervals.missing(by, now_s - last_s)
        self._last_s = now_s
        return now_s
