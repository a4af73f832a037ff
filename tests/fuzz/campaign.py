"""Many damaged files through one door: what ended in anything but an error of the project, or took too long.

Run as a program it takes the doors one after the other: `python tests/fuzz/campaign.py INPUTS [SEED [DOOR...]]`. What it
finds is kept in runs/fuzz/ with the door's other files.
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
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

from doors import DOORS, Door
from mutate import mutated

from perception.primitives.errors import SurefootError

MOST_S = 10  # for one input
MOST_BYTES = 2 << 30  # of memory more than before
KEPT = Path("runs") / "fuzz"


class Finding(NamedTuple):
    """An input that must not end so."""

    file: str
    content: bytes
    fault: str


class TooSlow(BaseException):
    """Raised by the alarm."""


def campaign(door: Door, inputs: int, seed: int, folder: Path) -> tuple[list[Finding], int, float]:
    """Put damaged files through a door.

    Args:
        door: The door.
        inputs: How many.
        seed: Of the changes.
        folder: Empty, for its files.

    Returns:
        Findings, the number of inputs that were refused, and the longest time, s.
    """
    rng = random.Random(seed)
    door.make(folder)
    door.read(folder)  # good as they are
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    findings, refused, longest = [], 0, 0.0
    for _ in range(inputs):
        path = rng.choice(files)
        good = path.read_bytes()
        bad = mutated(good, rng)
        path.write_bytes(bad)
        began = time.perf_counter()
        try:
            with limits():
                door.read(folder)
        except SurefootError:
            refused += 1
        except (Exception, TooSlow) as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            words = f"{type(error).__name__}: {str(error)[:100]} ({Path(place.filename).name}, line {place.lineno})"
            findings.append(Finding(path.relative_to(folder).as_posix(), bad, words))
        finally:
            path.write_bytes(good)
        longest = max(longest, time.perf_counter() - began)
    return findings, refused, longest


@contextmanager
def limits() -> Iterator[None]:
    """Time and memory of one input."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGALRM, _too_slow)
    signal.alarm(MOST_S)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, hard))
    try:
        yield
    finally:
        signal.alarm(0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)


def _too_slow(*_: object) -> None:
    raise TooSlow(f"more than {MOST_S} s")


def main() -> None:
    """All doors, one line each."""
    sys.stderr = os.fdopen(os.dup(2), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # decoders write their complaints there
    inputs, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    names = sys.argv[3:] or list(DOORS)
    wrong = 0
    for name in names:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "files"
            folder.mkdir()
            found, refused, longest = campaign(DOORS[name], inputs // len(names), seed, folder)
            for number, one in enumerate(found):
                kept = KEPT / f"{name}-{seed}-{number}"
                shutil.copytree(folder, kept, dirs_exist_ok=True)
                (kept / one.file).write_bytes(one.content)
                print(f"  {kept}/{one.file}: {one.fault}")
        wrong += len(found)
        count = inputs // len(names)
        print(
            f"{name:<14} {count} inputs, {refused} refused, {len(found)} faults, longest {longest:.2f} s",
            flush=True,
        )
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
