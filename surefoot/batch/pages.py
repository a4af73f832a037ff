"""What a batch shows: summary.csv with a row for every recording, and index.html."""

from __future__ import annotations

import csv
import io
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..report import batch_page
from ..report.batch_page import INDEX
from ..results.formats import cell
from ..results.run_folder import BATCH_TABLE, RunFolder
from ..words import count_of, printable
from .job import DONE, Job
from .ledger import QUARANTINED, Ledger
from .thumbnails import thumbnail

WAITING = "waiting"
MOST_LISTED = 20  # recordings without a run that the terminal names


@dataclass(frozen=True)
class Row:
    """The result of one recording.

    Args:
        recording: Path or address of the recording, scene of a walk, or run that was evaluated.
        name: Of the run.
        run: Run folder; "" if there is none.
        status: "done", "failed", "quarantined" or "waiting".
        frames, skipped: Frames used, and frames that could not be used.
        seconds: Length in the recording's clock, s.
        wall_s: Processing time, s.
        floor_share: Share of the frames with a floor.
        tilt_sigma_deg: Claimed standard deviation of the floor's tilt, median, deg.
        position_rmse_m: Position error in the axes of the truth, where the run has them, RMS, m.
        ate_m: Position error after rigid alignment with the truth (ATE), RMS, m.
        landmark_nis, track_nis: Mean NIS by its degrees of freedom; 1 if consistent.
        false_movers: Tracks that count as moving and followed nothing that moves, by the truth.
        reason: Why there is no run, or a remark on it.
    """

    recording: str
    name: str
    run: str
    status: str
    frames: int | None = None
    skipped: int | None = None
    seconds: float | None = None
    wall_s: float | None = None
    floor_share: float | None = None
    tilt_sigma_deg: float | None = None
    position_rmse_m: float | None = None
    ate_m: float | None = None
    landmark_nis: float | None = None
    track_nis: float | None = None
    false_movers: int | None = None
    reason: str = ""


def rows(jobs: Sequence[Job], ledger: Ledger) -> list[Row]:
    """One row for every job."""
    found = []
    for job in jobs:
        end = ledger.of(job.name).end or {"event": WAITING}
        done = end["event"] == DONE
        figures = {key: value for key, value in end.get("figures", {}).items() if key in _FIGURES}
        for key in _COUNTS & {key for key, value in figures.items() if value is not None}:
            figures[key] = int(figures[key])
        found.append(
            Row(
                printable(job.source),
                printable(job.name),
                job.target if done else "",
                end["event"],
                wall_s=end.get("wall_s"),
                reason=printable(_reason(job, end)),
                **figures,
            )
        )
    return found


def _reason(job: Job, end: Mapping[str, Any]) -> str:
    """The reason without the recording, which has a column of its own."""
    reason: str = end.get("reason", "")
    for source in (job.source, job.anywhere().source):
        reason = reason.removeprefix(f"{source}: ")
    return reason


_FIGURES = {one.name for one in fields(Row)[4:-1]} - {"wall_s"}
_COUNTS = {"frames", "skipped", "false_movers"}


def counted(jobs: Sequence[Job], ledger: Ledger) -> str:
    """How many are done, failed and in quarantine, in words."""
    ends = (ledger.of(job.name).end for job in jobs)
    counts = Counter(WAITING if end is None else end["event"] for end in ends)
    bad = [
        f"{counts[name]} {words}"
        for name, words in (("failed", "failed"), (QUARANTINED, "in quarantine"))
        if counts[name]
    ]
    return ", ".join([f"{counts[DONE]} of {len(jobs)} done", *bad])


def write(out: Path, jobs: Sequence[Job], ledger: Ledger) -> None:
    """Write summary.csv and index.html.

    Raises:
        OutputError: The folder cannot be written.
    """
    folder, found = RunFolder(out), rows(jobs, ledger)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([one.name for one in fields(Row)])
    table.writerows([cell(value) for value in asdict(row).values()] for row in found)
    folder.write_text(BATCH_TABLE, text.getvalue())
    shown = [
        {
            **asdict(row),
            "picture": thumbnail(folder, row.name, Path(row.run)) if row.run else b"",
            "link": os.path.relpath(Path(row.run) / "report.html", out) if row.run else "",
        }
        for row in found
    ]
    title = f"{len(jobs)} x {ledger.header['verb']}"
    folder.write_text(INDEX, batch_page.page(title, counted(jobs, ledger), shown))


def lines(found: Sequence[Row], walks: bool = False) -> list[str]:
    """What the terminal says at the end: the recordings without a run, and totals.

    Args:
        found: All rows.
        walks: Whether they are simulated walks, whose remark says why the last goal was not reached.
    """
    bad = [row for row in found if row.status != DONE]
    shown = [f"{row.status}: {row.recording}: {row.reason}" for row in bad[:MOST_LISTED]]
    if len(bad) > MOST_LISTED:
        shown.append(f"and {len(bad) - MOST_LISTED} more in {BATCH_TABLE}")
    if any(row.status == QUARANTINED for row in bad):
        shown.append("the same command with --again tries once more what is in quarantine")
    frames = sum(row.frames or 0 for row in found)
    arrived = sum(row.status == DONE and not row.reason for row in found)
    goals = f", {arrived} of {len(found)} reached every goal" if walks else ""
    return [
        *shown,
        f"{len(found) - len(bad)} of {len(found)} done{goals}, {count_of(frames, 'frame')}",
    ]
