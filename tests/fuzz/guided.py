"""Damaged files that are chosen by the lines which they reach: `python tests/fuzz/guided.py SECONDS [DOOR...]`.

An input that reaches a new branch of the readers is kept and damaged further. Needs atheris, which is in no extra because
it has wheels for few versions of Python: `pip install atheris`. What it finds is kept as by `campaign`.
"""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parent))
READERS = [
    "surefoot.recordings", "surefoot.results", "surefoot.config", "surefoot.evaluation", "surefoot.mcap_file",
    "perception.primitives.safe_input", "mapping.io", "sim.scenes", "rosbags", "mcap",
]  # fmt: skip
KERNELS = ["surefoot.recordings._lzf_kernels", "mapping.io._voxel_kernels"]

with atheris.instrument_imports(include=READERS, exclude=KERNELS, enable_loader_override=False):
    from campaign import KEPT, Finding, in_process, keep, prepared, quiet, tried
    from doors import DOORS
    from mutate import mutated

LONGEST = 1 << 20  # bytes of an input


def guided(name: str, seconds: int, folder: Path) -> int:
    """Fuzz one door; does not return. An input is the number of a file in one byte, then its content."""
    door = DOORS[name]
    files = prepared(door, folder)
    kept = [path for path in files.names if len(files.good[path]) < LONGEST][:256]
    faults: set[str] = set()

    def one(data: bytes) -> None:
        if not data:
            return
        path = kept[data[0] % len(kept)]
        fault = tried(door, files, path, data[1:])
        if fault and fault not in faults:
            faults.add(fault)
            file = path.relative_to(folder).as_posix()
            keep(f"{name}-guided-{len(faults)}", files, [Finding(file, data[1:], fault)])

    def changed(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.5 and data:
            return (data[:1] + mutated(data[1:], rng))[:most]
        return bytes(atheris.Mutate(data, most))

    corpus = Path(tempfile.mkdtemp(dir=folder.parent))
    for number, path in enumerate(kept):
        (corpus / str(number)).write_bytes(bytes([number]) + files.good[path])
    limits = [f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-timeout=0", "-rss_limit_mb=0"]
    atheris.Setup([sys.argv[0], str(corpus), *limits], one, custom_mutator=changed)
    atheris.Fuzz()
    return 0


def main() -> None:
    """All doors, each in a process of its own."""
    quiet()
    seconds, names = int(sys.argv[1]), sys.argv[2:] or list(DOORS)
    wrong = 0
    for name in names:
        wrong += in_process(lambda folder, name=name: guided(name, seconds, folder), name)
        found = len(list(KEPT.glob(f"{name}-guided-*")))
        wrong += found
        print(f"{name:<14} {seconds} s, {found} faults", flush=True)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
