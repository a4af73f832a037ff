"""The tables of one run, made from the files of its folder.

`tables/runs.parquet` is written last: a run has tables if it is there, and every file is renamed into its place when
it is complete.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perception.primitives import safe_input
from perception.primitives.safe_input import UnreadableError

from ..evaluation.evaluate import has_own_axes
from ..evaluation.metrics.trajectory import associate
from ..results.run_folder import (
    COVARIANCE_HEADER,
    ERRORS,
    SIMULATION,
    RunFolder,
)
from ..results.tables import Table
from ..results.tracking import TRACKING
from . import parquet
from .run_metrics import metrics_row
from .schema import FOLDER, SCHEMA_VERSION, STATE, TABLES

SAME_S = 1e-6  # stamps of TUM text are rounded

Columns = dict[str, Any]


def write_run_tables(run: RunFolder) -> Path | None:
    """Write the Parquet tables of a complete or interrupted run into its folder.

    Args:
        run: A run of any kind.

    Returns:
        The folder of the tables; None for a run that was killed and has no summary.json.

    Raises:
        RecordingError: A file of the run is damaged.
        OutputError: The folder cannot be written.
    """
    if not run.has("summary.json"):
        return None
    tables = run_tables(run)
    database = parquet.connect(threads=1)
    try:
        for last in (False, True):
            with run.staged() as stage:
                (stage / FOLDER).mkdir()
                for name, columns in tables.items():
                    if (name == "runs") is last:
                        parquet.write(database, name, columns, stage / FOLDER / f"{name}.parquet")
            for name in set(TABLES) - set(tables):
                run.path(f"{FOLDER}/{name}.parquet").unlink(missing_ok=True)
    finally:
        database.close()
    return run.path(FOLDER)


def run_tables(run: RunFolder) -> dict[str, Columns]:
    """Name of each table that has rows to its columns by name, as `parquet.write` takes them.

    Raises:
        RecordingError: A file of the run is damaged.
    """
    settings = _settings(run)
    found = {
        "runs": _one_row(_run_row(run, settings)),
        "metrics": _one_row(metrics_row(run)),
        "config": {
            "setting": list(settings),
            "value": [json.dumps(value) for value in settings.values()],
        },
        "frames": _frames(run),
        "tracks": _tracks(run),
        "floors": _plain(run, "floor.csv", "floors", ("camera", "state")),
        "steps": _plain(run, "commands.csv", "steps", ()),
        "decisions": _plain(run, "commands.csv", "decisions", ("why",)),
    }
    return {name: found[name] for name in TABLES if _rows(found[name])}


def _rows(columns: Columns) -> int:
    return len(next(iter(columns.values()), ()))


def _one_row(row: Mapping[str, Any]) -> Columns:
    return {name: [value] for name, value in row.items()}


def _settings(run: RunFolder) -> dict[str, Any]:
    """Dotted name of each setting to its value; empty without a readable config.toml."""
    try:
        return _flat(safe_input.toml(safe_input.text(run.path("config.toml"))))
    except UnreadableError:
        return {}


def _flat(table: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in table.items():
        found |= (
            _flat(value, f"{above}{name}.") if isinstance(value, dict) else {above + name: value}
        )
    return found


def _run_row(run: RunFolder, settings: Mapping[str, Any]) -> dict[str, Any]:
    summary = run.read_json("summary.json") or {}
    simulated = run.kind == SIMULATION
    config = run.read_text("config.toml")
    return {
        "schema": SCHEMA_VERSION,
        "version": summary.get("version"),
        "commit": summary.get("commit") or None,
        "kind": summary.get("kind"),
        "name": summary.get("name"),
        "recording": summary.get("recording") or None,
        "recording_hash": summary.get("recording_identity") or None,
        "scene": settings.get("scene") if simulated else None,
        "seed": settings.get("seed"),
        "config_hash": None if config is None else hashlib.sha256(config.encode()).hexdigest(),
        "planner": settings.get("mission.planner") if simulated else None,
        "body": summary.get("body"),
        "interrupted": run.interrupted,
        "fell_at_s": summary.get("fell_at_s"),
        "notes": json.dumps(summary.get("notes") or []),
    }  # fmt: skip


def _plain(run: RunFolder, file: str, name: str, words: tuple[str, ...]) -> Columns:
    """The columns of a table that are columns of a CSV file; those that an older file lacks are unknown."""
    table = run.read_csv(file)
    if table is None:
        return {}
    return {one.name: _column(table, one.name, one.name in words) for one in TABLES[name]}


def _column(table: Table, name: str, words: bool = False) -> Any:
    if name not in table.columns:
        return [None] * len(table)
    return [word or None for word in table.words(name)] if words else table.numbers(name)


def _frames(run: RunFolder) -> Columns:
    """One row per frame: pose, its error, odometry, time."""
    trajectory = run.read_trajectory("trajectory.txt")
    timing, odometry = run.read_csv("timing.csv"), run.read_csv("odometry.csv")
    states = run.read_csv("states.csv") or run.read_csv(TRACKING)
    stamps = next(
        (one.numbers("stamp_s") for one in (timing, odometry, states) if one is not None),
        None if trajectory is None else trajectory.stamps,
    )
    if stamps is None:
        return {}
    columns: Columns = {
        one.name: np.full(len(stamps), np.nan) for one in TABLES["frames"] if one.kind == "DOUBLE"
    }
    columns["stamp_s"] = stamps
    columns["state"] = [None] * len(stamps)

    def put(at: np.ndarray, **values: np.ndarray) -> None:
        mine, theirs = associate(stamps, at, SAME_S)
        for name, value in values.items():
            columns[name][mine] = value[theirs]

    if trajectory is not None:
        x, y, z = trajectory.positions.T
        quat = dict(zip(("qx", "qy", "qz", "qw"), trajectory.quats_xyzw.T, strict=True))
        put(trajectory.stamps, x_m=x, y_m=y, z_m=z, yaw_rad=trajectory.yaws, **quat)
    poses = run.read_csv("trajectory_covariance.csv")
    if poses is not None:
        names = COVARIANCE_HEADER[3:]
        put(poses.numbers("stamp_s"), **{name: poses.numbers(name) for name in names})
    error = _errors(run)
    if error is not None:
        put(error[0], error_m=error[1])
    if odometry is not None:
        measured = ("ahead_m", "left_m", "turn_rad", "steps")
        put(odometry.numbers("stamp_s"), **{name: odometry.numbers(name) for name in measured})
    if states is not None:
        columns["state"] = np.full(len(stamps), None, dtype=object)
        put(states.numbers("stamp_s"), state=np.array(states.words("state"), dtype=object))
        if "failure_probability" in states.columns:
            put(
                states.numbers("stamp_s"), failure_probability=states.numbers("failure_probability")
            )
    if timing is not None:
        stages = [name for name in timing.columns if name != "stamp_s"]
        put(timing.numbers("stamp_s"), total_ms=timing.matrix(*stages).sum(axis=1))
    return columns


def _errors(run: RunFolder) -> tuple[np.ndarray, np.ndarray] | None:
    """Stamps, and position errors in the axes of the truth or else after alignment; None if they are not known."""
    if not has_own_axes(run):
        estimate, true = (
            run.read_trajectory("trajectory.txt"),
            run.read_trajectory("truth/trajectory.txt"),
        )
        if estimate is not None and true is not None:
            mine, theirs = associate(estimate.stamps, true.stamps)
            apart = estimate.positions[mine] - true.positions[theirs]
            return estimate.stamps[mine], np.linalg.norm(apart[:, :2], axis=1)
    table = run.read_csv(ERRORS)
    if table is None:
        return None
    names = [name for name in ("error_x", "error_y", "error_z") if name in table.columns]
    return table.numbers("stamp_s"), np.linalg.norm(table.matrix(*names), axis=1)


def _tracks(run: RunFolder) -> Columns:
    entries = (run.read_json("obstacles.json") or {}).get("tracks", [])
    if not entries:
        return {}
    means = np.array([entry["mean"] for entry in entries], dtype=np.float64)
    covariances = np.array([entry["covariance"] for entry in entries], dtype=np.float64)
    rows, below = np.triu_indices(4)
    columns: Columns = dict(zip(("x_m", "y_m", "vx_mps", "vy_mps"), means.T, strict=True))
    columns |= dict(zip(STATE, covariances[:, rows, below].T, strict=True))
    for name, key in (("stamp_s", "stamp"), ("radius_m",) * 2, ("height_m",) * 2, ("moving",) * 2,
                      ("seen_s", "seen")):  # fmt: skip
        columns[name] = np.array([entry.get(key) for entry in entries], dtype=np.float64)
    columns["track"] = np.array([entry["track"] for entry in entries], dtype=np.int64)
    columns["modes"] = [
        None if entry.get("modes") is None else json.dumps(entry["modes"]) for entry in entries
    ]
    return columns
