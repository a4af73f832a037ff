"""Memory of this process, as Linux counts it."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
from pathlib import Path


def memory_mb() -> float:
    """Resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def give_back() -> None:
    """Return what was freed to the system: glibc keeps hundreds of MB of a run, between pieces that are still in use."""
    gc.collect()
    with contextlib.suppress(AttributeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)
