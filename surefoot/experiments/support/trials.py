"""Independent trials in parallel processes, with a cache of finished results.

Every result is stored as soon as its trial ends, so that `--resume` continues an interrupted study. A stored
result is used only if the source code, the function and its arguments are unchanged.

Source: ours.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

from mapping.io.atomic_write import atomic_path
from perception.primitives import plugins, safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from ... import cores
from ...progress import Say
from ...results import object_file
from ...run.end_with_parent import end_with_parent

WORKERS = cores.available()
PACKAGES = ("perception", "mapping", "planning", "sim", "surefoot")

R = TypeVar("R")
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ResultCache:
    """Folder of stored results.

    Args:
        folder: Created if missing.
        resume: Whether to use results that are already stored.
    """

    folder: Path
    resume: bool


_CACHE: ContextVar[ResultCache | None] = ContextVar("cache_folder", default=None)


@runtime_checkable
class Listener(Protocol):
    """What `run_trials` tells within `heard_by`: every finished study, and before it whether its results are known."""

    def known(self, todo: Sequence[tuple[Any, ...]]) -> Sequence[Any] | None:
        """Results to give instead of running the trials; None: run them."""

    def finished(
        self, todo: Sequence[tuple[Any, ...]], results: Sequence[Any], waited_s: float
    ) -> None:
        """All trials of a study have ended; `waited_s` went by while they ran."""


_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def cached(cache_folder: ResultCache | None) -> Iterator[None]:
    """Store the results of all trials that run within this context; None stores nothing."""
    token = _CACHE.set(cache_folder)
    try:
        yield
    finally:
        _CACHE.reset(token)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Tell a listener of all trials that run within this context."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def run_trials(work: Callable[..., R], todo: Sequence[tuple[Any, ...]]) -> Iterator[R]:
    """Results of `work(*task)` for every task, in order, computed in parallel processes.

    Args:
        work: A module-level function; its result is of numbers, arrays and classes of the project.
        todo: Arguments of each call; their repr identifies the trial in the cache.
    """
    listener = _LISTENER.get()
    known = None if listener is None else listener.known(todo)
    if known is not None:
        yield from known
        return
    found: list[R] = []
    waited_s, began_s = 0.0, time.monotonic()
    for result in _run(work, todo):
        waited_s += time.monotonic() - began_s
        found.append(result)
        yield result
        began_s = time.monotonic()
    if listener is not None:
        listener.finished(todo, found, waited_s + time.monotonic() - began_s)


def _run(work: Callable[..., R], todo: Sequence[tuple[Any, ...]]) -> Iterator[R]:
    """The results of all trials, in order, from the cache or from parallel processes."""
    cache_folder = _usable_cache(_CACHE.get())
    places = [_result_path(cache_folder, work, task) for task in todo]
    with ProcessPoolExecutor(
        WORKERS, mp_context=get_context("spawn"), initializer=end_with_parent
    ) as pool:
        waiting: list[Any] = []
        for task, place in zip(todo, places, strict=True):
            done = _stored(place) if cache_folder is not None and cache_folder.resume else None
            waiting.append(
                done if done is not None else pool.submit(_run_and_store, work, task, place)
            )
        try:
            for one in waiting:
                yield one[0] if isinstance(one, tuple) else one.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def run_all(
    work: Callable[..., R], todo: Sequence[tuple[Any, ...]], say: Say, what: str
) -> list[R]:
    """The results of `run_trials` as a list, with progress in the form "3 of 20 walks"."""
    found: list[R] = []
    for result in run_trials(work, todo):
        found.append(result)
        say(f"{len(found)} of {len(todo)} {what}")
    return found


def _usable_cache(cache_folder: ResultCache | None) -> ResultCache | None:
    """The cache, or None with a warning if its folder cannot be created: the study then runs uncached."""
    if cache_folder is None:
        return None
    try:
        cache_folder.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _LOG.warning(
            "%s: %s; results are not stored, --resume will not find them",
            cache_folder.folder,
            error,
        )
        return None
    return cache_folder


def _run_and_store(work: Callable[..., R], task: tuple[Any, ...], place: Path | None) -> R:
    """In the worker process: run the trial and store its result before returning it."""
    result = work(*task)
    if place is not None:
        try:
            content = object_file.dumps(result)
        except InputError as error:
            _LOG.warning("%s: the result is not stored: %s", work.__qualname__, error)
            return result
        with atomic_path(place) as part:
            part.write_bytes(content)
    return result


def _stored(place: Path | None) -> tuple[Any] | None:
    """The stored result; None if there is none or it cannot be read, so that the trial runs again."""
    if place is None or not place.is_file():
        return None
    try:
        return (object_file.loads(safe_input.data(place)),)
    except (UnreadableError, InputError):
        return None


def _result_path(
    cache_folder: ResultCache | None, work: Callable[..., Any], task: tuple[Any, ...]
) -> Path | None:
    if cache_folder is None:
        return None
    parts = "\n".join([code_hash(), _key(work), *map(_key, task)])
    return cache_folder.folder / f"{hashlib.sha256(parts.encode()).hexdigest()[:24]}.trial"


def _key(value: Any) -> str:
    """Key of a value: the qualified name of a function, otherwise the repr."""
    if callable(value):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


@cache
def code_hash() -> str:
    """Hash of all source files of the project."""
    root = Path(__file__).parents[3]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    for file in plugins.files():  # of the user's own planner or gaze policy
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()
