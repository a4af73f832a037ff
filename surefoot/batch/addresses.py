"""Recordings at addresses such as s3://bucket/walks: what is there, and copies of single ones for as long as they are read.

Any storage that `fsspec` knows; keys and endpoints come from its usual environment variables (AWS_ACCESS_KEY_ID,
FSSPEC_S3_ENDPOINT_URL, ...).
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from perception.primitives.errors import ConfigError, InputError, RecordingError

from ..recordings.find import below
from ..results import run_lock
from ..results.run_folder import RunFolder

PREFIX = "surefoot-fetch-"
TEXT = (".txt", ".toml", ".yaml", ".yml", ".json", ".csv")
MOST_TEXT_BYTES = 1 << 16  # of a text file that is read to see what a folder is
MOST_ALIKE = 8  # files of one kind in a folder that are looked at for that
MOST_SHARE = 0.5  # of the free space of the temporary folder that one recording may take
YOUNG_S = 60.0  # a copy that is younger may be of a process that does not hold it yet
MARKS = ("ETag", "etag", "md5", "mtime", "LastModified")
"""Fields of a listing that change when a file is replaced by another of the same name."""
Listing = Mapping[str, Mapping[str, Any]]


def is_address(place: str) -> bool:
    """Whether a place is an address and not a path."""
    return "://" in place


def recordings_at(address: str) -> dict[str, str]:
    """The recordings below an address, each with a digest of the names, sizes and marks of its files.

    Which folders and files are recordings is decided as for those on a disk, by a copy of the names in which only
    small text files have a content.

    Raises:
        InputError: There is nothing at the address.
        ConfigError: The package for this kind of storage is not installed.
        ConnectionError: The storage does not answer.
    """
    system, root = _opened(address)
    listing = _listed(system, root)
    with _temporary() as folder:
        base = folder / "root"
        _outline(system, root, listing, base)
        found = [one.relative_to(base).as_posix() for one in below(base)]
        places = [root if one == "." or root in listing else f"{root}/{one}" for one in found]
    return {str(system.unstrip_protocol(one)): digest(_within(listing, one)) for one in places}


def digest(files: Listing) -> str:
    """A digest of names, sizes and marks."""
    whole = hashlib.sha256()
    for path in sorted(files):
        one = files[path]
        marks = [str(one[mark]) for mark in MARKS if one.get(mark) is not None]
        whole.update("\0".join([path, str(one.get("size")), *marks, ""]).encode())
    return whole.hexdigest()


@contextlib.contextmanager
def fetched(address: str, identity: str) -> Iterator[Path]:
    """A copy of the recording at an address, which is removed when the context ends.

    It takes at most half of the free space of the temporary folder (TMPDIR). What killed processes left there is removed
    first. A copy counts if every file has its size, and the listing is the same before and after.

    Args:
        address: Of the recording.
        identity: Its digest when the batch began.

    Raises:
        RecordingError: It has changed since the batch began, or does not fit.
        ConnectionError: The storage does not answer, or a file did not come whole.
    """
    system, place = _opened(address)
    _sweep()
    own = _listed(system, place)
    if digest(own) != identity:
        raise RecordingError(f"{address}: has changed since the batch began; start it again")
    up = place.rpartition("/")[0]
    files = {**own, **_beside(system, place, up)}
    size = sum(int(one["size"]) for one in files.values())
    free = shutil.disk_usage(tempfile.gettempdir()).free
    if size > MOST_SHARE * free:
        raise RecordingError(
            f"{address}: its {size / 1e9:.1f} GB do not fit into half of the {free / 1e9:.1f} GB that are free in "
            f"{tempfile.gettempdir()}; set TMPDIR to a larger disk"
        )
    with _temporary() as folder:
        root = folder / (PurePosixPath(up).name or "root")
        root.mkdir()
        copies = {path: root / path.removeprefix(f"{up}/") for path in files}
        _copy(system, copies, address)
        for path, copy in copies.items():
            if not copy.is_file() or copy.stat().st_size != files[path]["size"]:
                raise ConnectionError(f"{address}: {path} did not come whole")
        if digest(_listed(system, place)) != identity:
            raise RecordingError(f"{address}: changed while it was fetched; start the batch again")
        yield root / place.removeprefix(f"{up}/")


def _opened(address: str) -> tuple[Any, str]:
    """The storage of an address, and its path in there."""
    try:
        import fsspec

        system, place = fsspec.core.url_to_fs(address)
    except ImportError as error:
        raise ConfigError(
            f"{address} needs a package that is not installed ({error}); run `pip install 'surefoot[cloud]'`"
        ) from error
    except ValueError as error:
        raise InputError(f"{address} is no address of a storage that is known ({error})") from error
    return system, str(place).rstrip("/")


def _listed(system: Any, place: str) -> dict[str, dict[str, Any]]:
    """All files below a folder, or the file itself, by their paths."""
    with _answering(place):
        system.invalidate_cache()
        found = system.find(place, detail=True)
    files = {
        path: one
        for path, one in found.items()
        if one.get("type") == "file" and not path.endswith("/")
    }
    if not files:
        raise InputError(f"{place}: there is nothing; expected recordings, or folders of them")
    for path in files:
        if ".." in path.split("/") or "//" in path.removeprefix(place):
            raise InputError(f"{path}: a name with '..' or '//' leads out of its folder; rename it")
    return files


def _within(listing: Listing, place: str) -> dict[str, Mapping[str, Any]]:
    return {path: one for path, one in listing.items() if f"{path}/".startswith(f"{place}/")}


def _beside(system: Any, place: str, up: str) -> dict[str, Mapping[str, Any]]:
    """What readers look for in the folder that a recording lies in: small text files, truth/, the other logs of a robot."""
    if not up:
        return {}
    with _answering(up):
        there = {one["name"].rstrip("/"): one for one in system.ls(up, detail=True)}
    logs = PurePosixPath(place).suffix in (".dat", ".gz")
    found = {
        path: one
        for path, one in there.items()
        if one["type"] == "file"
        and (logs or (path.endswith(TEXT) and one["size"] <= MOST_TEXT_BYTES))
    }
    return {**found, **(_listed(system, f"{up}/truth") if f"{up}/truth" in there else {})}


@contextlib.contextmanager
def _temporary() -> Iterator[Path]:
    """A temporary folder that is held, so that other processes do not sweep it."""
    with tempfile.TemporaryDirectory(prefix=PREFIX) as name:
        held = RunFolder(Path(name)).hold()
        yield held.root


def _copy(system: Any, copies: Mapping[str, Path], what: str) -> None:
    for copy in copies.values():
        copy.parent.mkdir(parents=True, exist_ok=True)
    with _answering(what):
        system.get(list(copies), [str(copy) for copy in copies.values()])


@contextlib.contextmanager
def _answering(what: str) -> Iterator[None]:
    """Storages raise errors of their own packages: those that do not concern the address are a ConnectionError."""
    try:
        yield
    except (FileNotFoundError, PermissionError) as error:
        raise InputError(f"{what} cannot be read: {error.strerror or error}") from error
    except (OSError, MemoryError):
        raise
    except Exception as error:
        raise ConnectionError(f"{what}: {type(error).__name__}: {error}") from error


def _outline(system: Any, root: str, listing: Listing, base: Path) -> None:
    """The names of a listing as empty files below a folder; small text files with their content."""
    seen: dict[tuple[Path, str], int] = {}
    texts: dict[str, Path] = {}
    base.mkdir()
    for path, one in listing.items():
        inner = PurePosixPath(path).name if path == root else path.removeprefix(f"{root}/")
        copy = base / inner
        kind = (copy.parent, copy.suffix)
        seen[kind] = seen.get(kind, 0) + 1
        if copy.suffix in TEXT and one["size"] <= MOST_TEXT_BYTES:
            texts[path] = copy
        elif seen[kind] <= MOST_ALIKE:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.touch()
    if texts:
        _copy(system, texts, root)


def _sweep() -> None:
    """Remove the copies of processes that were killed."""
    for left in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            young = time.time() - left.stat().st_mtime < YOUNG_S
            if not young and not run_lock.is_held(left):
                shutil.rmtree(left, ignore_errors=True)
