"""The time of every stage of every frame: kept on disk during a run, a table at its end.

The stages of a run are known at its end only, so the columns are as well.
"""

from __future__ import annotations

from collections.abc import Mapping

from .row_stream import JsonStream, RowStream
from .run_folder import RunFolder

TIMING, ROWS = "timing.csv", "timing.jsonl"


class TimingLog:
    """Writes timing.csv; it can be kept in a checkpoint."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._rows = JsonStream(folder, ROWS)
        self._stages: list[str] = []  # in the order in which they first ran

    def note(self, stamp_s: float, milliseconds: Mapping[str, float]) -> None:
        """Take in a frame.

        Raises:
            OutputError: The disk is full.
        """
        self._stages += [name for name in milliseconds if name not in self._stages]
        self._rows.append((stamp_s, *(milliseconds.get(name, 0.0) for name in self._stages)))

    def close(self) -> None:
        """Write the table: stages in alphabetical order, 0 where one did not run.

        Raises:
            OutputError: The disk is full.
        """
        order = sorted(range(len(self._stages)), key=self._stages.__getitem__)
        table = RowStream(self._folder, TIMING, ("stamp_s", *sorted(self._stages)))
        for stamp_s, *times in self._rows.drain():
            table.append((stamp_s, *(times[k] if k < len(times) else 0.0 for k in order)))
        table.close()
