"""Numba's compiler with a cache that works in every installation. All kernels take `njit` from here.

Numba caches compiled code beside the sources or in the user's cache folder, and raises an error where neither is
writable: an installed package of a user without a home. Here a private folder in the temporary directory is the
last resort; if that fails too, nothing is cached.

Numba also checks a kernel's own file only. After an upgrade it would load machine code that contains the old version
of a function or constant of another file. Therefore each state of a package's kernels has its own cache folder.

Source: ours.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_numba: Any = numba.config  # has its attributes at run time only
_IMPORT = re.compile(rb"^from (\.*)([\w.]+) import", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit(**options)`; with `cache=True` the compiled code goes to `cache_folder`."""

    def decorate(function: Callable[..., Any]) -> Any:
        folder = (
            cache_folder(function.__module__.partition(".")[0]) if options.get("cache") else None
        )
        before = _numba.CACHE_DIR
        _numba.CACHE_DIR = str(folder or "")  # Numba reads it while it decorates, not later
        try:
            return numba.njit(**{**options, "cache": folder is not None})(function)
        finally:
            _numba.CACHE_DIR = before

    return decorate


@functools.cache
def cache_folder(package: str) -> Path | None:
    """Folder for the compiled kernels of a top-level package; None if no place is writable.

    The first writable of: NUMBA_CACHE_DIR (if set, instead of the next two), the package's __pycache__, the user's
    cache folder, a private folder in the temporary directory.
    """
    root = Path(str(sys.modules[package].__file__)).parent
    name = f"kernels-{_state(root)}"
    wanted = _numba.CACHE_DIR
    places = [Path(wanted)] if wanted else [root / "__pycache__", _user_cache()]
    for place in places:
        if place is not None and _writable(place / name):
            return place / name
    private = _private_temporary()
    return private / name if private is not None and _writable(private / name) else None


def _state(root: Path) -> str:
    """Hash of all kernels of a package and of the modules from which they import."""
    files = set(root.rglob("*_kernels.py"))
    for kernel in list(files):
        for dots, module in _IMPORT.findall(kernel.read_bytes()):
            base = kernel.parents[len(dots) - 1] if dots else root.parent
            files.add(base.joinpath(*module.decode().split(".")).with_suffix(".py"))
    state = hashlib.sha256()
    for path in sorted(files):
        if path.is_file():
            state.update(path.read_bytes())
    return state.hexdigest()[:12]


def _user_cache() -> Path | None:
    if sys.platform == "win32":
        place = os.environ.get("LOCALAPPDATA")
    else:
        place = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(place) / "surefoot" if place and os.path.isabs(place) else None


def _private_temporary() -> Path | None:
    """A folder that no other user can write: Numba unpickles and executes what it loads from its cache."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"surefoot-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(status.st_mode) and not status.st_mode & 0o022
    return folder if private and (sys.platform == "win32" or status.st_uid == user) else None


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
