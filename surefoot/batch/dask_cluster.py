"""The workers of a Dask cluster: Slurm, Kubernetes, several machines.

Each of its workers does a job in a process of its own (`worker.serve`), so that a job that breaks its process does not end the
worker. A worker that is lost costs what it had at hand, and so does the scheduler: the batch waits for its return and gives
the jobs again.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from typing import Any

from perception.primitives.errors import ConfigError, SurefootError

from ..progress import Say
from .job import AGAIN, LOST, Answer, Job
from .worker import serve

PATIENCE_S = 300.0  # how long the batch waits for a scheduler that is gone
CONNECT_S = 10.0
TICK_S = 1.0
AHEAD = 2  # jobs given for every thread of the cluster, so that none waits for the network


class DaskCluster:
    """The workers of a scheduler.

    Args:
        address: Of the scheduler.
        memory_gib: Most memory of the process that does a job, GiB.
        say: Progress.

    Raises:
        ConfigError: Dask is not installed, or no scheduler answers.
    """

    def __init__(self, address: str, memory_gib: float, say: Say) -> None:
        self._distributed = _library()
        self._address, self._memory_gib, self._say = address, memory_gib, say
        self._given: dict[str, tuple[Job, Any]] = {}
        self._ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._threads, self._counted_s = 1, 0.0
        try:
            self._client = self._connected()
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"no Dask scheduler answers at {address} ({str(error).splitlines()[0]}); expected an address such as "
                "tcp://10.0.0.5:8786"
            ) from error

    def room(self) -> bool:
        """Whether another job can be given now."""
        if time.monotonic() - self._counted_s > TICK_S:
            with contextlib.suppress(OSError, ValueError, AttributeError):  # `next` finds out why
                self._threads = sum(self._client.nthreads().values())
            self._counted_s = time.monotonic()
        return len(self._given) < AHEAD * max(1, self._threads)

    def submit(self, job: Job) -> None:
        """Give a job."""
        key = f"surefoot-{job.name}-{uuid.uuid4().hex}"
        ended = self._ended
        line = job.anywhere().line()
        future = self._client.submit(serve, line, self._memory_gib, key=key, pure=False)
        self._given[key] = (job, future)
        future.add_done_callback(lambda future: ended.put(future.key))

    def next(self) -> tuple[Job, Answer]:
        """Wait for the end of a job."""
        while True:
            try:
                key = self._ended.get(timeout=TICK_S)
            except queue.Empty:
                key = ""
            if self._client.status != "running":
                self._return()
            elif key in self._given:
                job, future = self._given[key]
                if future.status in ("finished", "error"):
                    del self._given[key]
                    return job, self._answer(future)
                self._return()  # cancelled: the scheduler forgot it

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        with contextlib.suppress(OSError, TimeoutError):
            self._client.close(timeout=2)

    def _answer(self, future: Any) -> Answer:
        if future.status == "finished":
            found: Answer = future.result()
            return found
        error = future.exception()
        lost = isinstance(error, self._distributed.KilledWorker)
        reason = "its workers were lost" if lost else f"{type(error).__name__}: {error}"
        return {"status": LOST if lost else AGAIN, "reason": reason.splitlines()[0]}

    def _connected(self) -> Any:
        return self._distributed.Client(self._address, timeout=CONNECT_S, set_as_default=False)

    def _return(self) -> None:
        """Wait for the scheduler, and give it again what had no end."""
        self._say(f"the scheduler at {self._address} is gone; waiting for it")
        jobs = [job for job, _ in self._given.values()]
        self._given, self._ended = {}, queue.SimpleQueue()
        self.close()
        until_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                self._client = self._connected()
                break
            except (OSError, ValueError) as error:
                if time.monotonic() > until_s:
                    raise SurefootError(
                        f"the scheduler at {self._address} did not come back within {PATIENCE_S:.0f} s; the same command "
                        "goes on"
                    ) from error
                time.sleep(TICK_S)
        for job in jobs:
            self.submit(job)


def _library() -> Any:
    """Dask's `distributed`, which logs only what is critical."""
    try:
        import dask

        dask.config.set({"logging": {"distributed": "critical"}})  # read when it is imported
        from dask import distributed
    except ImportError as error:
        raise ConfigError(
            f"--scheduler needs Dask, which is not installed ({error}); run `pip install 'surefoot[batch]'`, or leave out "
            "--scheduler"
        ) from error
    return distributed
