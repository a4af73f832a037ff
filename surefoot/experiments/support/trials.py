"""Many independent trials: on all cores, in order, and each kept as soon as it is done.

A study of two hours that is killed goes on with `--resume`: what was done by the very same code, of the same
trial, is not done again.

Source: ours.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from mapping.io.atomic_write import atomic_path
from perception.primitives import plugins

WORKERS = os.cpu_count() or 2
PACKAGES = ("perception", "mapping", "planning", "sim", "surefoot")

R = TypeVar("R")
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Shelf:
    """Where results are put.

    Args:
        folder: Made if it is not there.
        resume: Whether what lies there already is taken.
    """

    folder: Path
    resume: bool


_SHELF: ContextVar[Shelf | None] = ContextVar("shelf", default=None)


@contextmanager
def kept(shelf: Shelf | None) -> Iterator[None]:
    """All trials made inside are put on this shelf."""
    token = _SHELF.set(shelf)
    try:
        yield
    finally:
        _SHELF.reset(token)


def each(work: Callable[..., R], todo: Sequence[tuple[Any, ...]]) -> Iterator[R]:
    """`work(*task)` of every task, in order, each in a process of its own.

    Args:
        work: A function of a module; what it returns can be pickled.
        todo: Its arguments, whose repr tells them apart.
    """
    shelf = _usable(_SHELF.get())
    places = [_place(shelf, work, task) for task in todo]
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        waiting: list[Any] = []
        for task, place in zip(todo, places, strict=True):
            done = _taken(place) if shelf is not None and shelf.resume else None
            waiting.append(done if done is not None else pool.submit(_do, work, task, place))
        try:
            for one in waiting:
                yield one[0] if isinstance(one, tuple) else one.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _usable(shelf: Shelf | None) -> Shelf | None:
    """The shelf, if its folder can be made: a study is not given up because it cannot be put aside."""
    if shelf is None:
        return None
    try:
        shelf.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _LOG.warning(
            "%s: %s; results are not kept, --resume will not find them", shelf.folder, error
        )
        return None
    return shelf


def _do(work: Callable[..., R], task: tuple[Any, ...], place: Path | None) -> R:
    """In the worker: make the trial, and keep it before anybody is told."""
    result = work(*task)
    if place is not None:
        with atomic_path(place) as part:
            part.write_bytes(pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL))
    return result


def _taken(place: Path | None) -> tuple[Any] | None:
    """What was kept there; None if nothing was, or it cannot be read: then the trial is made again."""
    if place is None or not place.is_file():
        return None
    try:
        return (pickle.loads(place.read_bytes()),)
    except Exception:  # a damaged pickle can raise anything
        return None


def _place(shelf: Shelf | None, work: Callable[..., Any], task: tuple[Any, ...]) -> Path | None:
    if shelf is None:
        return None
    words = "\n".join([_code(), _spelt(work), *map(_spelt, task)])
    return shelf.folder / f"{hashlib.sha256(words.encode()).hexdigest()[:24]}.pickle"


def _spelt(value: Any) -> str:
    """A function by its name, anything else by its repr."""
    if callable(value):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


@cache
def _code() -> str:
    """Fingerprint of all our sources: results of other code are other results."""
    root = Path(__file__).parents[3]
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    for file in plugins.files():  # of the user's own planner or gaze policy
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()
