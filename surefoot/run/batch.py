"""Process many recordings, on all cores of this machine or on a cluster.

Each recording is processed into a folder with a temporary name, which gets its final name when it is complete. A
batch that was killed therefore continues when it is started again. A recording that cannot be processed is listed
as failed and does not stop the others; a worker that dies is replaced and its recording given to another.

Locally the workers are processes of `worker_pool`; a cluster is one of Dask (`distributed`).
"""

from __future__ import annotations

import csv
import html
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from mapping.io.atomic_write import PART
from perception.primitives.errors import ConfigError, InputError, OutputError, SurefootError

from ..config import toml
from ..config.schema import Config
from ..recordings.identity import identity
from ..recordings.open import holds_recording
from ..results.formats import refuse
from ..results.run_folder import BATCH_TABLE, MARK, RunFolder
from ..results.version import version
from .worker_pool import run_all

TABLE = BATCH_TABLE
DONE, KEPT, FAILED = "done", "done before", "failed"
DEATHS = 3  # ours: workers that a recording may kill before it counts as failed

Say = Callable[[str], None]


@dataclass(frozen=True)
class Row:
    """The result of one recording.

    Args:
        recording: Path of the recording.
        run: Run folder; "" if there is none.
        status: "done", "done before" or "failed".
        frames, skipped: Number of frames used, and of frames that could not be used.
        seconds: Length in the recording's clock, s.
        wall_s: Processing time, s.
        error: Why it failed.
    """

    recording: str
    run: str
    status: str
    frames: int = 0
    skipped: int = 0
    seconds: float = 0.0
    wall_s: float = 0.0
    error: str = ""


def process_all(
    places: Sequence[Path],
    out: Path,
    config: Config,
    say: Say,
    workers: int | None = None,
    scheduler: str | None = None,
) -> list[Row]:
    """Process every recording in some folders.

    Args:
        places: Recordings, and folders that hold recordings at any depth.
        out: Receives one run folder for each recording, and summary.csv.
        config: Configuration of every run.
        say: Progress.
        workers: Processes on this machine; None: one per core.
        scheduler: Address of a Dask scheduler to use instead; its workers must see the same paths.

    Returns:
        One row per recording, in the order of their paths.

    Raises:
        InputError: There is no recording, two recordings would get the same name, or the folder holds a run of another
            recording, version or configuration.
        ConfigError: Dask is not installed, or no scheduler answers at the address.
        OutputError: The folder cannot be written, or another process writes into it.
    """
    recordings = find_all(places)
    names = _names(recordings)
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = RunFolder(out)
        if folder.has(MARK):
            raise OutputError(f"output folder {out} is that of a single run; choose another --out")
        folder.hold()
        folder.sweep()
    except OSError as error:
        refuse(error, out)
    times = known_times(out)
    rows = {
        path: row_of(path, out / name, KEPT, times.get(str(path), 0.0))
        for path, name in zip(recordings, names, strict=True)
        if _finished(out / name)
    }
    for path in rows:
        _refuse_other(path, Path(rows[path].run), config)
    todo = [(p, out / n) for p, n in zip(recordings, names, strict=True) if p not in rows]
    if rows:
        say(f"{len(rows)} of {len(recordings)} recordings were done before")
    _write(out, recordings, rows)
    if todo:
        results = (
            _local(todo, config, workers)
            if scheduler is None
            else _cluster(todo, config, scheduler)
        )
        for path, row in results:
            rows[path] = row
            _write(out, recordings, rows)
            failed = sum(one.status == FAILED for one in rows.values())
            note = f", {failed} failed" if failed else ""
            say(f"{len(rows)} of {len(recordings)} recordings{note}: {path.name} {row.status}")
    return [rows[path] for path in recordings]


def find_all(places: Sequence[Path]) -> list[Path]:
    """The recordings in some folders or their subfolders, each once, in order.

    Raises:
        InputError: A path does not exist, or there is no recording.
    """
    found: dict[Path, None] = {}
    for place in places:
        if not place.exists():
            raise InputError(f"{place}: no such file or folder; give recordings or folders of them")
        found |= dict.fromkeys(_below(place))
    if not found:
        listed = ", ".join(str(place) for place in places)
        raise InputError(
            f"{listed}: no recording found in it; `surefoot process` lists what is read"
        )
    return list(found)


def lines(rows: Sequence[Row]) -> list[str]:
    """The table for the terminal."""
    width = max(len(Path(row.recording).name) for row in rows)
    shown = [f"{'recording':<{width}}  {'status':<11} frames skipped  length s  time s"]
    for row in rows:
        shown.append(
            f"{Path(row.recording).name:<{width}}  {row.status:<11} {row.frames:6d} {row.skipped:7d} "
            f"{row.seconds:9.1f} {row.wall_s:7.1f}{'  ' + row.error if row.error else ''}"
        )
    return shown


def process_one(path: Path, target: Path, config: Config) -> Row:
    """Process one recording in this process; an error is reported in the row.

    Args:
        path: The recording.
        target: Run folder; it appears under this name when it is complete.
        config: Configuration of the run.
    """
    from .process import process

    began = time.perf_counter()
    part = target.with_name(f"{PART}{target.name}-{uuid.uuid4().hex[:8]}")
    try:
        process(path, None, config, part, lambda text: None)
        _name_finally(part, target)
        if target.exists():
            shutil.rmtree(target)
        part.replace(target)
    except (SurefootError, OSError, MemoryError) as error:
        shutil.rmtree(part, ignore_errors=True)
        return Row(str(path), "", FAILED, wall_s=_since(began), error=_words(error))
    except Exception as error:  # a bug that shows in one recording must not stop the others
        shutil.rmtree(part, ignore_errors=True)
        words = f"unexpected {type(error).__name__}: {_words(error)}"
        return Row(str(path), "", FAILED, wall_s=_since(began), error=words)
    for stale in target.parent.glob(f"{PART}{target.name}-*"):  # of workers that were killed
        shutil.rmtree(stale, ignore_errors=True)
    return row_of(path, target, DONE, _since(began))


def _name_finally(part: Path, target: Path) -> None:
    """Give the commands in summary and report the name that the folder is about to get."""
    for name, written in (("summary.json", str), ("report.html", html.escape)):
        text = (part / name).read_text(encoding="utf-8")
        text = text.replace(written(part.name), written(target.name))
        (part / name).write_text(text, encoding="utf-8")


def _local(
    todo: list[tuple[Path, Path]], config: Config, workers: int | None
) -> Iterator[tuple[Path, Row]]:
    """Rows as they finish, on the cores of this machine."""
    tasks = [(path, target, config) for path, target in todo]
    for done in run_all(process_one, tasks, workers or os.cpu_count() or 1, DEATHS):
        path = todo[done.task][0]
        yield path, _died(path, "") if done.died else done.result


def _cluster(
    todo: list[tuple[Path, Path]], config: Config, scheduler: str
) -> Iterator[tuple[Path, Row]]:
    """Rows as they finish, on the workers of a Dask scheduler."""
    try:
        import dask

        dask.config.set({"logging": {"distributed": "critical"}})  # read when it is imported
        from dask import distributed
    except ImportError as error:
        raise ConfigError(
            f"--scheduler needs Dask, which is not installed ({error}); "
            "run `pip install 'surefoot[batch]'`, or leave out --scheduler"
        ) from error
    engine: Any = distributed  # untyped in parts
    dask.config.set({"distributed.scheduler.allowed-failures": DEATHS})
    try:
        client = engine.Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"no Dask scheduler answers at {scheduler} ({_words(error)}); expected an address such as "
            "tcp://10.0.0.5:8786"
        ) from error
    with client:
        futures = {
            client.submit(
                process_one, path, target, config, key=f"{path.name}-{uuid.uuid4().hex}"
            ): path
            for path, target in todo
        }
        for future in engine.as_completed(list(futures)):
            path = futures[future]
            if future.status == "finished":
                yield path, future.result()
            else:
                yield path, _died(path, f": {_words(future.exception())}")
            future.release()


def _died(path: Path, why: str) -> Row:
    text = f"its worker died {DEATHS} times (out of memory?){why}"
    return Row(str(path), "", FAILED, error=text)


def _below(place: Path) -> Iterator[Path]:
    if holds_recording(place):
        yield place
        return
    try:
        children = sorted(place.iterdir()) if place.is_dir() else []
    except OSError:  # a folder that may not be looked into
        return
    for child in children:
        hidden = child.name.startswith(".")
        if not hidden and (
            not child.is_symlink() or holds_recording(child)
        ):  # links may go in circles
            yield from _below(child)


def _names(recordings: Sequence[Path]) -> list[str]:
    """The name of the run of each recording: its own, preceded by that of its folder where two are equal."""
    names = [path.resolve().stem if path.is_file() else path.resolve().name for path in recordings]
    twice = {name for name in names if names.count(name) > 1}
    led = [
        f"{path.resolve().parent.name}-{name}" if name in twice else name
        for path, name in zip(recordings, names, strict=True)
    ]
    again = sorted({name for name in led if led.count(name) > 1})
    if again:
        raise InputError(f"two recordings would both be called {again[0]}; process them separately")
    return led


def _finished(run: Path) -> bool:
    return (run / "summary.json").is_file() and (run / "report.html").is_file()


def _refuse_other(path: Path, run: Path, config: Config) -> None:
    """Raise an InputError if a finished run is not that of this recording, configuration and version."""
    made = RunFolder(run)
    summary = made.read_json("summary.json") or {}
    now = {
        "of another recording": (summary.get("recording_identity"), identity(path)),
        "by another version of surefoot": (summary.get("version"), version()),
        "with another configuration": (made.read_text("config.toml"), toml.dumps(config)),
    }
    for words, (then, wanted) in now.items():
        if then != wanted:
            raise InputError(f"{run} was made {words}; choose another --out, or delete it")


def row_of(path: Path, run: Path, status: str, wall_s: float = 0.0) -> Row:
    """The row of a recording whose run is complete.

    Raises:
        RecordingError: The summary of the run is damaged.
    """
    summary = RunFolder(run).read_json("summary.json") or {}
    skipped = summary.get("skipped") or {}
    return Row(
        str(path),
        str(run),
        status,
        summary.get("frames", 0),
        sum(skipped.values()) if isinstance(skipped, dict) else skipped,
        round(float(summary.get("seconds") or 0.0), 3),
        round(wall_s, 1),
    )


def _write(out: Path, recordings: Sequence[Path], rows: dict[Path, Row]) -> None:
    part = out / f"{PART}{TABLE}"
    with part.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [item.name for item in fields(Row)])
        table.writeheader()
        table.writerows(asdict(rows[path]) for path in recordings if path in rows)
    os.replace(part, out / TABLE)


def known_times(out: Path) -> dict[str, float]:
    """Processing time of each recording by an earlier table, s.

    Raises:
        RecordingError: The table is damaged.
    """
    table = RunFolder(out).read_csv(TABLE)
    if table is None:
        return {}
    seconds = np.nan_to_num(table.numbers("wall_s")).tolist()
    return dict(zip(table.words("recording"), seconds, strict=True))


def _since(began: float) -> float:
    return round(time.perf_counter() - began, 1)


def _words(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
