"""Where the time of one cycle goes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """Time of each stage of one cycle, ms."""

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        """Begin.

        Args:
            clock: Seconds; `time.thread_time` where others share the machine.
        """
        self._clock = clock
        self.milliseconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to a stage."""
        start = self._clock()
        yield
        spent = 1e3 * (self._clock() - start)
        self.milliseconds[name] = self.milliseconds.get(name, 0.0) + spent
