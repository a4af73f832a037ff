"""Bugs planted in the numerical core, one at a time: how many do the tests notice?

    python tests/mutants/run_mutants.py MUTANTS SEED [PATH...]    # bugs drawn from all of the core, or from these paths
    python tests/mutants/run_mutants.py --again TABLE             # those that survived in a table

All happens in a copy of the tree, build/mutants/tree. The tests that can notice a bug (`nearby.tests_of`) run with it,
the nearest first, until one fails; that one must pass without the bug. A file of tests may take a minute of processor
time: one that takes longer with the bug only has noticed it. After a minute no further file begins, and the bug
has survived. The nearest tests of a kernel first run it without compilation, which takes less time than compiling; then
what the bug can reach is compiled anew, and all other kernels come from the cache. The bugs, their fate, and the
test that noticed them are in build/mutants/seed-SEED.csv.

A bug that changes no result is no bug: `equivalent.toml` lists those, with the reason, and they are not counted.

The core is perception, mapping and planning without planners and file formats, which simulation and `make fuzz` judge.

Source: DeMillo, Lipton, Sayward 1978; Wilson 1927 (interval of a share).
"""

from __future__ import annotations

import csv
import hashlib
import math
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2]))

from changes import Change, changed, changes
from nearby import distances, tests_of

from perception.primitives.compiled import _state as kernel_state

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "build" / "mutants"
PACKAGES = ("perception", "mapping", "planning")
BESIDE = ("mapping/io/", "planning/planners/")  # no numerical core
ELSEWHERE = ("build", "runs", "dist", "__pycache__", "*.egg-info", ".*")
MOST_S = 60  # processor time of a test file, and after which no further one begins
INTERPRETED = 2  # so many files of tests run without compilation first
INTERPRETED_S = 15  # processor time of each of these
MOST_BYTES = 12 << 30  # address space of a test run
FAILED = re.compile(
    r"^FAILED (\S+?(?:\[.*?\])?)(?: - |$)", re.MULTILINE
)  # a line of pytest's summary
COLUMNS = ("verdict", "file", *Change._fields, "seconds", "test")
Bug = tuple[str, Change]
"""File, relative to the tree, and the change."""


class Tried(NamedTuple):
    """A bug after the tests: "killed", "survived" or "equivalent"; processor time, s; the test that failed."""

    bug: Bug
    verdict: str
    seconds: float = 0.0
    test: str = ""


class Tree:
    """A copy of the project in which bugs are planted.

    Args:
        source: The project; its compiled kernels are taken over.
        place: Folder of the copy and of its compiled kernels.
    """

    def __init__(self, source: Path, place: Path) -> None:
        self.root = place / "tree"
        self._good, self._bad = place / "kernels", place / "kernels-with-bug"
        shutil.rmtree(self.root, ignore_errors=True)
        shutil.copytree(source, self.root, ignore=shutil.ignore_patterns(*ELSEWHERE))
        self._states = {package: kernel_state(self.root / package) for package in PACKAGES}
        for package, state in self._states.items():
            names = {
                _folder(old): _folder(self.root / old.relative_to(source))
                for old in _folders(source / package)
            }
            for path in (source / package / "__pycache__" / f"kernels-{state}").rglob("*.nb[ic]"):
                if path.parent.name in names:
                    _copy(path, self._good / f"kernels-{state}" / names[path.parent.name])
        self._passed: dict[tuple[str, bool], bool] = {}
        self._seconds: dict[Path, float] = {}

    def tried(self, bug: Bug) -> Tried:
        """Run the tests, the nearest first, until one notices the bug.

        Raises:
            RuntimeError: That test fails without the bug, too.
        """
        file, change = bug
        module, spent = self.root / file, 0.0
        compiled = self._compiled_from(module)
        shutil.rmtree(self._bad, ignore_errors=True)
        tests = tests_of(self.root, module)
        runs = [
            test for _, test in sorted(tests, key=lambda t: (t[0], self._seconds.get(t[1], 0.0)))
        ]
        modes = [(test, True) for test in runs]
        if compiled:
            modes = [(test, False) for test in runs[:INTERPRETED]] + modes
        for test, compile_ in modes:
            with self._planted(module, change):
                cache = self._cache_without(compiled) if compiled and compile_ else self._good
                status, seconds, words = self._run(str(test), cache, compile_, "-x")
            spent += seconds
            if compile_:
                self._seconds[test] = max(seconds, self._seconds.get(test, 0.0))
            elif "IndexError" in words or status < 0:  # compiled code may live with it
                continue
            failed = FAILED.findall(words)
            where = failed[0] if failed else str(test.relative_to(self.root))
            if status and self._passes_without_bug(where, status, compile_):
                return Tried(bug, "killed", spent, where if failed else f"{where}: status {status}")
            if spent > MOST_S:
                break
        return Tried(bug, "survived", spent)

    def _passes_without_bug(self, where: str, status: int, compile_: bool) -> bool:
        """Whether a test, or a file that ended with a status, passes; no if it takes too long in any case."""
        if (where, compile_) not in self._passed:
            options = ("--collect-only",) if status == 2 else ()
            status, _, words = self._run(where, self._good, compile_, *options)
            if status > 0 and compile_:
                raise RuntimeError(f"{words[-3000:]}\nthe tests must pass before bugs are planted")
            self._passed[where, compile_] = status == 0
        return self._passed[where, compile_]

    def _compiled_from(self, module: Path) -> set[Path]:
        """The modules whose compiled code a module can change."""
        modules = [path for package in PACKAGES for path in (self.root / package).rglob("*.py")]
        return {
            path
            for path in modules
            if "njit" in path.read_text() and module in distances(self.root, path)
        }

    @contextmanager
    def _planted(self, path: Path, change: Change) -> Iterator[None]:
        good, stamps = path.read_text(), path.stat()
        path.write_text(changed(good, change.number))
        later = stamps.st_mtime_ns + 2_000_000_000  # Numba and Python compare the times of files
        os.utime(path, ns=(stamps.st_atime_ns, later))
        try:
            yield
        finally:
            path.write_text(good)
            os.utime(path, ns=(stamps.st_atime_ns, stamps.st_mtime_ns))

    def _cache_without(self, compiled: set[Path]) -> Path:
        """Folder of compiled kernels without those that the planted bug can change."""
        names = {(path.parent.name, path.stem) for path in compiled}
        for package, state in self._states.items():
            old = self._good / f"kernels-{state}"
            new = self._bad / f"kernels-{kernel_state(self.root / package)}"
            for path in old.rglob("*.nb[ic]"):
                room = path.parent.name.rpartition("_")[0]
                if (room, path.name.partition(".")[0]) not in names:
                    _copy(path, new / path.parent.name)
        return self._bad

    def _run(
        self, tests: str, cache: Path, compile_: bool, *options: str
    ) -> tuple[int, float, str]:
        """Status of tests (0: all passed, negative: too long or crashed), processor time in s, and what they printed."""

        def limits() -> None:
            resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            most_s = MOST_S if compile_ else INTERPRETED_S
            resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s + 5))

        cache.mkdir(parents=True, exist_ok=True)
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.root),
            "NUMBA_CACHE_DIR": str(cache),
            "NUMBA_DISABLE_JIT": str(int(not compile_)),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        }
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, tests],
            cwd=self.root, env=environment, capture_output=True, text=True, preexec_fn=limits, check=False,
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode in (3, 4):
            raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-500:]}")
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return 0 if done.returncode == 5 else done.returncode, seconds, done.stdout  # 5: no tests


def _folders(package: Path) -> list[Path]:
    return [package, *(path for path in package.rglob("*") if path.is_dir())]


def _folder(place: Path) -> str:
    """Name of the folder in which Numba keeps what it compiled from the modules of a place."""
    return f"{place.name}_{hashlib.sha1(str(place).encode()).hexdigest()}"


def _copy(path: Path, folder: Path) -> None:
    if not (folder / path.name).exists():
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, folder / path.name)


def all_bugs(paths: Iterable[str]) -> list[Bug]:
    """Every bug of the files at or below some paths, in order."""
    files = []
    for path in paths:
        here = ROOT / path
        files += sorted(here.rglob("*.py")) if here.is_dir() else [here]
    names = [file.relative_to(ROOT).as_posix() for file in files]
    return [(name, change) for name in names for change in changes((ROOT / name).read_text())]


def _core() -> list[Bug]:
    return [bug for bug in all_bugs(PACKAGES) if not bug[0].startswith(BESIDE)]


def survivors(table: Path) -> list[Bug]:
    """The bugs of a table that survived and whose code is still there."""
    with table.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["verdict"] == "survived"]
    names = sorted({row["file"] for row in rows if (ROOT / row["file"]).is_file()})
    return [bug for bug in all_bugs(names) if any(_same(bug, row) for row in rows)]


def _same(bug: Bug, row: Mapping[str, object]) -> bool:
    keys = ("function", "before", "after", "text", "column")
    return row["file"] == bug[0] and all(str(row[k]) == str(getattr(bug[1], k)) for k in keys)


def summary(tried: Sequence[Tried]) -> str:
    """The kill rate with its 95 % interval, in one line."""
    verdicts = [one.verdict for one in tried]
    killed, survived = verdicts.count("killed"), verdicts.count("survived")
    count = killed + survived
    if not count:
        return "no bug was tried"
    rate, z = killed / count, 1.96
    middle, half = (
        rate + z * z / (2 * count),
        z * math.sqrt(rate * (1 - rate) / count + (z / (2 * count)) ** 2),
    )
    low, high = ((middle + sign * half) / (1 + z * z / count) for sign in (-1, 1))
    return (
        f"{killed} of {count} bugs noticed, {100 * rate:.0f} % (95 %: {100 * low:.0f} to {100 * high:.0f}); "
        f"{verdicts.count('equivalent')} more change no result"
    )


def main(arguments: Sequence[str]) -> int:
    """Draw the bugs, try them, write the table."""
    if arguments[0] == "--again":
        bugs, table = survivors(Path(arguments[1])), PLACE / "again.csv"
    else:
        count, seed, paths = int(arguments[0]), int(arguments[1]), arguments[2:]
        known = all_bugs(paths) if paths else _core()
        bugs = random.Random(seed).sample(known, min(count, len(known)))
        table = PLACE / f"seed-{seed}.csv"
    equivalent = tomllib.loads((Path(__file__).parent / "equivalent.toml").read_text())["bug"]
    tree = Tree(ROOT, PLACE)
    tried = []
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for bug in bugs:
            excused = any(_same(bug, row) for row in equivalent)
            one = Tried(bug, "equivalent") if excused else tree.tried(bug)
            tried.append(one)
            writer.writerow([one.verdict, bug[0], *bug[1], f"{one.seconds:.1f}", one.test])
            file.flush()
            what = f"{bug[0]}:{bug[1].line} {bug[1].before!r} -> {bug[1].after!r}"
            print(f"{len(tried):>4} {one.verdict:<10} {one.seconds:>4.0f} s  {what}", flush=True)
    print(summary(tried), f"table: {table.relative_to(ROOT)}", sep="; ")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
