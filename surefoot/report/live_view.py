"""The live page: the replay page of a run that still goes on, in the browser.

It shows moments and nothing else, so live, run folder and replay agree. A walk that is shown gives the same results:
pages can only make it wait between two frames (`live_pace`). Ours.
"""

from __future__ import annotations

import atexit
import json
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterable

from perception.primitives.errors import InputError, SurefootError

from ..results import run_lock
from ..results.moment import Moment
from ..results.moments import ESTIMATES, held, moments_of
from ..results.run_folder import RunFolder
from .live_pace import Pace
from .live_server import LiveServer
from .replay.entry import Entries
from .replay.page import live_page

EVERY_S = 0.1  # a page gets news at most so often
PATIENCE_S = 1.0  # a page is answered after this even without news, and asks again
MOST_BYTES = 4_000_000  # of one answer
LOOK_S = 0.25  # a file that grows is read so often


class LivePage:
    """A page in the browser that shows a run while it goes on, and afterwards.

    The moments are prepared for the page in a thread of its own, which the run does not wait for.
    """

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._entries: list[bytes] = []
        self._walk: queue.SimpleQueue[Moment | None] | None = None
        self._id = secrets.token_hex(8)
        self._run: RunFolder | None = None
        self._over, self._error = False, ""
        self._closed, self._preparing = threading.Event(), threading.Thread()
        self._pace = Pace()
        self._server = LiveServer(live_page(), self._answer, self._pace.command)
        self.address = self._server.address
        threading.Thread(target=self._server.serve_forever, args=(LOOK_S,), daemon=True).start()
        atexit.register(
            self.close
        )  # a thread that encodes a picture while Python ends aborts the process

    def watch(self, run: RunFolder) -> None:
        """Show a walk; its moments come by `show`, its end by `finish`."""
        self._walk = queue.SimpleQueue()
        self._begin(run, iter(self._walk.get, None))

    def follow(self, run: RunFolder) -> None:
        """Show the moments in a run folder, and those that are added while another process writes into it.

        Raises:
            InputError: The run has no moments.
        """
        path = run.path(ESTIMATES)
        if not path.is_file():
            raise InputError(
                f"{run.root} holds no {ESTIMATES}: it is the folder of a batch, or of an older version; make the run again"
            )

        def grows() -> bool:
            time.sleep(LOOK_S)
            return not self._closed.is_set() and run_lock.is_held(run.root)

        self._begin(run, moments_of(path, grows))

    def show(self, moment: Moment, stopped: Callable[[], bool]) -> None:
        """Show a moment of the walk; returns when the walk may go on.

        Args:
            moment: The newest.
            stopped: Whether the walk was stopped by Ctrl-C.
        """
        assert self._walk is not None
        self._walk.put(moment)
        self._pace.wait(moment.stamp_s, stopped)

    def finish(self) -> None:
        """The walk is over; the page goes on to show all of it."""
        assert self._walk is not None
        self._walk.put(None)

    def stay(self) -> None:
        """Serve the page until Ctrl-C."""
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            pass

    def close(self) -> None:
        """Stop preparing and serving."""
        atexit.unregister(self.close)
        self._closed.set()
        if self._walk is not None:
            self._walk.put(None)
        if self._preparing.is_alive():
            self._preparing.join()
        self._server.shutdown()
        self._server.server_close()

    def _begin(self, run: RunFolder, moments: Iterable[Moment]) -> None:
        self._run = run
        self._preparing = threading.Thread(target=self._prepare, args=(run, moments), daemon=True)
        self._preparing.start()

    def _prepare(self, run: RunFolder, moments: Iterable[Moment]) -> None:
        """Make the entries of the page as the moments come."""
        entries = Entries(run)
        try:
            for moment in held(moments):
                if self._closed.is_set():
                    break
                text = json.dumps(entries.of(moment), separators=(",", ":"), allow_nan=False)
                with self._news:
                    self._entries.append(text.encode())
                    self._news.notify_all()
        except SurefootError as error:
            self._error = str(error)
        except Exception as error:  # a bug: the page says so instead of waiting for ever
            self._error = f"unexpected {type(error).__name__}: {error}"
        with self._news:
            self._over = True
            self._news.notify_all()

    def _answer(self, number: int) -> bytes:
        """State of the run and its moments from a number on."""
        with self._pace.page_asks():
            time.sleep(EVERY_S)
            with self._news:
                over = number > 0 and self._over
                self._news.wait_for(
                    lambda: len(self._entries) > number or self._over != over, PATIENCE_S
                )
                chosen, size = [], 0
                for one in self._entries[number:]:
                    chosen.append(one)
                    size += len(one)
                    if size > MOST_BYTES:
                        break
                over = self._over and number + len(chosen) == len(self._entries)
        root = None if self._run is None else self._run.root
        state = {
            "run": self._id,
            "name": "Surefoot" if root is None else root.resolve().name,
            "report": "" if root is None else str(root / "report.html"),
            "walks": self._walk is not None,
            "paused": self._pace.paused,
            "speed": self._pace.speed,
            "over": over,
            "error": self._error,
        }
        return b'{"state":%s,"moments":[%s]}' % (json.dumps(state).encode(), b",".join(chosen))
