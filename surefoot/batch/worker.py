"""A worker: a process of its own that does one job at a time, and `Worker`, which starts it and notices its death.

A job that breaks the process (memory, a crash in compiled code) harms neither the batch nor a worker of a cluster. Jobs and
answers are lines of JSON. The memory of a worker is bounded by the system (RLIMIT_DATA: heap and private mappings).
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import queue
import resource
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from perception.primitives import safe_input

from ..run.memory import give_back
from .job import DIED, Answer, Job

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
MOST_KEPT = 0.5  # ours: share of its memory that a worker may hold between two jobs; else a new one takes over
GIB = 1 << 30
PROGRAM = ("-P", "-m", __name__)


class Worker:
    """A worker process.

    Args:
        memory_gib: Most memory, GiB.
    """

    def __init__(self, memory_gib: float) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the process)
        words = [sys.executable, *PROGRAM, repr(memory_gib)]
        usual = {**dict.fromkeys(ONE_THREAD, "1"), "NUMBA_THREADING_LAYER": "workqueue"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            words, stdin=pipe, stdout=pipe, stderr=self._said, env={**usual, **os.environ}
        )

    def fileno(self) -> int:
        """Readable when there is an answer."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def send(self, job: Job) -> None:
        """Give a job."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has died; `answer` says so
            self._process.stdin.write(job.line().encode() + b"\n")
            self._process.stdin.flush()

    def answer(self) -> Answer:
        """Wait for the end of the job, or of the process."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if line.endswith(b"\n"):
            found: Answer = safe_input.json(line)
        else:
            found = {"status": DIED, "reason": self._death(), "last": True}
        if found.get("last"):
            self.close()
        return found

    @property
    def ended(self) -> bool:
        """Whether it takes no more jobs."""
        return self._process.returncode is not None

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._said):
            with contextlib.suppress(BrokenPipeError):
                if stream is not None:
                    stream.close()

    def _death(self) -> str:
        """What ended the process, with the last line that it said."""
        code = self._process.wait()
        self._said.seek(max(0, self._said.seek(0, os.SEEK_END) - 4096))
        said = [line for line in self._said.read().decode(errors="replace").splitlines() if line]
        words = f"its worker ended with code {code}"
        if code < 0:
            words = f"its worker was killed by {signal.Signals(-code).name}"
        fatal = [line for line in said if line.startswith(("Fatal", "terminate"))] or said[-1:]
        return f"{words} ({fatal[0].strip()})" if fatal else words


def main(memory_gib: float) -> None:
    """The loop of the process: it ends when whoever started it closes its input, or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started it
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(waiting,), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    faulthandler.enable()
    most = int(memory_gib * GIB)
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    from .work import do  # takes seconds, and may need more memory than there is

    while True:
        answer = do(Job.read(waiting.get()))
        give_back()
        answer["last"] = answer["status"] == DIED or held_bytes() > MOST_KEPT * most
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _listen(waiting: queue.SimpleQueue[bytes]) -> None:
    for line in sys.stdin.buffer:
        waiting.put(line)
    os._exit(1)


def held_bytes() -> int:
    """Heap and private mappings of this process; 0 where that is not known."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    sizes = [int(line.split()[1]) for line in lines if line.startswith("VmData:")]
    return 1024 * sum(sizes)


_idle: dict[float, list[Worker]] = {}
"""Workers of this process that wait for a job, by their memory."""


def serve(line: str, memory_gib: float) -> Answer:
    """Do a job in a worker of this process, which any thread may use next."""
    idle = _idle.setdefault(memory_gib, [])
    worker = idle.pop() if idle else Worker(memory_gib)
    worker.send(Job.read(line))
    answer = worker.answer()
    if not worker.ended:
        idle.append(worker)
    return answer


if __name__ == "__main__":
    main(float(sys.argv[1]))
