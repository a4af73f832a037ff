"""Many runs as one store: their tables, copied once into a few large Parquet files, so that questions are fast.

Below the folder that is asked, `.store/` holds parts: folders with one file per table, and `members.parquet`, which
says which runs are in the part and when their tables were written. A part gets its name when it is complete and never
changes. New runs become a new part; a part with a run that has changed or gone is written again under a new name, and
one that shares a run with a later part has been replaced by it. The store can be deleted: it is made again.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb

from mapping.io.atomic_write import PART
from perception.primitives.errors import InputError, OutputError

from ..progress import Say
from . import parquet
from .schema import COMMIT, FOLDER, RUN, TABLES, empty

STORE, NAMED = ".store", "part-"
MEMBERS = "members"
PART_RUNS = 1000
"""Ours: runs of a new part; a part that changes is written again in a second or two."""
SMALL, MOST_SMALL = 500, 8
"""Ours: parts of fewer runs are put together when they are more than this."""


@dataclass(frozen=True)
class Source:
    """Files of the tables of one run, or of a store.

    Args:
        files: Files of each table that has any.
        folders: Folders in which they are.
        run: Name of the run; None where the files have a column of it.
    """

    files: Mapping[str, Sequence[Path]]
    folders: Sequence[Path]
    run: str | None = None


@contextlib.contextmanager
def opened(place: Path, say: Say) -> Iterator[Source]:
    """The tables of one run, or of all runs below a folder; other processes do not replace them meanwhile.

    Args:
        place: A run folder, or a folder with run folders at any depth.
        say: What was left out, and progress.

    Raises:
        InputError: There is no such folder, or no run with tables below it.
        OutputError: The disk is full.
    """
    folder = place.resolve()
    if not folder.is_dir():
        raise InputError(f"{place} is no folder; give the folder of a run, or of many runs")
    if (folder / COMMIT).is_file():
        yield Source(_files([folder / FOLDER]), [folder / FOLDER], folder.name)
        return
    found, without = find_runs(folder)
    if without:
        say(f"{without} runs below {place} have no tables; `surefoot evaluate RUN` writes them")
    if not found:
        raise InputError(f"{place}: no run with tables in it; `surefoot process` makes one")
    with contextlib.ExitStack() as stack:
        store = _store_of(folder, stack)
        with _locked(store, fcntl.LOCK_EX):
            update(store, folder, found, say)
        stack.enter_context(_locked(store, fcntl.LOCK_SH))
        yield Source(_files(sorted(store.glob(f"{NAMED}*"))), [store])


def find_runs(place: Path) -> tuple[dict[str, int], int]:
    """Runs with tables below a folder, and the number of those without.

    Returns:
        Path below the folder to the time at which the tables were written, ns; number of complete runs without tables.
    """
    found: dict[str, int] = {}
    without, waiting = 0, [str(place)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                folders = [
                    one.path
                    for one in entries
                    if one.name[0] != "." and one.is_dir(follow_symlinks=False)
                ]
        except OSError:  # may not be looked into
            continue
        for folder in folders:
            try:
                written = os.stat(f"{folder}/{COMMIT}").st_mtime_ns
            except OSError:
                without += os.path.isfile(f"{folder}/summary.json")
                waiting.append(folder)
            else:
                found[os.path.relpath(folder, place)] = written
    return dict(sorted(found.items())), without


def update(store: Path, place: Path, found: Mapping[str, int], say: Say) -> None:
    """Bring a store up to date; runs whose tables are damaged are named and left out.

    Args:
        store: Folder of the parts; nobody else uses it meanwhile.
        place: Folder below which the runs are.
        found: Of `find_runs`.
        say: Progress, and damaged runs.

    Raises:
        OutputError: The disk is full.
    """
    for left in store.glob(f"{PART}*"):
        shutil.rmtree(left, ignore_errors=True)
    parts = {part: _members(part) for part in sorted(store.glob(f"{NAMED}*"))}
    later: set[str] = set()
    for part in reversed(list(parts)):
        runs = set(parts[part])
        if runs & later:
            shutil.rmtree(part)
            del parts[part]
        later |= runs
    held = {run: written for members in parts.values() for run, (written, _) in members.items()}
    stale = {run for run, written in held.items() if found.get(run) != written}
    new = [run for run, written in found.items() if held.get(run) != written]
    touched = [part for part, members in parts.items() if stale & members.keys()]
    small = [part for part, members in parts.items() if len(members) < SMALL]
    if len(small) > MOST_SMALL:
        touched = sorted({*touched, *small})
    number = 1 + max((int(part.name.removeprefix(NAMED)) for part in parts), default=0)
    done = len(found) - len(new)
    chunks = [new[first : first + PART_RUNS] for first in range(0, len(new), PART_RUNS)]
    for chunk in chunks or ([[]] if touched else []):
        if len(new) > PART_RUNS:
            say(f"store: {done} of {len(found)} runs")
        members = {
            run: one for part in touched for run, one in parts[part].items() if run not in stale
        }
        damaged = _write_part(store, number, touched, stale, place, chunk, members, found)
        for run in damaged:
            say(f"{run}: its tables are damaged; `surefoot evaluate` writes them again")
        for part in touched:
            shutil.rmtree(part)
        touched, number, done = [], number + 1, done + len(chunk)


def relation(table: str, sources: Sequence[tuple[str, Source]]) -> str:
    """A SELECT of a table over several sources, with the columns of the schema and `run` before them.

    Args:
        table: Name of the table.
        sources: Name to put before the names of the runs ("" for none), and source.
    """
    selects = [f"({empty(table)})"]
    for name, source in sources:
        if source.files.get(table):
            run = RUN if source.run is None else parquet.quoted(source.run)
            named = f"{parquet.quoted(name + '/')} || {run}" if name else run
            given = ", ".join(parquet.file(one) for one in source.files[table])
            rest = f"* EXCLUDE ({RUN})" if source.run is None else "*"
            selects.append(
                f"(SELECT {named} AS {RUN}, {rest} FROM read_parquet([{given}], union_by_name = true))"
            )
    columns = ", ".join(f'"{one.name}"' for one in TABLES[table])
    return f"SELECT {RUN}, {columns} FROM ({' UNION ALL BY NAME '.join(selects)})"


def _files(folders: Sequence[Path]) -> dict[str, list[Path]]:
    every = {name: [folder / f"{name}.parquet" for folder in folders] for name in TABLES}
    return {name: [one for one in files if one.is_file()] for name, files in every.items()}


def _store_of(folder: Path, stack: contextlib.ExitStack) -> Path:
    """The store below a folder; a temporary one if nothing may be written there."""
    store = folder / STORE
    try:
        store.mkdir(exist_ok=True)
        if os.access(store, os.W_OK):
            return store
    except OSError:
        pass
    return Path(
        stack.enter_context(tempfile.TemporaryDirectory(prefix="surefoot-store-"))
    ).resolve()


@contextlib.contextmanager
def _locked(store: Path, how: int) -> Iterator[None]:
    """Wait until no other process changes the store, or, exclusively, until none uses it."""
    handle = os.open(store, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # no locks on this file system
            fcntl.flock(handle, how)
        yield
    finally:
        os.close(handle)


def _members(part: Path) -> dict[str, tuple[int, bool]]:
    """The runs of a part: when their tables were written, ns, and whether these are damaged."""
    database = parquet.connect(threads=1)
    try:
        file = parquet.file(part / f"{MEMBERS}.parquet")
        rows = database.execute(f"SELECT * FROM read_parquet({file})").fetchall()
    except duckdb.Error:
        return {}
    finally:
        database.close()
    return {run: (written, damaged) for run, written, damaged in rows}


def _write_part(
    store: Path,
    number: int,
    replaced: Sequence[Path],
    stale: Collection[str],
    place: Path,
    new: Sequence[str],
    members: dict[str, tuple[int, bool]],
    found: Mapping[str, int],
) -> list[str]:
    """Write a part from what is left of others and from the tables of new runs; returns the damaged among these."""
    stage = store / f"{PART}{number:06d}"
    stage.mkdir()
    bad: list[str] = []
    try:
        try:
            _fill(stage, replaced, stale, place, new)
        except duckdb.Error as error:
            bad = _damaged(place, new)
            if not bad:
                raise OutputError(f"{store} cannot be written: {_line(error)}") from error
            _fill(stage, replaced, stale, place, [run for run in new if run not in bad])
        members |= {run: (found[run], run in bad) for run in new}
        database = parquet.connect(threads=1)
        rows: parquet.Values = {
            RUN: list(members),
            "written_ns": [written for written, _ in members.values()],
            "damaged": [one for _, one in members.values()],
        }
        parquet.copy(database, rows, stage / f"{MEMBERS}.parquet")
        database.close()
        if members:
            os.replace(stage, store / f"{NAMED}{number:06d}")
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return bad


def _fill(
    stage: Path,
    replaced: Sequence[Path],
    stale: Collection[str],
    place: Path,
    new: Sequence[str],
) -> None:
    """Write every table of a part."""
    database = parquet.connect()
    try:
        database.execute(
            f"CREATE TABLE gone AS SELECT unnest(?::VARCHAR[]) AS {RUN}", [list(stale)]
        )
        for table in TABLES:
            old = Source(_files(replaced), replaced)
            selects = [relation(table, [("", old)]) + f" ANTI JOIN gone USING ({RUN})"]
            selects += _of_runs(table, place, new)
            rows = " UNION ALL BY NAME ".join(f"({one})" for one in selects)
            database.execute(
                f"COPY (FROM ({rows})) TO {parquet.quoted(stage / f'{table}.parquet')} ({parquet.form()})"
            )
    finally:
        database.close()


def _of_runs(table: str, place: Path, runs: Sequence[str]) -> list[str]:
    """SELECTs of a table over the files of runs, in the types of the schema."""
    cut = len(str(place)) + 2, len(f"/{FOLDER}/{table}.parquet") + 1
    columns = ", ".join(
        f'CAST("{one.name}" AS {one.kind}) AS "{one.name}"' for one in TABLES[table]
    )
    files = [place / run / FOLDER / f"{table}.parquet" for run in runs]
    there = [parquet.file(one) for one in files if one.is_file()]
    if not there:
        return []
    return [
        f"SELECT {RUN}, {columns} FROM (({empty(table)}) UNION ALL BY NAME "
        f"(SELECT filename[{cut[0]}:-{cut[1]}] AS {RUN}, * EXCLUDE (filename) "
        f"FROM read_parquet([{', '.join(there)}], filename = true, union_by_name = true)))"
    ]


def _damaged(place: Path, runs: Sequence[str]) -> list[str]:
    """Those of some runs whose tables cannot be read, found by halving."""
    database = parquet.connect()
    try:
        for table in TABLES:
            for select in _of_runs(table, place, runs):
                database.execute(f"SELECT count(COLUMNS(*)) FROM ({select})").fetchall()
        return []
    except duckdb.Error:
        if len(runs) == 1:
            return list(runs)
    finally:
        database.close()
    half = len(runs) // 2
    return _damaged(place, runs[:half]) + _damaged(place, runs[half:])


def _line(error: BaseException) -> str:
    return str(error).splitlines()[0]
