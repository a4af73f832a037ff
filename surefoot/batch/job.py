"""One verb on one recording, as a line of JSON that a worker on any machine understands."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from perception.primitives import safe_input

from ..results.version import version

PROCESS, MAP, PANORAMA, EVALUATE, SIMULATE = "process", "map", "panorama", "evaluate", "simulate"
DONE, FAILED, AGAIN, DIED, LOST = "done", "failed", "again", "died", "lost"
"""Ends of an attempt: the run is complete; it cannot be made; something passing went wrong; it killed its worker; its worker
was lost for another reason."""


@dataclass(frozen=True)
class Job:
    """One verb on one recording.

    Args:
        name: Of the run; no two jobs of a batch have the same.
        verb: One of the five above.
        source: Path or address of the recording; of `evaluate` the run folder; of `simulate` the scene.
        target: Run folder.
        config: TOML file of settings; "": those the recording was made with, else the defaults.
        overrides: Single settings, "key=value".
        seed: Of a simulated walk.
        record: Whether a simulated walk keeps its sensor data.
        identity: Digest of the recording when the batch began; "" if it is not known yet.
        version: Of surefoot.
    """

    name: str
    verb: str
    source: str
    target: str
    config: str = ""
    overrides: tuple[str, ...] = ()
    seed: int = 0
    record: bool = False
    identity: str = ""
    version: str = version()

    def line(self) -> str:
        """As one line of text."""
        return json.dumps(asdict(self))

    @staticmethod
    def read(line: str | bytes) -> Job:
        """From `line`."""
        found = safe_input.json(line)
        return Job(**{**found, "overrides": tuple(found["overrides"])})

    def anywhere(self) -> Job:
        """The same with paths that hold in any working directory."""
        source = str(Path(self.source).absolute()) if Path(self.source).exists() else self.source
        target = str(Path(self.target).absolute())
        config = str(Path(self.config).absolute()) if self.config else ""
        return replace(self, source=source, target=target, config=config)

    @property
    def settings(self) -> Path | None:
        """The file of settings."""
        return Path(self.config) if self.config else None


Answer = dict[str, Any]
"""How an attempt ended: `status` (done, ...), `reason` in words, and of a run `identity`, `wall_s` and `figures`."""


@runtime_checkable
class Executor(Protocol):
    """Where jobs run."""

    def room(self) -> bool:
        """Whether another job can be given now."""

    def submit(self, job: Job) -> None:
        """Give a job."""

    def next(self) -> tuple[Job, Answer]:
        """Wait for the end of a job that was given."""

    def close(self) -> None:
        """End all workers that it started."""
