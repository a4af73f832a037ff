"""Thousands of recordings: every one a task of its own on all cores, or on a cluster.

Each recording is processed into a folder under a temporary name, which gets its own name only when
everything in it is written. So whoever looks finds finished runs and nothing else; a batch that was killed
goes on where it was when it is started again; a recording that cannot be processed is noted and does not
stop the others. A worker that dies is replaced and its recording given to another.

Engine: Dask (`distributed`), locally or at the address of a scheduler.
"""

from __future__ import annotations

import csv
import json
import logging
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from mapping.io.atomic_write import atomic_path
from perception.primitives.errors import ConfigError, InputError, SurefootError

from ..config.schema import Config
from ..recordings.open import holds_recording

TABLE = "summary.csv"
DONE, KEPT, FAILED = "done", "done before", "failed"
DEATHS = 3  # workers that a recording may cost before it is held to be the cause

Say = Callable[[str], None]


@dataclass(frozen=True)
class Row:
    """What became of one recording.

    Args:
        recording: Its path.
        run: Its run folder; "" if there is none.
        status: "done", "done before" or "failed".
        frames, skipped: Used, and unusable.
        seconds: Length in the recording's clock, s.
        wall_s: Time that it took, s.
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
        out: Gets one run folder for each, and summary.csv.
        config: Of every run.
        say: Progress.
        workers: Processes on this machine; None: one a core.
        scheduler: Address of a Dask scheduler to use instead; its workers must see the same paths.

    Returns:
        One row a recording, in the order of their paths.

    Raises:
        InputError: Nothing to process, or two recordings would get one name.
        ConfigError: Dask is not installed, or nobody answers at the address.
        OutputError: The folder cannot be written.
    """
    recordings = find_all(places)
    names = _names(recordings)
    out.mkdir(parents=True, exist_ok=True)
    rows = {
        path: _row_of(path, out / name, KEPT)
        for path, name in zip(recordings, names, strict=True)
        if _finished(out / name)
    }
    todo = [(p, out / n) for p, n in zip(recordings, names, strict=True) if p not in rows]
    if rows:
        say(f"{len(rows)} of {len(recordings)} recordings were done before")
    _write(out, recordings, rows)
    if todo:
        with _client(workers or os.cpu_count() or 1, scheduler) as client:
            for path, row in _run(client, todo, config):
                rows[path] = row
                _write(out, recordings, rows)
                failed = sum(one.status == FAILED for one in rows.values())
                note = f", {failed} failed" if failed else ""
                say(f"{len(rows)} of {len(recordings)} recordings{note}: {path.name} {row.status}")
    return [rows[path] for path in recordings]


def find_all(places: Sequence[Path]) -> list[Path]:
    """The recordings at or below some places, each once, in order.

    Raises:
        InputError: A place does not exist, or there is no recording at all.
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
    """The table for people."""
    width = max(len(Path(row.recording).name) for row in rows)
    shown = [f"{'recording':<{width}}  {'status':<11} frames skipped  length s  time s"]
    for row in rows:
        shown.append(
            f"{Path(row.recording).name:<{width}}  {row.status:<11} {row.frames:6d} {row.skipped:7d} "
            f"{row.seconds:9.1f} {row.wall_s:7.1f}{'  ' + row.error if row.error else ''}"
        )
    return shown


def process_one(path: Path, target: Path, config: Config) -> Row:
    """Process one recording in this process; whatever goes wrong with it is told in the row.

    Args:
        path: Recording.
        target: Run folder; takes its name when it is whole.
        config: Of the run.
    """
    from .process import process

    began = time.perf_counter()
    part = target.with_name(f".part-{target.name}-{uuid.uuid4().hex[:8]}")
    try:
        process(path, None, config, part, lambda text: None)
        if target.exists():
            shutil.rmtree(target)
        part.replace(target)
    except (SurefootError, OSError, MemoryError) as error:
        shutil.rmtree(part, ignore_errors=True)
        return Row(str(path), "", FAILED, wall_s=_since(began), error=_words(error))
    except Exception as error:  # a fault of ours in one recording is no reason to lose the others
        shutil.rmtree(part, ignore_errors=True)
        words = f"unexpected {type(error).__name__}: {_words(error)}"
        return Row(str(path), "", FAILED, wall_s=_since(began), error=words)
    for stale in target.parent.glob(f".part-{target.name}-*"):  # of workers that were killed
        shutil.rmtree(stale, ignore_errors=True)
    return _row_of(path, target, DONE, _since(began))


def _run(client: Any, todo: list[tuple[Path, Path]], config: Config) -> Iterator[tuple[Path, Row]]:
    """Rows as they come; a recording whose workers keep dying fails by itself."""
    from dask import distributed

    engine: Any = distributed  # untyped in parts
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
            words = f"its worker died {DEATHS} times (out of memory?): {_words(future.exception())}"
            yield path, Row(str(path), "", FAILED, error=words)
        future.release()


def _client(workers: int, scheduler: str | None) -> Any:
    try:
        import dask

        dask.config.set({"logging": {"distributed": "critical"}})  # read when it is imported
        from dask import distributed
    except ImportError as error:
        raise ConfigError(
            f"many recordings are processed by Dask, which is not installed ({error}); "
            "run `pip install 'surefoot[batch]'`, or give one recording"
        ) from error
    engine: Any = distributed  # untyped in parts
    dask.config.set({"distributed.scheduler.allowed-failures": DEATHS})
    if scheduler is not None:
        try:
            return engine.Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"no Dask scheduler answers at {scheduler} ({_words(error)}); expected an address such as "
                "tcp://10.0.0.5:8786"
            ) from error
    cluster = engine.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    )
    return _Owned(cluster, engine.Client(cluster))


class _Owned:
    """A client together with the cluster that was made for it."""

    def __init__(self, cluster: Any, client: Any) -> None:
        self._cluster, self._client = cluster, client

    def __enter__(self) -> Any:
        return self._client

    def __exit__(self, *error: object) -> None:
        self._client.close()
        self._cluster.close()


def _below(place: Path) -> Iterator[Path]:
    if holds_recording(place):
        yield place
        return
    if place.is_dir():
        for child in sorted(place.iterdir()):
            if not child.name.startswith("."):
                yield from _below(child)


def _names(recordings: Sequence[Path]) -> list[str]:
    """A run's name for each: its own, led by that of its folder where two share one."""
    names = [path.resolve().stem if path.is_file() else path.resolve().name for path in recordings]
    twice = {name for name in names if names.count(name) > 1}
    led = [
        f"{path.resolve().parent.name}-{name}" if name in twice else name
        for path, name in zip(recordings, names, strict=True)
    ]
    again = sorted({name for name in led if led.count(name) > 1})
    if again:
        raise InputError(f"two recordings would both be called {again[0]}; process them apart")
    return led


def _finished(run: Path) -> bool:
    return (run / "summary.json").is_file() and (run / "report.html").is_file()


def _row_of(path: Path, run: Path, status: str, wall_s: float = 0.0) -> Row:
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    return Row(
        str(path),
        str(run),
        status,
        int(summary["frames"]),
        sum(summary["skipped"].values()),
        round(float(summary["seconds"]), 3),
        round(wall_s, 1),
    )


def _write(out: Path, recordings: Sequence[Path], rows: dict[Path, Row]) -> None:
    with atomic_path(out / TABLE) as part, part.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [item.name for item in fields(Row)])
        table.writeheader()
        table.writerows(asdict(rows[path]) for path in recordings if path in rows)


def _since(began: float) -> float:
    return round(time.perf_counter() - began, 1)


def _words(error: BaseException) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
