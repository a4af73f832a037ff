"""One process at a time writes into a folder: an advisory lock on the folder itself, released with the process.

On file systems without locks nothing is checked.
"""

from __future__ import annotations

import fcntl
import os
import weakref
from pathlib import Path
from typing import Any

from perception.primitives.errors import OutputError

_held: dict[Path, tuple[int, int]] = {}  # of this process: open folder, number of holders


def hold(owner: Any, folder: Path) -> None:
    """Lock a folder until the owner is garbage; a process may hold the same folder several times.

    Args:
        owner: Object that writes into the folder.
        folder: It exists.

    Raises:
        OutputError: Another process writes into it.
    """
    place = folder.resolve()
    handle, holders = _held.get(place) or (os.open(place, os.O_RDONLY), 0)
    if not holders:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise OutputError(
                f"another process writes into {folder}; wait for it, or choose another --out"
            ) from None
        except OSError:
            pass  # no locks on this file system
    _held[place] = (handle, holders + 1)
    weakref.finalize(owner, _release, place)


def is_held(folder: Path) -> bool:
    """Whether a process, this one or another, writes into a folder."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # no such folder
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # no locks on this file system
        return False
    finally:
        os.close(handle)
    return False


def _release(place: Path) -> None:
    handle, holders = _held.pop(place)
    if holders > 1:
        _held[place] = (handle, holders - 1)
    else:
        os.close(handle)
