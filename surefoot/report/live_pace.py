"""How fast a walk goes on that pages watch: they pause it, let it make single steps, and slow it down. Ours."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

GONE_S = 2.0  # without a question for so long, no page is open
LOOK_S = 0.1  # a waiting walk looks so often whether it was stopped


class Pace:
    """Makes a walk wait between two frames, only while a page is open."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self.paused = False
        self.speed: float | None = (
            None  # most seconds of the walk in a second; None: as fast as it is computed
        )
        self._steps = self._asking = 0
        self._asked_s = self._released_s = -math.inf
        self._stamp_s = math.nan

    @contextmanager
    def page_asks(self) -> Iterator[None]:
        """While a page waits for news it is open."""
        with self._lock:
            self._asking += 1
        try:
            yield
        finally:
            with self._lock:
                self._asking -= 1
                self._asked_s = time.monotonic()

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return self._asking > 0 or time.monotonic() - self._asked_s < GONE_S

    def command(self, values: dict[str, Any]) -> None:
        """Take what a page says: any of `paused`, `step` and `speed`.

        Raises:
            ValueError: The speed is no positive number.
        """
        speed = self.speed
        if "speed" in values:
            speed = None if values["speed"] is None else float(values["speed"])
            if speed is not None and not (math.isfinite(speed) and speed > 0.0):
                raise ValueError(f"speed {speed} must be positive")
        with self._lock:
            self.speed = speed
            self.paused = bool(values.get("paused", self.paused))
            self._steps = self._steps + bool(values.get("step")) if self.paused else 0
        self._changed.set()

    def wait(self, stamp_s: float, stopped: Callable[[], bool]) -> None:
        """Return when the walk may go on after a moment.

        Args:
            stamp_s: Of the moment.
            stopped: Whether the walk was stopped otherwise.
        """
        while self.watched and not stopped():
            self._changed.clear()
            left_s = self._left(stamp_s - self._stamp_s)
            if not left_s > 0.0:
                break
            self._changed.wait(min(left_s, LOOK_S))
        self._stamp_s, self._released_s = stamp_s, time.monotonic()

    def _left(self, seconds: float) -> float:
        """Time to wait after a moment so many seconds of the walk after the one before it."""
        with self._lock:
            if self.paused and self._steps:
                self._steps -= 1
                return 0.0
            if self.paused:
                return math.inf
            if self.speed is None:
                return 0.0
            return self._released_s + seconds / self.speed - time.monotonic()
