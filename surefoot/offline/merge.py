"""Several sessions of one place as one map: `surefoot merge`.

The sessions are sorted by their content, so that any order of the arguments gives the same files. Every two are
linked (`session_links`), all are optimised together (`session_graph`), and every part that holds together becomes a
map (`merged_part`).
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from perception.odometry.session_graph import join
from perception.odometry.session_links import PairLinks, link_sessions
from perception.primitives.errors import InputError, OutputError

from ..progress import Say
from ..results.run_folder import RunFolder
from ..results.version import commit, version
from .mapped_session import MappedSession, read_images
from .merged_part import Part, Written, write_part


@dataclass(frozen=True)
class MergeSummary:
    """Result of `merge`.

    Args:
        folder: Of the first part; the others are in it.
        sessions: Names of the sessions, in the order of their numbers.
        parts: Numbers of the sessions of each part, from 1.
        pairs: Of every two sessions: numbers, probability of one place (NaN: not compared), links, and why not compared.
        changes: Number of changes of each part.
        vertices: Of the meshes of the parts.
    """

    folder: str
    sessions: tuple[str, ...]
    parts: tuple[tuple[int, ...], ...]
    pairs: tuple[tuple[int, int, float, int, str], ...]
    changes: tuple[int, ...]
    vertices: tuple[int, ...]

    def lines(self) -> list[str]:
        """The summary for the terminal."""
        found = [f"session {k}: {name}" for k, name in enumerate(self.sessions, start=1)]
        found += [
            f"sessions {one} and {other}: "
            + (
                f"not compared, {why}"
                if why
                else f"one place with probability {chance:.3f}, {links} links"
            )
            for one, other, chance, links, why in self.pairs
        ]
        for k, part in enumerate(self.parts):
            words = (
                "sessions " + ", ".join(map(str, part))
                if len(part) > 1
                else f"session {part[0]} alone"
            )
            found.append(
                f"part {k + 1}: {words}, mesh of {self.vertices[k]} vertices, {self.changes[k]} changes"
            )
        return [*found, f"map folder: {self.folder}"]


def merge(paths: Sequence[Path], out: Path | None, say: Say, report: bool = True) -> MergeSummary:
    """Merge the maps of several sessions.

    Args:
        paths: Map folders, in any order.
        out: Output folder; None takes the next free runs/merge-<n>.
        say: Progress.
        report: Whether to write the pages and tables of the parts.

    Raises:
        InputError: Fewer than two maps, one map twice, a folder that is no map, or a recording that is gone.
        RecordingError: A file of a map, or a recording, is damaged.
        OutputError: The folder cannot be written, or is one of the maps.
    """
    from ..report.page import write_report
    from ..store.run_tables import write_run_tables

    mapped = _opened(paths)
    if out is not None and any(_same(out, one.folder.root) for one in mapped):
        raise OutputError(f"output folder {out} is one of the maps; choose another --out")
    folder = RunFolder.create(out, name="merge")
    images = [read_images(one, say) for one in mapped]
    pairs: dict[tuple[int, int], PairLinks] = {}
    for one, other in combinations(range(len(mapped)), 2):
        say(f"links: session {one + 1} and {other + 1} of {len(mapped)}")
        rng = np.random.default_rng([mapped[one].config.seed, one, other])
        first, second = images[one].session, images[other].session
        places = mapped[one].config.odometer.back_end.places
        pairs[one, other] = link_sessions(first, second, rng, places)
    rank = [(not one.has_floor, -one.frames, k) for k, one in enumerate(mapped)]
    order = sorted(range(len(mapped)), key=lambda k: rank[k])
    parts = join([one.graph for one in images], pairs, [order.index(k) for k in range(len(mapped))])
    written = []
    for number, joined in enumerate(parts):
        place = folder if number == 0 else RunFolder.create(folder.root / f"part-{number + 1}")
        written.append((place, write_part(Part(joined, mapped, images), place, say)))
    members = [sorted(joined.sessions) for joined in parts]
    content = _content(mapped, pairs, members, [one for _, one in written])
    for number, (place, part) in enumerate(written):
        place.write_json("sessions.json", {"part": number + 1, **content})
        _summarise(place, folder, part, mapped, members[number])
        if report:
            write_report(place)
            write_run_tables(place)
    return MergeSummary(
        str(folder.root),
        tuple(one.name for one in mapped),
        tuple(tuple(k + 1 for k in sessions) for sessions in members),
        tuple(
            (a + 1, b + 1, one.probability, len(one.links), one.reason)
            for (a, b), one in pairs.items()
        ),
        tuple(len(one.changes) for _, one in written),
        tuple(one.vertices for _, one in written),
    )


def _opened(paths: Sequence[Path]) -> list[MappedSession]:
    """The sessions, sorted by content."""
    found: dict[str, MappedSession] = {}
    for path in paths:
        one = MappedSession.open(path)
        if one.digest in found:
            raise InputError(
                f"merge: {path} and {found[one.digest].folder.root} are the same map; give each session once"
            )
        found[one.digest] = one
    if len(found) < 2:
        raise InputError(f"merge: only {len(found)} map was given; two at least were expected")
    return [found[digest] for digest in sorted(found)]


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()


def _content(
    mapped: Sequence[MappedSession],
    pairs: dict[tuple[int, int], PairLinks],
    members: Sequence[Sequence[int]],
    written: Sequence[Written],
) -> dict[str, Any]:
    """sessions.json: the sessions, the evidence of every two, and the parts."""
    part_of = {k: number for number, sessions in enumerate(members, start=1) for k in sessions}
    return {
        "sessions": [
            {
                "session": k + 1,
                "name": one.name,
                "map": str(one.folder.root),
                "recording": str(one.path),
                "digest": one.digest,
                "frames": one.frames,
                "part": part_of[k],
                **written[part_of[k] - 1].spans[k]._asdict(),
            }
            for k, one in enumerate(mapped)
        ],
        "pairs": [
            {
                "sessions": [one + 1, other + 1],
                "probability": found.probability,
                "merged": part_of[one] == part_of[other],
                "links": len(found.links),
                "views": found.views,
                "compared": found.compared,
                "fitting": found.fitting,
                "contradicting": found.contradicting,
                "moved": found.moved,
                "reason": found.reason,
            }
            for (one, other), found in sorted(pairs.items())
        ],
        "parts": [[k + 1 for k in sessions] for sessions in members],
    }


def _summarise(
    place: RunFolder,
    folder: RunFolder,
    written: Written,
    mapped: Sequence[MappedSession],
    sessions: Sequence[int],
) -> None:
    """Write summary.json of a part."""
    words = ["surefoot", "merge", *(str(one.folder.root) for one in mapped)]
    place.write_json(
        "summary.json",
        {
            "kind": "map",
            "name": "merge of " + ", ".join(mapped[k].name for k in sessions),
            "command": shlex.join([*words, "--out", str(folder.root)]),
            "recording": "",
            "version": version(),
            "commit": commit(),
            "frames": written.frames,
            "skipped": {},
            "notes": [f"session {' and '.join(str(k + 1) for k in sessions)} of {len(mapped)}"],
            "vertices": written.vertices,
            "walkable_m2": written.walkable_m2,
            "trajectory": "camera",
        },
    )
