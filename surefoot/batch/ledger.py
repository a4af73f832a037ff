"""The ledger of a batch: what has happened to every recording, one line of JSON an event, only ever added to.

A line is written whole and reaches the disk before the batch goes on; half a line at the end, of a batch that was killed, is
cut off. The first line says what is done and with which settings. The ledger alone decides what is left to do.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from perception.primitives import safe_input
from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError

from ..results import run_json
from ..results.formats import plain_json, refuse
from ..results.run_json import Maybe, Values
from .job import DIED, DONE, FAILED, LOST

LEDGER = "ledger.jsonl"
QUARANTINED, RELEASED = "quarantined", "released"
EVENT = {
    "job": str, "event": str, "at": str, "source?": str, "identity?": str, "reason?": str, "wall_s?": float,
    "figures?": Values(Maybe(float)),
}  # fmt: skip


@dataclass
class Standing:
    """How it stands with one recording.

    Args:
        end: The event that ended it: done, failed or quarantined; None: it is still to be done.
        deaths: Workers that it killed.
        losses: Workers that were lost while they had it.
    """

    end: dict[str, Any] | None = None
    deaths: int = 0
    losses: int = 0


@dataclass
class Ledger:
    """The ledger at a path; `open` reads or begins it."""

    path: Path
    header: Mapping[str, Any]
    standings: dict[str, Standing] = field(default_factory=dict)

    @staticmethod
    def open(path: Path, header: Mapping[str, Any]) -> Ledger:
        """The ledger of a batch, with the header of an earlier session if there was one.

        Raises:
            RecordingError: A line is damaged.
            OutputError: It cannot be written.
        """
        ledger = Ledger(path, header)
        content = path.read_bytes() if path.is_file() else b""
        whole = content[: content.rfind(b"\n") + 1]
        try:
            if len(whole) < len(content):
                os.truncate(path, len(whole))
            lines = whole.splitlines()
            if not lines:
                ledger._append({"surefoot": "batch", **header})
        except OSError as error:
            refuse(error, path)
        for number, line in enumerate(lines):
            try:
                one = safe_input.json(line)
                run_json.check(one, EVENT if number else dict)
            except UnreadableError as error:
                raise RecordingError(f"{path}, line {number + 1} {error}; correct it") from error
            if number:
                ledger._take(one)
            else:
                ledger.header = one
        return ledger

    def of(self, job: str) -> Standing:
        """How it stands with a job."""
        return self.standings.setdefault(job, Standing())

    def note(self, job: str, event: str, **more: Any) -> None:
        """Add an event.

        Raises:
            OutputError: It cannot be written.
        """
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        one = {"job": job, "event": event, "at": at, **plain_json(more)}
        try:
            self._append(one)
        except OSError as error:
            refuse(error, self.path)
        self._take(one)

    def _append(self, one: Mapping[str, Any]) -> None:
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            line = (json.dumps(one) + "\n").encode()
            written = os.write(handle, line)
            if written < len(line):  # no room for the rest
                os.ftruncate(handle, os.fstat(handle).st_size - written)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
            os.fsync(handle)
        finally:
            os.close(handle)

    def _take(self, one: dict[str, Any]) -> None:
        standing, event = self.of(one["job"]), one["event"]
        standing.deaths += event == DIED
        standing.losses += event == LOST
        if event in (DONE, FAILED, QUARANTINED):
            standing.end = one
        elif event == RELEASED:
            self.standings[one["job"]] = Standing()
