"""One side of a comparison: the figures of its runs by recording, or by scene and seed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..progress import Say
from .query import Asker, asker
from .schema import COMMIT


@dataclass(frozen=True)
class Figure:
    """A figure of the table `metrics` that is judged.

    Args:
        name: Its column.
        words: What it is.
        better: -1 if less is better, 1 if more is better, 0 if it should be 1.
        ratio: Whether it is compared by its ratio wherever it is positive.
    """

    name: str
    words: str
    better: int = -1
    ratio: bool = True


FIGURES = (
    Figure("ate_m", "trajectory error after alignment (ATE)"),
    Figure("position_rmse_m", "position error, RMS"),
    Figure("heading_rmse_deg", "heading error, RMS"),
    Figure("rpe_1s_m", "error of motion over 1 s (RPE)"),
    Figure("pose_nees", "mean NEES of the pose", 0),
    Figure("landmark_nis", "mean NIS of landmarks", 0),
    Figure("track_nis", "mean NIS of tracks", 0),
    Figure("floor_share", "share of the frames with a floor", 1, ratio=False),
    Figure("tilt_error_deg", "error of the floor's tilt"),
    Figure("false_movers", "false movers", -1, ratio=False),
    Figure("ospa_m", "OSPA of moving obstacles"),
    Figure("grid_correct_share", "share of the map that is correct", 1, ratio=False),
    Figure("surface_fscore", "F-score of the surface at 2 cm", 1, ratio=False),
    Figure("contacts", "contacts", -1, ratio=False),
    Figure("falls", "falls", -1, ratio=False),
    Figure("goals_missed", "goals not reached", -1, ratio=False),
    Figure("skipped", "skipped frames", -1, ratio=False),
)
UNJUDGED = (Figure("frame_ms", "time per frame, median; depends on the machine and its load"),)


@dataclass(frozen=True)
class Side:
    """The runs of one side.

    Args:
        name: As it was given.
        place: The folder.
        versions: Versions and commits of the code.
        metrics: Key of a pair to figure to value.
        labels: Key of a pair to words for it.
        runs: Key of a pair to its first run, as in the tables.
        settings: Settings that are the same in all its runs, as JSON.
    """

    name: str
    place: Path
    versions: tuple[str, ...]
    metrics: Mapping[str, Mapping[str, float]]
    labels: Mapping[str, str]
    runs: Mapping[str, str]
    settings: Mapping[str, str]

    def folder(self, key: str) -> Path:
        """The run folder of a pair's key."""
        return self.place if (self.place / COMMIT).is_file() else self.place / self.runs[key]


def read_side(place: Path, say: Say) -> Side:
    """The runs of a folder, one for each recording or seed.

    Raises:
        InputError: It has no runs with tables.
    """
    with asker([place], say) as tables:
        rows = tables.ask(
            'SELECT run, kind, recording, recording_hash, scene, seed, name, version, "commit" FROM runs ORDER BY run'
        ).rows
        names = [figure.name for figure in (*FIGURES, *UNJUDGED)]
        figures = tables.ask(f"SELECT run, {', '.join(names)} FROM metrics").rows
        settings = _same_settings(tables)
    values = {run: found for run, *found in figures}
    grouped: dict[str, list[str]] = defaultdict(list)
    labels: dict[str, str] = {}
    for run, kind, recording, digest, scene, seed, name, _, _ in rows:
        words = f"{scene}, seed {seed}" if scene is not None else Path(recording or name).name
        key = f"{kind} {words if digest is None else digest}"
        grouped[key].append(run)
        labels.setdefault(key, words)
    return Side(
        str(place),
        place,
        tuple(sorted({f"{row[7]} {row[8] or ''}".strip() for row in rows})),
        {
            key: _means(names, [values[run] for run in runs if run in values])
            for key, runs in grouped.items()
        },
        labels,
        {key: runs[0] for key, runs in grouped.items()},
        settings,
    )


def _means(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, float]:
    found = {}
    for place, name in enumerate(names):
        known = [float(row[place]) for row in rows if row[place] is not None]
        if known:
            found[name] = float(np.mean(known))
    return found


def _same_settings(tables: Asker) -> dict[str, str]:
    """Settings with one value in all runs that have one."""
    rows = tables.ask(
        "SELECT setting, any_value(value) FROM config GROUP BY setting HAVING count(DISTINCT value) = 1"
    ).rows
    return {str(name): str(value) for name, value in rows}
