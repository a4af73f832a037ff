"""The jobs of some places: recordings, folders and lists of them, addresses; of run folders; of seeds."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from perception.primitives import safe_input
from perception.primitives.errors import InputError
from perception.primitives.safe_input import UnreadableError

from ..recordings.find import below
from ..recordings.identity import identity
from ..results.run_folder import MARK, RunFolder
from .addresses import is_address, recordings_at
from .job import EVALUATE, SIMULATE, Job

LIST = ".txt"  # a file of places, one a line
LONGEST_NAME = 200  # bytes, ours: file systems take 255


@dataclass(frozen=True)
class Order:
    """What to do with every recording.

    Args:
        verb: As of `Job`.
        config: TOML file of settings; "": those of the recordings, else the defaults.
        overrides: Single settings.
        record: Whether simulated walks keep their sensor data.
    """

    verb: str
    config: str = ""
    overrides: tuple[str, ...] = ()
    record: bool = False


def jobs_of_places(order: Order, places: Sequence[str], out: Path) -> list[Job]:
    """One job for every recording in some places (of `evaluate`: for every run), in their order, each once.

    Raises:
        InputError: A place does not exist, there is no recording, or two would get the same name.
    """
    found: dict[str, str] = {}
    seen: set[str | Path] = set()
    for place in unfolded(places):
        for source, digest in _found(order, place).items():
            # by another path or a link it is the same recording
            one = source if is_address(source) else Path(source).resolve()
            if one not in seen:
                found[source] = digest
            seen.add(one)
    if not found:
        what = "run" if order.verb == EVALUATE else "recording"
        raise InputError(
            f"{', '.join(places)}: no {what} found in it; `surefoot process --help` lists what is read"
        )
    judged = order.verb == EVALUATE
    return [
        Job(
            name=name,
            verb=order.verb,
            source=source,
            target=source if judged else str(out / name),
            config=order.config,
            overrides=order.overrides,
            identity=digest,
        )
        for (source, digest), name in zip(found.items(), names_of(list(found)), strict=True)
    ]


def jobs_of_seeds(order: Order, scene: str, seeds: range, out: Path) -> list[Job]:
    """One simulated walk for every seed; an empty scene is that of the settings."""
    name = Path(scene).stem or "walk"
    return [
        Job(
            name=f"{name}-{seed}",
            verb=SIMULATE,
            source=scene,
            target=str(out / f"{name}-{seed}"),
            config=order.config,
            overrides=order.overrides,
            seed=seed,
            record=order.record,
            identity=f"{scene} {seed}",
        )
        for seed in seeds
    ]


def unfolded(places: Sequence[str]) -> list[str]:
    """The places, and instead of each list the places in it; paths in a list are relative to it."""
    found = []
    for place in places:
        path = Path(place.removeprefix("file://"))
        if is_address(place) and not place.startswith("file://"):
            found.append(place)
        elif path.suffix == LIST and path.is_file():
            try:
                lines = [line.strip() for line in safe_input.text(path).splitlines()]
            except UnreadableError as error:
                raise InputError(f"{path} {error}; expected one recording in a line") from error
            inner = [line for line in lines if line and not line.startswith("#")]
            found += [line if is_address(line) else str(path.parent / line) for line in inner]
        else:
            found.append(str(path))
    return found


def current_identity(job: Job) -> str:
    """Digest of a recording as it is now; of a run, of how it was made."""
    if job.identity:
        return job.identity
    return _digest_of_run(Path(job.source)) if job.verb == EVALUATE else identity(Path(job.source))


def names_of(sources: Sequence[str]) -> list[str]:
    """A name for each: its own without ending, preceded by those of as many folders as tell it from the others.

    A name that leaves no room for the endings of files is cut, and gets a digest of the whole.

    Raises:
        InputError: Two are the same to the root.
    """
    parts = [_parts(source) for source in sources]
    taken = [1] * len(parts)
    while True:
        names = ["-".join(one[-many:]) for one, many in zip(parts, taken, strict=True)]
        counts = Counter(names)
        twice = [k for k, name in enumerate(names) if counts[name] > 1]
        if not twice:
            return [_short(name) for name in names]
        for k in twice:
            if taken[k] >= len(parts[k]):
                raise InputError(
                    f"two recordings would both be called {names[k]}; process them separately"
                )
            taken[k] += 1


def _short(name: str) -> str:
    whole = os.fsencode(name)
    if len(whole) <= LONGEST_NAME:
        return name
    return f"{whole[:LONGEST_NAME].decode(errors='ignore')}-{hashlib.sha256(whole).hexdigest()[:8]}"


def _parts(source: str) -> list[str]:
    """The folders of a recording and its name."""
    if is_address(source):
        path = PurePosixPath(source.partition("://")[2])
        named = path.stem if path.suffix in (".mcap", ".bag", ".db3", ".pcd", ".mat") else path.name
    else:
        whole = Path(source).resolve()
        path, named = PurePosixPath(whole), whole.stem if whole.is_file() else whole.name
    return [*(part for part in path.parent.parts if part != "/"), named]


def _found(order: Order, place: str) -> dict[str, str]:
    """The recordings at a place, or the runs, with their digests as far as they are known."""
    if is_address(place):
        if order.verb == EVALUATE:
            raise InputError(f"{place}: `evaluate` needs run folders on a disk")
        return recordings_at(place)
    path = Path(place)
    if not path.exists():
        raise InputError(f"{place}: no such file or folder; give recordings or folders of them")
    if order.verb == EVALUATE:
        return dict.fromkeys(map(str, _runs_below(path)), "")
    return dict.fromkeys(map(str, below(path)), "")


def _runs_below(place: Path) -> list[Path]:
    """The complete runs in a folder, at most two levels down."""
    found = (path.parent for depth in ("", "*/", "*/*/") for path in place.glob(f"{depth}{MARK}"))
    return sorted(one for one in found if RunFolder(one).has("summary.json"))


def _digest_of_run(run: Path) -> str:
    return hashlib.sha256((RunFolder(run).read_text("summary.json") or "").encode()).hexdigest()
