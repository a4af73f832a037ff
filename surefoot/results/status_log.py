"""The status of a run over time: a table of what began and ended when, and the same in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from perception.monitoring.status import Doubt

from .row_stream import RowStream
from .run_folder import RunFolder

STATUS = "status.csv"
STATUS_HEADER = ("stamp_s", "status", "asks", "event")
BEGINS, ENDS = "begins", "ends"
MOST_WORDS = 8  # ours: kinds of doubts that the closing lines name


class StatusLog:
    """Writes status.csv, one row for each doubt that begins or ends."""

    def __init__(self, folder: RunFolder) -> None:
        self._table = RowStream(folder, STATUS, STATUS_HEADER)
        self._since: dict[Doubt, float] = {}
        self._past: dict[str, tuple[int, float, float]] = {}  # times, first and last instant
        self._last_s = 0.0

    def note(self, stamp_s: float, status: Sequence[Doubt]) -> None:
        """Take in the status of a frame."""
        for doubt in [one for one in self._since if one not in status]:
            self._end(doubt, stamp_s)
        for doubt in status:
            if doubt not in self._since:
                self._since[doubt] = stamp_s
                self._table.append((stamp_s, doubt.words, doubt.asks, BEGINS))
                times, first_s, _ = self._past.get(doubt.words, (0, stamp_s, stamp_s))
                self._past[doubt.words] = (times + 1, first_s, stamp_s)
        self._last_s = stamp_s

    def _end(self, doubt: Doubt, stamp_s: float) -> None:
        self._table.append((stamp_s, doubt.words, doubt.asks, ENDS))
        times, first_s, _ = self._past[doubt.words]
        self._past[doubt.words] = (times, first_s, stamp_s)
        del self._since[doubt]

    def entries(self) -> list[dict[str, Any]]:
        """For summary.json: each doubt with its first and last instant, and how often it began."""
        open_now = {one.words for one in self._since}
        return [
            {
                "status": words,
                "times": times,
                "from_s": first_s,
                "to_s": self._last_s if words in open_now else last_s,
            }
            for words, (times, first_s, last_s) in self._past.items()
        ]

    def notes(self) -> tuple[str, ...]:
        """For people, a line for each kind of doubt."""
        found = []
        for one in self.entries()[:MOST_WORDS]:
            often = f", {one['times']} times" if one["times"] > 1 else ""
            found.append(f"{one['status']}: {one['from_s']:.1f} to {one['to_s']:.1f} s{often}")
        more = len(self._past) - MOST_WORDS
        return (*found, f"and {more} more in {STATUS}") if more > 0 else tuple(found)

    def close(self) -> None:
        """Close the table; one without rows is not kept."""
        self._table.close(keep_empty=False)
