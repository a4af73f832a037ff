"""Many damaged files through one door: what ended in anything but an error of the project, or took too long.

Run as a program it takes the doors one after the other, each in a process of its own:
`python tests/fuzz/campaign.py INPUTS [SEED [DOOR...]]`. What it finds is kept in runs/fuzz/ with the door's other files.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

from door import Door
from doors import DOORS
from mutate import mutated

from perception.primitives.errors import SurefootError

MOST_S = 10  # of processor time for one input
MOST_WALL_S = 60  # for one input, also where another process works for it
MOST_BYTES = 2 << 30  # of memory more than before
SLOW = 20  # a slow door gets this part of the inputs
KEPT = Path("runs") / "fuzz"


class Finding(NamedTuple):
    """An input that must not end so."""

    file: str
    content: bytes
    fault: str


class Found(NamedTuple):
    """What came of a campaign: faults, number of inputs that were refused, and the longest time, s."""

    findings: list[Finding]
    refused: int
    longest_s: float


class TooSlow(BaseException):
    """Raised by the alarm."""


class Files:
    """The files of a door, which are made good again after every input."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.good = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        self.names = sorted(self.good)
        self._times = {path: path.stat().st_mtime_ns for path in self.good}

    def restore(self) -> None:
        """Write again what has changed, and delete what is new."""
        for path in self.folder.rglob("*"):
            if path.is_file() and path not in self.good:
                path.unlink()
        for path, content in self.good.items():
            if not path.is_file() or path.stat().st_mtime_ns != self._times[path]:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                os.utime(path, ns=(self._times[path], self._times[path]))


def campaign(door: Door, inputs: int, seed: int, folder: Path) -> Found:
    """Put damaged files through a door.

    Args:
        door: The door.
        inputs: How many.
        seed: Of the changes.
        folder: Empty or absent, for its files.
    """
    rng = random.Random(seed)
    files = prepared(door, folder)
    findings, refused, longest = [], 0, 0.0
    for _ in range(inputs):
        path = rng.choice(files.names)
        bad = mutated(files.good[path], rng)
        began = time.process_time()
        fault = tried(door, files, path, bad)
        longest = max(longest, time.process_time() - began)
        refused += fault == ""
        if fault:
            findings.append(Finding(path.relative_to(folder).as_posix(), bad, fault))
    return Found(findings, refused, longest)


def prepared(door: Door, folder: Path) -> Files:
    """The files of a door, which can be read as they are."""
    folder.mkdir(exist_ok=True)
    door.make(folder)
    files = Files(folder)
    door.read(folder)
    files.restore()
    return files


def tried(door: Door, files: Files, path: Path, bad: bytes) -> str | None:
    """Whether a door reads a bad file (None), refuses it (empty), or does something else (what)."""
    path.write_bytes(bad)
    try:
        with limits():
            door.read(files.folder)
    except SurefootError:
        return ""
    except (Exception, TooSlow) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        words = str(error).splitlines()[0][:100] if str(error) else ""
        return f"{type(error).__name__}: {words} ({Path(place.filename).name}, line {place.lineno})"
    finally:
        files.restore()
    return None


@contextmanager
def limits() -> Iterator[None]:
    """Time and memory of one input."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = [signal.signal(number, _too_slow) for number in (signal.SIGALRM, signal.SIGPROF)]
    signal.alarm(MOST_WALL_S)
    signal.setitimer(signal.ITIMER_PROF, MOST_S)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, hard))
    try:
        yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        for number, handler in zip((signal.SIGALRM, signal.SIGPROF), before, strict=True):
            signal.signal(number, handler)


def _too_slow(*_: object) -> None:
    raise TooSlow(f"more than {MOST_S} s of work, or {MOST_WALL_S} s in all")


def in_process(work: Callable[[Path], int], name: str) -> int:
    """Do work in a process of its own, with a folder; a crash is told, and its last input kept."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "files"
        child = os.fork()
        if child == 0:
            try:
                os._exit(min(work(folder), 100))
            except BaseException:
                traceback.print_exc()
                os._exit(101)
        _, status = os.waitpid(child, 0)
        code = os.waitstatus_to_exitcode(status)
        if code < 0 or code == 101:
            kept = KEPT / f"{name}-crash"
            shutil.copytree(folder, kept, dirs_exist_ok=True)
            print(f"{name:<14} ended with {code}: {kept}", flush=True)
        return abs(code)


def keep(name: str, files: Files, findings: list[Finding]) -> None:
    """Keep the inputs that ended badly, with the other files of the door."""
    for number, one in enumerate(findings):
        kept = KEPT / f"{name}-{number}"
        shutil.copytree(files.folder, kept, dirs_exist_ok=True)
        (kept / one.file).write_bytes(one.content)
        print(f"  {kept}/{one.file}: {one.fault}", flush=True)


def quiet() -> None:
    """Send what decoders and NumPy complain about nowhere; our own errors still appear."""
    sys.stderr = os.fdopen(os.dup(2), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def main() -> None:
    """All doors, one line each."""
    quiet()
    inputs, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    names = sys.argv[3:] or list(DOORS)
    weights = {name: 1 / SLOW if DOORS[name].slow else 1.0 for name in names}
    wrong = 0
    for name in names:
        count = round(inputs * weights[name] / sum(weights.values()))

        def work(folder: Path, name: str = name, count: int = count) -> int:
            found = campaign(DOORS[name], count, seed, folder)
            keep(f"{name}-{seed}", Files(folder), found.findings)
            print(
                f"{name:<14} {count} inputs, {found.refused} refused, {len(found.findings)} faults, "
                f"longest {found.longest_s:.2f} s",
                flush=True,
            )
            return len(found.findings)

        wrong += in_process(work, f"{name}-{seed}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
