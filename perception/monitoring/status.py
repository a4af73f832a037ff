"""The status of a run: what it doubts at an instant, and what it asks of the walk because of that.

A doubt is said as soon as it is noticed, and some time longer than it is noticed, so that a viewer can read it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

HOLD_S = 1.0  # ours: a lost frame is noticed at one instant only

NOTE, SLOW, STAND = "note", "slow", "stand"
"""What a doubt asks of the walk: nothing, shorter steps, or none."""
LOST = "lost"
"""Status of a robot that does not know where it is."""


class Doubt(NamedTuple):
    """One entry of the status.

    Args:
        words: What is wrong, such as "tof frozen".
        asks: `NOTE`, `SLOW` or `STAND`.
    """

    words: str
    asks: str = NOTE


class StatusBoard:
    """The doubts that hold, frame by frame."""

    def __init__(self) -> None:
        self._said: dict[Doubt, float] = {}

    def update(self, stamp_s: float, doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
        """The status at this instant, in order of words."""
        self._said |= dict.fromkeys(doubts, stamp_s)
        self._said = {one: s for one, s in self._said.items() if stamp_s - s < HOLD_S}
        return tuple(sorted(self._said))
