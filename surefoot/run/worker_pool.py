"""Worker processes that take one task at a time.

A worker that dies is replaced and its task given to another, which the pools of the standard library do not do:
they give up all tasks.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple


class Done(NamedTuple):
    """A finished task.

    Args:
        task: Its number.
        result: What the function returned; None if its workers died.
        died: Whether the task was given up because its workers died.
    """

    task: int
    result: Any
    died: bool = False


class _Worker:
    """One process and the task that it has."""

    def __init__(self, function: Callable[..., Any]) -> None:
        context = multiprocessing.get_context("spawn")  # forked compiled code with threads can hang
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(
            target=_serve, args=(theirs, function), daemon=True
        )
        self.process.start()
        theirs.close()
        self.task: int | None = None


def run_all(
    function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], workers: int, deaths: int
) -> Iterator[Done]:
    """Run a function on many tasks, side by side.

    Args:
        function: A function of a module, with arguments and a result that processes can exchange.
        tasks: Arguments of each call.
        workers: Number of processes.
        deaths: How many workers a task may kill before it is given up.

    Yields:
        The tasks as they finish.
    """
    waiting, killed = deque(range(len(tasks))), [0] * len(tasks)
    pool = [_Worker(function) for _ in range(min(workers, len(tasks)))]
    try:
        left = len(tasks)
        while left:
            for worker in pool:
                if worker.task is None and waiting:
                    worker.task = waiting.popleft()
                    worker.connection.send(tasks[worker.task])
            busy = {worker.connection: worker for worker in pool if worker.task is not None}
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                worker = busy[connection]
                task = worker.task
                assert task is not None
                worker.task = None
                try:
                    done = Done(task, connection.recv())
                except (EOFError, OSError):
                    pool[pool.index(worker)] = _Worker(function)
                    killed[task] += 1
                    if killed[task] < deaths:
                        waiting.append(task)
                        continue
                    done = Done(task, None, died=True)
                left -= 1
                yield done
    finally:
        for worker in pool:
            worker.process.terminate()
        for worker in pool:
            worker.process.join()


def end_with_parent() -> None:
    """In a worker: end this process soon after its parent has died, by whatever signal."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait_for_the_end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_the_end, daemon=True).start()


def _serve(connection: Connection, function: Callable[..., Any]) -> None:
    """The loop of a worker; the parent alone handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    while True:
        connection.send(function(*connection.recv()))
