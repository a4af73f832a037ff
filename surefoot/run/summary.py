"""How a run ended."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..recordings.recording import Recording
from ..words import count_of

LAST_S = 60.0  # ours: length of the last part of a walk; its decisions say why the walk ended


class Decided(NamedTuple):
    """A decision of a walk: when, why, and where, map frame, m."""

    stamp_s: float
    why: str
    place: tuple[float, float]


def why_unfinished(
    decided: Sequence[Decided], stamp_s: float, limit_s: float, left_m: float
) -> tuple[str, ...]:
    """Why a walk ended before its last goal, and what it decided in its last minute.

    Args:
        decided: Its decisions.
        stamp_s: End of the walk.
        limit_s: Its time limit.
        left_m: Distance to the present goal.
    """
    last = [one for one in decided if one.stamp_s > stamp_s - LAST_S]
    if last and last[-1].why == "unknown":
        reason = "stopped where no step led on: unknown"
    elif stamp_s >= limit_s:
        reason = f"stopped at the time limit of {limit_s:g} s"
    else:
        reason = "ended by its planner"
    counted = Counter(one.why for one in last).most_common()
    words = "; ".join(f"{why} x{count}" for why, count in counted) or "none"
    apart_m = max((math.dist(one.place, last[-1].place) for one in last), default=0.0)
    shown = f"{left_m:.2f} m from the goal; the last {min(LAST_S, stamp_s):.0f} s, within {apart_m:.2f} m: {words}"
    return reason, shown


@dataclass(frozen=True)
class Summary:
    """How a run ended, for the closing lines.

    Args:
        folder: Where everything is.
        frames: Processed.
        skipped: Frames that could not be used, by reason.
        reached: Goals reached, and of how many; None for a recording.
        seconds: Length in the recording's clock.
        fell_at_s: When the robot fell, which ends a run; None if it stood to the end.
        body: Body that walked, "kinematic" or "dynamic" (only this one can fall); None for a recording.
        notes: Anything else the user should know.
        interrupted: Whether Ctrl-C ended the run before its last frame.
        lost: Whether the log of a wheeled robot never determined its pose.
    """

    folder: Path
    frames: int
    seconds: float
    skipped: dict[str, int] = field(default_factory=dict)
    reached: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()
    fell_at_s: float | None = None
    body: str | None = None
    interrupted: bool = False
    lost: bool = False

    @property
    def succeeded(self) -> bool:
        """Whether the run reached its end and every goal, if there were any, without a fall, and had any pose."""
        arrived = self.reached is None or self.reached[0] == self.reached[1]
        return arrived and self.fell_at_s is None and not self.interrupted and not self.lost

    def as_dict(self) -> dict[str, Any]:
        """For machines."""
        return {
            "run": str(self.folder),
            "frames": self.frames,
            "seconds": self.seconds,
            "skipped": self.skipped,
            "goals_reached": None if self.reached is None else self.reached[0],
            "goals": None if self.reached is None else self.reached[1],
            "notes": list(self.notes),
            "fell_at_s": self.fell_at_s,
            "body": self.body,
            "interrupted": self.interrupted,
        }

    def lines(self) -> list[str]:
        """For people."""
        shown = [f"{count_of(self.frames, 'frame')}, {self.seconds:.1f} s"]
        if self.reached is not None:
            shown.append(f"goals reached: {self.reached[0]} of {self.reached[1]}")
        shown += [f"skipped {count}: {reason}" for reason, count in self.skipped.items()]
        shown += list(self.notes)
        shown.append(f"run folder: {self.folder}   report: {self.folder / 'report.html'}")
        return shown


def _count(recording: Recording) -> dict[str, int]:
    reasons = [reason for _, reason in recording.skipped]
    return {str(reason): reasons.count(reason) for reason in np.unique(reasons)} if reasons else {}


def _reasons(recording: Recording) -> str:
    counted = _count(recording)
    return "; ".join(f"{count}: {reason}" for reason, count in counted.items()) or "it is empty"
