"""One process at a time writes into a run folder: an advisory lock on its mark, released with the process.

On file systems without locks nothing is checked.
"""

from __future__ import annotations

import fcntl
import weakref
from pathlib import Path
from typing import IO, Any

from perception.primitives.errors import OutputError

_held: dict[Path, tuple[IO[bytes], int]] = {}  # of this process: file, number of holders


def hold(owner: Any, mark: Path) -> None:
    """Lock a folder until the owner is garbage; a process may hold the same folder several times.

    Args:
        owner: Object that writes into the folder.
        mark: File in the folder; it exists.

    Raises:
        OutputError: Another process writes into it.
    """
    place = mark.resolve()
    file, holders = _held.get(place) or (place.open("ab"), 0)
    if not holders:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise OutputError(
                f"another process writes into {mark.parent}; wait for it, or choose another --out"
            ) from None
        except OSError:
            pass  # no locks on this file system
    _held[place] = (file, holders + 1)
    weakref.finalize(owner, _release, place)


def is_held(mark: Path) -> bool:
    """Whether a process, this one or another, writes into the folder of a mark."""
    try:
        with mark.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # no such folder, or no locks on this file system
        return False
    return False


def _release(place: Path) -> None:
    file, holders = _held.pop(place)
    if holders > 1:
        _held[place] = (file, holders - 1)
    else:
        file.close()
