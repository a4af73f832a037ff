"""A batch: every recording once, whatever happens to one of them, to a worker, to a cluster or to the batch itself.

What the same command finds done is not done again. A recording that cannot be used is named with the reason and stops no
other; what killed a worker twice is put in quarantine and not tried again by itself.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from perception.primitives.errors import InputError, OutputError

from ..progress import Say
from ..results.formats import refuse
from ..results.run_folder import MARK, RunFolder
from ..results.version import version
from . import pages
from .job import AGAIN, DIED, DONE, EVALUATE, FAILED, LOST, Answer, Executor, Job
from .ledger import LEDGER, QUARANTINED, RELEASED, Ledger
from .places import Order, current_identity
from .work import figures_of, is_complete

DEATHS = 2  # workers that a recording may kill before it is put in quarantine
LOSSES = 5  # ours: workers that may be lost for other reasons while they have it
ATTEMPTS = 3  # ours: at what fails for a reason that may pass (disk, network)
PAGES_EVERY_S = 60.0


def run_batch(
    order: Order,
    jobs: Sequence[Job],
    out: Path,
    start: Callable[[], Executor],
    say: Say,
    again: bool = False,
) -> list[pages.Row]:
    """Do all jobs of a batch that are not done yet.

    Args:
        order: What is done with every recording.
        jobs: One for every recording.
        out: Folder of the batch: run folders, ledger.jsonl, summary.csv, index.html.
        start: Makes the executor; called if there is anything to do.
        say: Progress.
        again: Whether to try again what is in quarantine.

    Returns:
        One row for every job, in their order.

    Raises:
        InputError: The folder holds a batch with other settings, or a run of it is of another recording.
        RecordingError: The ledger is damaged.
        OutputError: The folder holds something else, cannot be written, or another process writes into it.
    """
    folder = _folder(out)
    ledger = Ledger.open(out / LEDGER, header_of(order))
    _refuse_other(ledger, order, out)
    folder.sweep()
    for job in jobs:
        _take_stock(job, ledger, again)
    rest = [job for job in jobs if not _settled(job, ledger)]
    if len(rest) < len(jobs):
        say(f"before: {pages.counted(jobs, ledger)}")
    try:
        if rest:
            _do(rest, jobs, ledger, out, start(), say)
    finally:
        pages.write(out, jobs, ledger)
    return pages.rows(jobs, ledger)


def _do(
    rest: Sequence[Job], jobs: Sequence[Job], ledger: Ledger, out: Path, executor: Executor, say: Say
) -> None:  # fmt: skip
    """Do the jobs that are left."""
    waiting, running = deque(rest), 0
    attempts: dict[str, int] = {}
    clock = _Clock(len(rest))
    drawn_s = time.monotonic()
    try:
        while waiting or running:
            while waiting and executor.room():
                executor.submit(waiting.popleft())
                running += 1
            job, answer = executor.next()
            running -= 1
            attempts[job.name] = attempts.get(job.name, 0) + 1
            if _note(job, answer, ledger, attempts[job.name]):
                clock.done += 1
            else:
                waiting.append(job)
            say(f"{pages.counted(jobs, ledger)}; {clock.words()}")
            if time.monotonic() - drawn_s > PAGES_EVERY_S:
                pages.write(out, jobs, ledger)
                drawn_s = time.monotonic()
    finally:
        executor.close()


def _note(job: Job, answer: Answer, ledger: Ledger, attempts: int) -> bool:
    """Write the end of an attempt into the ledger; whether it is the end of the job."""
    status, reason = answer["status"], answer["reason"]
    if status == AGAIN and attempts >= ATTEMPTS:
        status, reason = FAILED, f"{reason} ({ATTEMPTS} times)"
    if status == DONE:
        more = {name: answer[name] for name in ("identity", "wall_s", "figures")}
        ledger.note(job.name, DONE, source=job.source, reason=reason, **more)
        return True
    ledger.note(job.name, status, source=job.source, reason=reason)
    standing = ledger.of(job.name)
    for event, times, most in ((DIED, standing.deaths, DEATHS), (LOST, standing.losses, LOSSES)):
        if status == event and times >= most:
            ledger.note(job.name, QUARANTINED, source=job.source, reason=f"{times} times: {reason}")
    return ledger.of(job.name).end is not None


def _take_stock(job: Job, ledger: Ledger, again: bool) -> None:
    """Bring the ledger and the folder together for one job.

    A run that was complete before its line was written is taken over. What failed is tried again.

    Raises:
        InputError: The run is of another recording.
    """
    standing = ledger.of(job.name)
    event = None if standing.end is None else standing.end["event"]
    if event == FAILED or (event == QUARANTINED and again):
        ledger.note(job.name, RELEASED)
    elif event == DONE and standing.end is not None and is_complete(Path(job.target)):
        if standing.end["identity"] != current_identity(job):
            raise InputError(
                f"{job.target} was made of another recording than {job.source} is now; choose another --out, or delete it"
            )
    elif event == DONE:
        ledger.note(job.name, RELEASED)  # its folder was deleted
    elif event is None and job.verb != EVALUATE and is_complete(Path(job.target)):
        more = {"identity": current_identity(job), "figures": figures_of(job)}
        ledger.note(job.name, DONE, source=job.source, reason="", **more)


def _settled(job: Job, ledger: Ledger) -> bool:
    return ledger.of(job.name).end is not None


def header_of(order: Order) -> dict[str, Any]:
    """The first line of the ledger: what must be the same when a batch goes on."""
    settings = RunFolder(Path(order.config).parent).read_text(Path(order.config).name)
    return {
        "verb": order.verb,
        "version": version(),
        "settings": settings if order.config else None,
        "overrides": list(order.overrides),
        "record": order.record,
    }


def _refuse_other(ledger: Ledger, order: Order, out: Path) -> None:
    """Raise an InputError if the ledger is of another batch."""
    now: Mapping[str, Any] = header_of(order)
    for names, words in (
        (("verb",), f"by `{ledger.header.get('verb')}`"),
        (("version",), f"by another version of surefoot ({ledger.header.get('version')})"),
        (("settings", "overrides", "record"), "with another configuration"),
    ):
        if any(ledger.header.get(name) != now[name] for name in names):
            raise InputError(f"{out} was made {words}; choose another --out, or delete it")


def _folder(out: Path) -> RunFolder:
    """The folder of a batch, held by this process."""
    folder = RunFolder(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        if folder.has(MARK):
            raise OutputError(f"output folder {out} is that of a single run; choose another --out")
        if not folder.has(LEDGER) and any(out.iterdir()):
            raise OutputError(
                f"output folder {out} is not empty and not that of a batch; choose another --out, or empty it"
            )
        return folder.hold()
    except OSError as error:
        refuse(error, out)


class _Clock:
    """Rate, and the time that is left."""

    def __init__(self, total: int) -> None:
        self._total, self._began_s = total, time.monotonic()
        self.done = 0

    def words(self) -> str:
        """Such as "14.2 a minute, 1 h 52 min left"."""
        minutes = max(time.monotonic() - self._began_s, 1e-3) / 60
        if not self.done:
            return "the first is under way"
        left = math.ceil((self._total - self.done) * minutes / self.done)
        hours = f"{left // 60} h " if left >= 60 else ""
        return f"{self.done / minutes:.1f} a minute, {hours}{left % 60} min left"
