"""Worker processes on this machine."""

from __future__ import annotations

import select
from pathlib import Path

from perception.primitives.errors import InputError

from .. import cores
from .job import Answer, Job
from .worker import GIB, Worker


def how_many(wanted: int | None, memory_gib: float) -> int:
    """Number of workers: as asked for, else one per core, as far as the free memory of the machine allows.

    Raises:
        InputError: There is not enough memory for those asked for, or for a single one.
    """
    fit = int(free_gib() / memory_gib)
    workers = min(cores.available(), fit) if wanted is None else wanted
    if workers < 1 or workers > fit:
        raise InputError(
            f"{max(workers, 1)} workers of {memory_gib:g} GiB each do not fit into the {free_gib():.1f} GiB of memory that are "
            "free; give a smaller --memory, or fewer --workers"
        )
    return workers


def free_gib() -> float:
    """Memory that this machine has free, GiB."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return float("inf")
    sizes = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    return 1024 * sizes[0] / GIB if sizes else float("inf")


class Pool:
    """Some workers; they start when there is something to do, and one that died is replaced.

    Args:
        workers: How many.
        memory_gib: Most memory of each, GiB.
    """

    def __init__(self, workers: int, memory_gib: float) -> None:
        self._workers, self._memory_gib = workers, memory_gib
        self._idle: list[Worker] = []
        self._busy: dict[Worker, Job] = {}

    def room(self) -> bool:
        """Whether a worker has nothing to do."""
        return len(self._busy) < self._workers

    def submit(self, job: Job) -> None:
        """Give a job to a worker that has nothing to do."""
        worker = self._idle.pop() if self._idle else Worker(self._memory_gib)
        worker.send(job)
        self._busy[worker] = job

    def next(self) -> tuple[Job, Answer]:
        """Wait for the end of a job."""
        worker: Worker = select.select(list(self._busy), [], [])[0][0]
        answer, job = worker.answer(), self._busy.pop(worker)
        if not worker.ended:
            self._idle.append(worker)
        return job, answer

    def close(self) -> None:
        """End all workers."""
        for worker in [*self._idle, *self._busy]:
            worker.close()
