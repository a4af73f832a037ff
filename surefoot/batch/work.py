"""One job in a worker process: from the recording to a complete run folder, or to the reason why there is none.

A run is made inside a folder with a temporary name, and moved out of it when it is complete. Two workers may make the same
run, when one of them is thought lost: the first to finish names it, and both are the same to the bit.
"""

from __future__ import annotations

import contextlib
import hashlib
import html
import json
import shutil
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

from mapping.io.atomic_write import PART
from perception.primitives.errors import RecordingError, SurefootError

from ..config.load import load, own_settings
from ..config.schema import Config
from ..progress import silent
from ..results import run_lock
from ..results.run_folder import RunFolder
from ..results.version import version
from ..store.run_metrics import metrics_row
from ..store.run_tables import write_run_tables
from ..words import printable
from .addresses import fetched, is_address
from .job import AGAIN, DIED, DONE, EVALUATE, FAILED, MAP, PANORAMA, PROCESS, SIMULATE, Answer, Job
from .places import current_identity

FIGURES = (
    "frames", "skipped", "seconds", "floor_share", "tilt_sigma_deg", "position_rmse_m", "ate_m", "landmark_nis", "track_nis", "false_movers",
)  # fmt: skip


def do(job: Job) -> Answer:
    """Do a job; whatever goes wrong is in the answer."""
    began = time.perf_counter()
    try:
        answer = _done(job)
    except MemoryError:
        answer = {"status": DIED, "reason": "it needs more memory than a worker has (--memory)"}
    except SurefootError as error:
        answer = {"status": FAILED, "reason": words(error)}
    except OSError as error:  # of disk or network: may pass
        answer = {"status": AGAIN, "reason": words(error)}
    except Exception as error:  # a bug that shows in one recording must not stop the others
        answer = {"status": FAILED, "reason": f"unexpected {type(error).__name__}: {words(error)}"}
    return {**answer, "wall_s": round(time.perf_counter() - began, 3)}


def words(error: BaseException) -> str:
    """The first line of a message."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _done(job: Job) -> Answer:
    if job.version != version():
        raise SurefootError(
            f"the worker has surefoot {version()}, the batch {job.version}; install the same on all workers"
        )
    if printable(job.source) != job.source:
        raise RecordingError(f"{job.source}: its name is not UTF-8; rename it")
    identity = current_identity(job)
    reason = _evaluated(job) if job.verb == EVALUATE else _made(job)
    return {"status": DONE, "reason": reason, "identity": identity, "figures": figures_of(job)}


def figures_of(job: Job) -> dict[str, float | None]:
    """The figures of a complete run that stand in the table of the batch."""
    found = metrics_row(RunFolder(Path(job.target)))
    return {name: None if found[name] is None else float(found[name]) for name in FIGURES}


def _evaluated(job: Job) -> str:
    from ..evaluation.evaluate import evaluate
    from ..report.page import write_report

    run = RunFolder.held(Path(job.target))
    evaluate(run)
    write_report(run)
    write_run_tables(run)
    return ""


def _made(job: Job) -> str:
    """Make a run in a temporary folder, and publish it; a remark on how it ended."""
    target = Path(job.target)
    if is_complete(target):  # by a worker that was thought lost
        return ""
    begun = f"{PART}{hashlib.sha256(target.name.encode()).hexdigest()[:8]}"
    stage = target.with_name(f"{begun}-{uuid.uuid4().hex[:8]}")
    part = stage / target.name  # its own name, so that what quotes it need not be quoted anew
    try:
        with _at_hand(job) as source:
            remark = _VERBS[job.verb](job, source, part)
            _rename_inside(part, {f"{stage.name}/": "", str(source): job.source})
            write_run_tables(RunFolder(part))
        _publish(part, target)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    for stale in target.parent.glob(f"{begun}-*"):
        if not run_lock.is_held(stale / target.name):  # of a worker that was killed
            shutil.rmtree(stale, ignore_errors=True)
    return remark


@contextlib.contextmanager
def _at_hand(job: Job) -> Iterator[Path]:
    """The recording on a disk of this machine."""
    if not is_address(job.source):
        yield Path(job.source)
        return
    with fetched(job.source, job.identity) as copy:
        try:
            yield copy
        except SurefootError as error:
            raise type(error)(str(error).replace(str(copy), job.source)) from error


def _rename_inside(run: Path, names: dict[str, str]) -> None:
    """Give the commands and paths in summary and pages the names that are about to hold."""
    for name, written in (("summary.json", _in_json), ("report.html", html.escape)):
        text = (run / name).read_text(encoding="utf-8")
        for then, now in names.items():
            text = text.replace(written(then), written(now))
        (run / name).write_text(text, encoding="utf-8")


def _in_json(text: str) -> str:
    return json.dumps(text)[1:-1]


def _publish(part: Path, target: Path) -> None:
    """Give a complete run its name, unless another worker was faster."""
    try:
        part.rename(target)
    except OSError:
        if not is_complete(target):
            raise


def is_complete(run: Path) -> bool:
    """Whether a folder holds a complete run."""
    return (run / "summary.json").is_file() and (run / "report.html").is_file()


def _config(job: Job, source: Path) -> Config:
    return load(job.settings or own_settings(source), job.overrides)


def _process(job: Job, source: Path, part: Path) -> str:
    from ..run.process import process

    process(source, None, _config(job, source), part, silent)
    return ""


def _map(job: Job, source: Path, part: Path) -> str:
    from ..offline.job import Job as Offline
    from ..offline.map import map_recording

    map_recording(Offline.open("map", source, None, _config(job, source), part), silent)
    return ""


def _panorama(job: Job, source: Path, part: Path) -> str:
    from ..offline.job import Job as Offline
    from ..offline.panorama import run_panorama

    opened = Offline.open("panorama", source, None, _config(job, source), part)
    content = run_panorama(opened, silent)
    if content["failed"]:
        raise RecordingError(str(content["failed"]))
    return ""


def _simulate(job: Job, source: Path, part: Path) -> str:
    from ..run.simulate import simulate

    config = load(job.settings, job.overrides, scene=job.source or None, seed=job.seed)
    summary = simulate(config, part, job.record, silent)
    if summary.succeeded:
        return ""
    if summary.fell_at_s is not None:
        return f"the robot fell after {summary.fell_at_s:.1f} s"
    reached, goals = summary.reached or (0, 0)
    return f"{reached} of {goals} goals reached"


_VERBS = {PROCESS: _process, MAP: _map, PANORAMA: _panorama, SIMULATE: _simulate}
