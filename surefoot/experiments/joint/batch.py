"""Many recordings on a cluster that keeps breaking.

The simulated walk that ships in the package is cut into short recordings, as many as there are seeds; two in a hundred are
damaged (of fewer than 250 every fifth part), in five ways in turn. `surefoot batch process` processes them on a Dask cluster of two workers on this machine. A worker is killed every
minute and started again, as Slurm or Kubernetes would; the scheduler is killed once, after half of the runs, and the batch
itself once, after a quarter, and the same command is given again.

Counted: good recordings that were done exactly once by the ledger, damaged ones that are named with a reason, and in a sample
files that differ from a single run of `surefoot process`; files of measured times are left out, and the name of the folder
in the command. `rate_ratio`: recordings a minute, by those of two plain processes that take one recording after another,
measured before and after; every kill and return is included in the time of the batch.

Source: ours.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives.errors import SurefootError

from ...batch.ledger import LEDGER
from ...progress import Say
from ...recordings.codec import encode
from ...recordings.mcap_format import RecordingWriter
from ...recordings.open import open_recording
from ..support.experiment import Experiment, Outcome, Target

FRAMES = 4  # of a recording
DAMAGED_SHARE = 0.02
WORKERS = 2
SAMPLE = 8  # recordings processed singly and compared
PLAIN_SHARE = 0.02  # of the recordings that two plain processes take, before and again after
LOOK_EVERY_S = 0.5
TIMES = (
    "timing.csv",
    "metrics.json",
    "report.html",
    "replay.html",
    "estimates.mcap",
    "figures/timing.svg",
    "tables/",
)
"""Files that hold measured times."""
TARGETS = {
    "done_once_share": Target("==", 1.0),
    "done_twice": Target("==", 0.0),
    "damaged_not_named": Target("==", 0.0),
    "damaged_done": Target("==", 0.0),
    "differing_files": Target("==", 0.0),
    "rate_ratio": Target(">=", 0.9),
}
PLAIN = """
import sys
from pathlib import Path
from surefoot.config.load import load, own_settings
from surefoot.progress import silent
from surefoot.run.process import process

for place in map(Path, sys.argv[2:]):
    process(place, None, load(own_settings(place)), Path(sys.argv[1]) / place.name, silent)
"""
SUREFOOT = "from surefoot.cli.main import main; main()"


def empty(content: bytes) -> bytes:
    """A file of no bytes."""
    return b""


def other(content: bytes) -> bytes:
    """Content of another kind."""
    return b"\x7fELF" + bytes(len(content) // 2)


def cut(content: bytes) -> bytes:
    """Cut off within its first message."""
    return content[:200]


def scratched(content: bytes) -> bytes:
    """Every tenth byte is another, but for the first ones, by which the format is known."""
    changed = np.frombuffer(content, np.uint8).copy()
    changed[64::10] ^= 0xFF
    return changed.tobytes()


def zeroed(content: bytes) -> bytes:
    """Zeros from early on, as a disk leaves them that lost power."""
    return content[:64] + bytes(len(content) - 64)


WAYS: tuple[Callable[[bytes], bytes], ...] = (empty, other, cut, scratched, zeroed)


def write_recordings(folder: Path, count: int, say: Say) -> list[str]:
    """Short recordings of the simulated walk; returns the names of the damaged ones."""
    every = min(round(1 / DAMAGED_SHARE), max(2, count // len(WAYS)))
    damaged: list[str] = []
    with resources.as_file(resources.files("surefoot") / "quickstart") as walk:
        recording = open_recording(walk)
        frames = [encode(frame) for frame in recording.frames()]
    for number in range(count):
        first = number % (len(frames) - FRAMES)
        place = folder / "in" / f"walk-{number:05d}"
        place.mkdir(parents=True)
        file = place / "recording.mcap"
        with RecordingWriter(file, recording.info) as writer:
            for frame in frames[first : first + FRAMES]:
                writer.write(frame)
        if number % every == every - 1:
            way = WAYS[len(damaged) % len(WAYS)]
            file.write_bytes(way(file.read_bytes()))
            damaged.append(place.name)
        say(f"{number + 1} of {count} recordings written")
    return damaged


class Cluster:
    """A Dask scheduler and its workers, each started again when it has died."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        self._log = (folder / "cluster.log").open("ab")
        self.here: dict[str, Any] = {"stdout": self._log, "stderr": self._log, "cwd": folder}
        self.scheduler = self._scheduler()
        self.workers = [self._worker() for _ in range(WORKERS)]

    def _scheduler(self) -> subprocess.Popen[bytes]:
        port = self.address.rpartition(":")[2]
        words = ["scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
        return subprocess.Popen([sys.executable, "-m", "dask", *words], **self.here)

    def _worker(self) -> subprocess.Popen[bytes]:
        words = ["worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        return subprocess.Popen([sys.executable, "-m", "dask", *words], **self.here)

    def tend(self) -> None:
        """Start again what has died."""
        if self.scheduler.poll() is not None:
            self.scheduler = self._scheduler()
        self.workers = [one if one.poll() is None else self._worker() for one in self.workers]

    def close(self) -> None:
        """End everything."""
        for one in [*self.workers, self.scheduler]:
            one.kill()
            one.wait()
        self._log.close()


def broken_batch(folder: Path, count: int, kill_every_s: float, say: Say) -> dict[str, float]:
    """Run the batch while workers, scheduler and batch are killed; how often, and how long it took."""
    rng = np.random.default_rng(0)
    cluster = Cluster(folder)
    words = ["batch", "process", str(folder / "in"), "--out", str(folder / "out")]
    words += ["--scheduler", cluster.address]
    killed = Counter({"workers": 0, "schedulers": 0, "batches": 0})
    began_s = killed_s = time.monotonic()
    batch = None
    try:
        while True:
            cluster.tend()
            if batch is None:
                batch = subprocess.Popen([sys.executable, "-c", SUREFOOT, *words], **cluster.here)
            code = batch.poll()
            if code is not None and code not in (0, 1):
                raise SurefootError(f"the batch ended with {code}; see {folder / 'cluster.log'}")
            if code is not None:
                break
            done = len(ends(folder / "out" / LEDGER)["done"])
            if not killed["batches"] and done >= count / 4:
                batch.send_signal(signal.SIGKILL)
                batch.wait()
                batch, killed["batches"] = None, 1
            elif not killed["schedulers"] and done >= count / 2:
                cluster.scheduler.kill()
                killed["schedulers"] = 1
            elif time.monotonic() - killed_s > kill_every_s:
                cluster.workers[int(rng.integers(WORKERS))].kill()
                killed["workers"] += 1
                killed_s = time.monotonic()
            say(f"{done} of {count} recordings, {killed['workers']} workers killed")
            time.sleep(LOOK_EVERY_S)
    finally:
        if batch is not None and batch.poll() is None:
            batch.kill()
        cluster.close()
    figures = {f"{name}_killed": float(times) for name, times in killed.items()}
    return {**figures, "batch_s": time.monotonic() - began_s}


def ends(ledger: Path) -> dict[str, Counter[str]]:
    """How often each recording was done, and how often it failed or was put in quarantine, by the ledger."""
    found: dict[str, Counter[str]] = {"done": Counter(), "failed": Counter(), "quarantined": Counter()}  # fmt: skip
    lines = ledger.read_bytes().splitlines(keepends=True)[1:] if ledger.is_file() else []
    for line in lines:
        one = json.loads(line) if line.endswith(b"\n") else {}
        if one.get("event") in found and (one["event"] == "done" or one.get("reason")):
            found[one["event"]][one["job"]] += 1
    return found


def plain_rate(folder: Path, places: Sequence[Path], name: str) -> float:
    """Recordings a minute of two plain processes."""
    shares = [places[k::WORKERS] for k in range(WORKERS)]
    began_s = time.monotonic()
    running = [
        subprocess.Popen(
            [sys.executable, "-c", PLAIN, str(folder / name / str(k)), *map(str, share)]
        )
        for k, share in enumerate(shares)
    ]
    codes = [one.wait() for one in running]
    if any(codes):
        raise SurefootError("a plain process failed; see above")
    return 60.0 * len(places) / (time.monotonic() - began_s)


def differing(one: Path, other: Path) -> list[str]:
    """Names of the files of two runs that differ, but for measured times and the name of the folder."""
    names = {
        file.relative_to(run).as_posix()
        for run in (one, other)
        for file in run.rglob("*")
        if file.is_file()
    }

    def content(run: Path, name: str) -> bytes | None:
        found = run / name
        return found.read_bytes().replace(str(run).encode(), b"RUN") if found.is_file() else None

    kept = sorted(name for name in names if not name.startswith(TIMES))
    return [name for name in kept if content(one, name) != content(other, name)]


def run(seeds: int, say: Say, kill_every_s: float = 60.0) -> Outcome:
    """As many recordings as seeds, with a worker killed so often."""
    folder = Path(tempfile.mkdtemp(prefix="batch-study-", dir=os.environ.get("TMPDIR")))
    damaged = write_recordings(folder, seeds, say)
    places = sorted((folder / "in").iterdir())
    good = [place for place in places if place.name not in damaged]
    sample = good[:: max(1, len(good) // SAMPLE)][:SAMPLE]
    plain = good[: max(2 * WORKERS, round(PLAIN_SHARE * seeds))]
    rates = [plain_rate(folder, plain, "before")]
    figures = broken_batch(folder, seeds, kill_every_s, say)
    rates.append(plain_rate(folder, plain, "after"))
    rate = 60.0 * seeds / figures.pop("batch_s")
    found = ends(folder / "out" / LEDGER)
    plain_rate(folder, sample, "single")
    wrong = {
        name
        for k in range(WORKERS)
        for place in sample[k::WORKERS]
        for name in differing(folder / "out" / place.name, folder / "single" / str(k) / place.name)
    }
    figures |= {
        "recordings": float(seeds),
        "done_once_share": sum(found["done"][place.name] == 1 for place in good) / len(good),
        "done_twice": float(sum(times > 1 for times in found["done"].values())),
        "good_without_run": float(sum(not found["done"][place.name] for place in good)),
        "damaged": float(len(damaged)),
        "damaged_not_named": float(sum(not found["failed"][name] for name in damaged)),
        "damaged_done": float(sum(found["done"][name] for name in damaged)),
        "differing_files": float(len(wrong)),
        "plain_per_minute": float(np.mean(rates)),
        "rate_ratio": rate / float(np.mean(rates)),
    }
    table = [f"{name:<20} {value:.4g}" for name, value in figures.items()]
    table += [f"differs: {name}" for name in sorted(wrong)]
    if all(target.met_by(figures[name]) for name, target in TARGETS.items()):
        shutil.rmtree(folder, ignore_errors=True)
    else:
        table.append(f"everything is kept in {folder}")
    return Outcome(figures, table)


EXPERIMENT = Experiment(
    id="batch",
    title="Thousands of recordings on a cluster whose workers, scheduler and client are killed",
    run=run,
    targets=TARGETS,
    seeds=2000,
)
