"""Kills runs at random moments, starts them again, and compares every file with the undisturbed run.

`python tests/kills/kills.py KILLS SEED [VERB...]`: half of the kills fall anywhere, half after the last frame, while the
run closes. Verbs that resume are resumed, the others repeated. Clocks stand still in the runs, so that files which
hold measured times can be compared too; of estimates.mcap the messages are, its chunks end where checkpoints were.

Every run is a process of its own, forked from this one, which has loaded everything; its descendants must end with it.
"""

# ruff: noqa: E402

from __future__ import annotations

import time

time.perf_counter = lambda: 0.0  # before anybody keeps it

import contextlib
import json
import os
import random
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from click.testing import CliRunner

import surefoot.cli.main as cli
from surefoot.batch import worker
from surefoot.batch.ledger import LEDGER
from surefoot.experiments.support import artefacts, resampling, trials
from surefoot.experiments.support import experiment as experiments
from surefoot.mcap_file import messages
from surefoot.recordings.codec import encode
from surefoot.recordings.mcap_format import RecordingWriter
from surefoot.recordings.open import open_recording
from surefoot.report import page
from surefoot.run import checkpoint, process, simulate

assert page, (process, simulate)
for _module in (artefacts, resampling, trials):
    _module.time = SimpleNamespace(monotonic=lambda: 0.0)
trials.WORKERS = 1
checkpoint.EVERY_S = 0.1
worker.PROGRAM = (__file__, "worker")  # with its clocks, too


def trial(seed: int) -> tuple[float, np.ndarray]:
    """A trial that takes its time."""
    time.sleep(0.3)
    drawn = np.random.default_rng(seed).normal(size=5)
    return float(drawn.mean()), drawn


def study(seeds: int, say: Callable[[str], None]) -> experiments.Outcome:
    """Figures of all trials."""
    found = trials.run_all(trial, [(seed,) for seed in range(seeds)], say, "trials")
    return experiments.Outcome({"mean": float(np.mean([mean for mean, _ in found]))})


TINY = experiments.Experiment("tiny", "Means", study, {"mean": experiments.Target("<", 9.0)}, seeds=8)  # fmt: skip
experiments.load = lambda identity: TINY

WALK = Path(__file__).resolve().parents[2] / "data" / "walk"
FRAMES = 4
LATEST_S = 10.0  # a descendant that lives longer than its parent by more is a fault


@dataclass(frozen=True)
class Verb:
    """What is killed.

    Args:
        words: Of the command line.
        again: Added when it is started again.
        closing: Pattern of a file that is there when the run begins to close.
        code: Exit code of the undisturbed command.
    """

    words: tuple[str, ...]
    again: tuple[str, ...]
    closing: str
    code: int = 0


VERBS = {
    "process": Verb(("process", "walk", "--out", "out"), ("--resume",), "out/.checkpoint-tables"),
    "simulate": Verb(
        ("simulate", "boxes", "--seed", "4", "--record", "--out", "out", "--set", "mission.time_limit_s=0.8"),
        (),
        "out/map.yaml",
        1,  # it ends before the goal
    ),
    "map": Verb(("map", "walk", "--out", "out"), (), "out/.part-*/*"),
    "experiment": Verb(("experiment", "tiny", "--out", "out"), ("--resume",), "out/.part-*/*"),
    "batch": Verb(("batch", "process", "walks", "--out", "out", "--workers", "1"), (), "out/.part-*/*/map.yaml"),
}  # fmt: skip


def short_walk(folder: Path, frames: int) -> None:
    """The first frames of the walk."""
    folder.mkdir(parents=True)
    walk = open_recording(WALK)
    with RecordingWriter(folder / "recording.mcap", walk.info) as writer:
        for number, frame in enumerate(walk.frames()):
            if number == frames:
                break
            writer.write(encode(frame))


def started(words: tuple[str, ...], place: Path) -> int:
    """Start a command in a place; returns its process, which leads a session of its own."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.setsid()
        os.chdir(place)
        said = CliRunner().invoke(cli.main, list(words))
        (place / "said").write_text(said.output)
        code = said.exit_code
    finally:
        os._exit(code)


def session(leader: int) -> list[int]:
    """Processes of a session."""
    found = []
    for entry in filter(str.isdigit, os.listdir("/proc")):
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == leader and fields[0] != "Z":
                found.append(int(entry))
    return found


def killed(child: int, ready: Callable[[], bool], after_s: float) -> bool:
    """Kill a process some time after something is ready; False if it ended before."""
    began = None
    while True:
        done, _ = os.waitpid(child, os.WNOHANG)
        if done:
            return False
        now = time.monotonic()
        if began is None and ready():
            began = now
        if began is not None and now - began >= after_s:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return True
        time.sleep(0.002)


def outlived(leader: int) -> list[int]:
    """Descendants of a killed process that live too long; they are ended."""
    until = time.monotonic() + LATEST_S
    while (left := session(leader)) and time.monotonic() < until:
        time.sleep(0.05)
    for one in left:
        with contextlib.suppress(ProcessLookupError):
            os.kill(one, signal.SIGKILL)
    return left


def contents(folder: Path) -> dict[str, object]:
    """Every file of a folder, byte by byte; of estimates.mcap the messages, of a ledger how often each run was made."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            name = path.relative_to(folder).as_posix()
            if path.name == "estimates.mcap":
                found[name] = [(topic, one.log_time, one.data) for topic, one in messages(path)]
            elif path.name == LEDGER:
                lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
                found[name] = sorted(one["job"] for one in lines if one["event"] == "done")
            else:
                found[name] = path.read_bytes()
    return found


def finished(words: tuple[str, ...], place: Path) -> tuple[int, str]:
    """Run a command to its end: exit code, and what it said."""
    (place / "said").unlink(missing_ok=True)
    _, status = os.waitpid(started(words, place), 0)
    said = (place / "said").read_text() if (place / "said").is_file() else ""
    return os.waitstatus_to_exitcode(status), said


def spans(verb: Verb, place: Path) -> tuple[float, float]:
    """How long a command takes, and how long of it to close, s; leaves its undisturbed result."""
    began = time.monotonic()
    child = started(verb.words, place)
    closing = None
    status = None
    while status is None:
        done, ended = os.waitpid(child, os.WNOHANG)
        status = ended if done else None
        if closing is None and any(place.glob(verb.closing)):
            closing = time.monotonic()
        time.sleep(0.002)
    said = (place / "said").read_text() if (place / "said").is_file() else "nothing"
    code = os.waitstatus_to_exitcode(status)
    assert code == verb.code, f"{shlex.join(verb.words)} ended with {code}: {said}"
    whole = time.monotonic() - began
    return whole, whole if closing is None else time.monotonic() - closing


def one_kill(verb: Verb, source: Path, whole: dict[str, object], closing: bool, after_s: float) -> str:  # fmt: skip
    """Kill once, start again; how it ended, in words: "same", "ended before", "refused: ...", or "FAULT: ..."."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for one in ("walk", "walks"):
            shutil.copytree(source / one, place / one)
        child = started(verb.words, place)
        ready = (lambda: any(place.glob(verb.closing))) if closing else (lambda: True)
        hit = killed(child, ready, after_s)
        if left := outlived(child):
            return f"FAULT: {len(left)} descendants outlived their parent"
        code, said = finished((*verb.words, *verb.again), place) if hit else (verb.code, "")
        if "unexpected" in said or "Traceback" in said or code < 0:
            return f"FAULT: {said.splitlines()[-1:]}"
        if code != verb.code:
            return f"refused: {said.splitlines()[-1]}"
        found = contents(place / "out")
        found.pop("recording.previous.mcap", None)  # of the killed walk, kept for the user
        wrong = sorted(n for n in {*found, *whole} if found.get(n) != whole.get(n))
        if wrong:
            kept = Path(tempfile.mkdtemp(prefix="killed-"))
            shutil.copytree(place / "out", kept, dirs_exist_ok=True)
            return f"FAULT: differs in {', '.join(wrong)} ({kept})"
        return "same" if hit else "ended before"


def kill(names: list[str], kills: int, seed: int, say: Callable[[str], object]) -> int:
    """Kill so often in all, the verbs in turn; returns the number of faults."""
    rng = random.Random(seed)
    counts: dict[tuple[str, str], int] = {}
    with tempfile.TemporaryDirectory() as name:
        sources = {}
        for verb in names:
            place = Path(name) / verb
            short_walk(place / "walk", FRAMES)
            for number in range(2):
                short_walk(place / "walks" / f"walk_{number}", 2 + number)
            times = spans(VERBS[verb], place)
            sources[verb] = (place, contents(place / "out"), times)
            say(f"{verb}: {len(sources[verb][1])} files, {times[0]:.1f} s, {times[1]:.1f} s of it to close")  # fmt: skip
        for number in range(kills):
            verb = names[number % len(names)]
            place, whole, times = sources[verb]
            closing = bool(number // len(names) % 2)
            after_s = rng.uniform(0.0, times[1] if closing else times[0])
            ended = one_kill(VERBS[verb], place, whole, closing, after_s)
            say(f"{verb} {'closing' if closing else 'anywhere'} +{after_s:.2f} s: {ended}")
            key = (verb, ended.partition(":")[0])
            counts[key] = counts.get(key, 0) + 1
    for (verb, ended), count in sorted(counts.items()):
        say(f"{verb:<12} {ended:<14} {count}")
    return sum(count for (_, ended), count in counts.items() if ended == "FAULT")


if __name__ == "__main__" and sys.argv[1] == "worker":
    worker.main(float(sys.argv[2]))
elif __name__ == "__main__":
    chosen = sys.argv[3:] or list(VERBS)
    sys.exit(bool(kill(chosen, int(sys.argv[1]), int(sys.argv[2]), lambda text: print(text, flush=True))))  # fmt: skip
