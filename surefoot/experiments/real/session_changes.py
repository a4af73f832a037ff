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
from ...results.run_folder import RunFolder
from ..support.experiment import Say
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


@dataclass(frozen=True, eq=False)
class Found:
    """What was found in one home.

    Args:
        state: The home before and after.
        places: The cameras beside the truth; None if the sessions stay apart.
        changes: Of changes.json.
        folder: Of the merged map.
    """

    state: Rearranged
    places: Aligned | None
    changes: list[dict[str, Any]]
    folder: Path

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
        true, reported = one.true_places(), {"before": [], "after": []}  # type: ignore[var-annotated]
        ends: list[dict[str, int | None]] = []
        for change in one.changes:
            forwards = change["sessions"] == self._order(one)
            end: dict[str, int | None] = {}
            for kind, key in zip(
                ("before", "after"), ("before", "after")[:: 1 if forwards else -1], strict=True
            ):
                if change[key] is not None:
                    end[kind] = _nearest(change[key], true[kind])
                    reported[kind].append(end[kind])
            ends.append(end)
        for kind, hits in reported.items():
            got = {hit for hit in hits if hit is not None}
            self.found += len(got)
            self.missed += len(true[kind]) - len(got)
            self.right += sum(hit is not None for hit in hits)
            self.wrong += sum(hit is None for hit in hits)
        self.joined += len(
            {
                end["before"]
                for end in ends
                if len(end) == 2 and end["before"] is not None and end["before"] == end["after"]
            }
        )

    @staticmethod
    def _order(one: Found) -> list[int]:
        """Numbers of the first and the second session of a home."""
        content = RunFolder.open(one.folder).read_json("sessions.json")
        assert content is not None
        by_name = {session["name"]: session["session"] for session in content["sessions"]}
        return [by_name["first"], by_name["second"]]

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
    merge(maps, folder, lambda text: None)
    content = RunFolder.open(folder).read_json("changes.json") or {"changes": []}
    return Found(state, aligned(folder), content["changes"], folder)
