"""Processor cores that this process may use."""

from __future__ import annotations

import os


def available() -> int:
    """Number of cores by the CPU affinity of this process; of all where the system has no affinity."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
