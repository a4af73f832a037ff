"""Furniture that was moved between two sessions in a simulated home, against what `surefoot merge` finds.

A camera is carried through the home, some pieces are moved, and it is carried through the other way round. Both
recordings come with poses in axes of their own that drift, as a tracking camera reports them, and are mapped and merged. A moved piece leaves one place and fills another; the reported outlines
of what is gone and what appeared are compared with these. An outline is right if the middle of a true place lies within
it, or its own middle lies within `NEAR_M` of one.

Source: ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mapping.objects.pixels import inside
from sim.scenes.home import home

from ...offline.merge import merge
from ...progress import Say, silent
from ...results.run_folder import RunFolder
from ..support.handheld import (
    Rearranged,
    drifted,
    frames,
    path,
    rearranged,
    record,
    write_truth,
)
from .session_splits import Aligned, aligned, mapped

FIRST_HOME = 0  # seeds; thresholds were chosen on homes from 100 on
MOVED = 3  # pieces in each home
NEAR_M = 0.35
KINDS = ("before", "after")


@dataclass(frozen=True, eq=False)
class Found:
    """What was found in one home.

    Args:
        state: The home before and after.
        places: The cameras beside the truth; None if the sessions stay apart.
        changes: Of changes.json, from the first session to the second.
    """

    state: Rearranged
    places: Aligned | None
    changes: list[dict[str, Any]]

    def true_places(self) -> dict[str, Float[np.ndarray, "n 2"]]:
        """Places left and filled, in the axes of the map."""
        assert self.places is not None
        motion = self.places.alignment
        found = {}
        for kind, xy in (("before", self.state.old), ("after", self.state.new)):
            world = np.column_stack([xy, np.zeros(len(xy))])
            found[kind] = (world - motion.translation) @ motion.rotation
        return {kind: xyz[:, :2] for kind, xyz in found.items()}


@dataclass
class Score:
    """Counts over homes: places found and missed, outlines right and wrong, moves whose two places were joined."""

    found: int = 0
    missed: int = 0
    right: int = 0
    wrong: int = 0
    joined: int = 0

    def add(self, one: Found) -> None:
        """Count one home."""
        if one.places is None:
            self.missed += 2 * len(one.state.old)
            return
        true = one.true_places()
        hits = [
            {kind: _nearest(change[kind], true[kind]) for kind in KINDS if change[kind] is not None}
            for change in one.changes
        ]
        for kind in KINDS:
            named = [hit[kind] for hit in hits if kind in hit]
            got = {hit for hit in named if hit is not None}
            self.found += len(got)
            self.missed += len(true[kind]) - len(got)
            self.right += sum(hit is not None for hit in named)
            self.wrong += sum(hit is None for hit in named)
        both = {hit["before"] for hit in hits if len(hit) == 2 and hit["before"] == hit["after"]}
        self.joined += len(both - {None})

    @property
    def precision(self) -> float:
        """Share of the reported outlines that are right."""
        return self.right / max(self.right + self.wrong, 1)

    @property
    def recall(self) -> float:
        """Share of the true places that are found."""
        return self.found / max(self.found + self.missed, 1)

    @property
    def f1(self) -> float:
        """Harmonic mean of both."""
        return 2.0 * self.precision * self.recall / max(self.precision + self.recall, 1e-9)


def _nearest(reported: dict[str, Any], true: Float[np.ndarray, "n 2"]) -> int | None:
    """The true place of a reported outline; None if there is none."""
    away = np.linalg.norm(true - np.array(reported["position_m"]), axis=1)
    within = inside(np.array(reported["outline_m"], float), true)
    good = np.flatnonzero(within | (away <= NEAR_M))
    return int(good[np.argmin(away[good])]) if len(good) else None


def home_changes(seed: int, place: Path, most: int, say: Say) -> Found:
    """Two sessions in the home of a seed, mapped and merged."""
    state = rearranged(home(seed), MOVED, np.random.default_rng([seed, 4]))
    recordings = []
    for name, scene, backwards in (("first", state.before, False), ("second", state.after, True)):
        say(f"home {seed}: {name} session")
        poses = path(scene, backwards, most)
        told = drifted(poses, np.random.default_rng([seed, 7 + backwards]))
        seen = frames(scene, poses, np.random.default_rng([seed, 5 + backwards]), told)
        (place / name / "truth").mkdir(parents=True)
        write_truth(place / name / "truth" / "trajectory.txt", poses)
        recordings.append(record(place / name / "recording.mcap", name, seen))
    maps = mapped(recordings, say, ignore_poses=False)
    folder = place / "merged"
    say(f"home {seed}: merge")
    merge(maps, folder, silent, report=False)
    return Found(state, aligned(folder), _forwards(RunFolder.open(folder)))


def _forwards(run: RunFolder) -> list[dict[str, Any]]:
    """The changes of a merged map from the session named first to the other one."""
    sessions, changes = run.read_json("sessions.json"), run.read_json("changes.json")
    assert sessions is not None
    assert changes is not None
    if sessions["sessions"][0]["name"] == "first":
        return list(changes["changes"])
    return [
        change | {"before": change["after"], "after": change["before"]}
        for change in changes["changes"]
    ]
