"""Runs as a LeRobotDataset v3.0, for learning: one episode per run.

A row is an instant of a constant clock; it holds the frame of the run that is nearest to it, and `observation.stamp_s` says
when that was. Values between two decisions are those of the last one. What was not seen is zero, with a flag or a share
that says so, because the statistics of a dataset know no gaps. Ground truth is not exported.

Layout: meta/info.json, meta/stats.json, meta/tasks.parquet, meta/episodes/chunk-000/file-000.parquet, and one
data/chunk-*/file-*.parquet per episode with the pictures inside (dtype "image"): colour as JPEG, depth as PNG of 16-bit
millimetres.

Source: the format v3.0 of LeRobot (R. Cadene et al., *LeRobot: state-of-the-art machine learning for real-world robotics in
PyTorch*, 2024).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapping.io.atomic_write import PART
from perception.primitives.errors import InputError, OutputError

from ..progress import Say
from ..results.formats import refuse
from ..results.run_folder import RunFolder
from . import parquet
from .lerobot_rows import QUANTILES, Episode, episode_of, rate_of, stats_of
from .run_tables import run_tables

VERSION = "v3.0"
CHUNK = 1000  # files of a folder
COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")


def export(runs: Sequence[RunFolder], out: Path, say: Say, fps: int | None = None) -> Path:
    """Write a dataset with one episode per run.

    Args:
        runs: Runs with frames; all have the same features.
        out: Folder of the dataset, which is new or empty.
        say: What a run lacks.
        fps: Rows per second; None: the rate of the frames of the first run.

    Returns:
        The folder.

    Raises:
        InputError: A run has no poses, or other features than the first.
        OutputError: The folder holds something, or cannot be written.
    """
    # inside: the folder may be the working directory, or a disk of its own
    part = out / f"{PART}dataset"
    new = not out.exists()
    if not new and (not out.is_dir() or any(one != part for one in out.iterdir())):
        raise OutputError(f"{out} is not empty; choose another folder for the dataset")
    shutil.rmtree(part, ignore_errors=True)
    try:
        _write(runs, part, say, fps)
        for name in ("data", "meta"):
            (part / name).rename(out / name)
    except OSError as error:
        refuse(error, out)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if new and out.is_dir() and not any(out.iterdir()):
            out.rmdir()
    return out


def _write(runs: Sequence[RunFolder], root: Path, say: Say, fps: int | None) -> None:
    tasks: dict[str, int] = {}
    rows: list[dict[str, Any]] = []
    features: dict[str, Any] = {}
    stats: list[dict[str, dict[str, Any]]] = []
    first, database = 0, parquet.connect(threads=1)
    for number, run in enumerate(runs):
        columns = run_tables(run)
        fps = fps or rate_of(run, columns)
        episode = episode_of(run, columns, fps, say)
        described = _features(episode, fps)
        if features and described != features:
            other = sorted(
                name for name in features | described if features.get(name) != described.get(name)
            )
            raise InputError(
                f"{run.root}: {', '.join(other)} differ from those of {runs[0].root}; export them apart"
            )
        features = described
        count, task = len(episode.stamps), tasks.setdefault(episode.task, len(tasks))
        found = _write_data(database, root, episode, (number, first, task, fps))
        place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
        rows.append(
            {
                "episode_index": number, "tasks": [episode.task], "length": count,
                **{f"data/{name}": value for name, value in place.items()},
                "dataset_from_index": first, "dataset_to_index": first + count,
                "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
                **{f"stats/{name}/{kind}": value for name, one in found.items() for kind, value in one.items()},
            }
        )  # fmt: skip
        stats.append(found)
        first += count
    _write_meta(
        database, root, rows, tasks, stats, _info(features, len(rows), first, len(tasks), fps or 1)
    )
    database.close()


def _features(episode: Episode, fps: int) -> dict[str, Any]:
    """The features as meta/info.json lists them."""
    found: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": list(names), "fps": fps}
        for name, names in episode.names.items()
    }
    for name, shape in episode.shapes.items():
        found[name] = {
            "dtype": "image", "shape": list(shape), "names": ["height", "width", "channels"], "fps": fps,
        }  # fmt: skip
    found["observation.stamp_s"] = {"dtype": "float64", "shape": [1], "names": None, "fps": fps}
    for name in COUNTED:
        kind = "float32" if name == "timestamp" else "int64"
        found[name] = {"dtype": kind, "shape": [1], "names": None, "fps": fps}
    return found


def _write_data(
    database: Any, root: Path, episode: Episode, place: tuple[int, int, int, int]
) -> dict[str, dict[str, Any]]:
    """Write the rows of an episode; returns its statistics.

    Args:
        database: Of `parquet.connect`.
        root: Folder of the dataset.
        episode: The rows.
        place: Number of the episode, of its first row in the dataset, and of its task; rows per second.
    """
    number, first, task, fps = place
    count = len(episode.stamps)
    own: dict[str, np.ndarray] = {
        "observation.stamp_s": np.asarray(episode.stamps, dtype=np.float64),
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, number),
        "index": first + np.arange(count),
        "task_index": np.full(count, task),
    }
    given: dict[str, Any] = {}
    chosen: list[str] = []
    for name, values in episode.vectors.items():
        for k in range(values.shape[1]):
            given[f"{name}/{k}"] = values[:, k]
        listed = ", ".join(f'"{name}/{k}"' for k in range(values.shape[1]))
        chosen.append(f'[{listed}]::FLOAT[] AS "{name}"')
    for name, pictures in episode.pictures.items():
        given[name] = pictures
        chosen.append(f'''{{'bytes': "{name}"::BLOB, 'path': NULL::VARCHAR}} AS "{name}"''')
    for name, values in own.items():
        given[name] = values
        chosen.append(f'"{name}"')
    path = root / "data" / f"chunk-{number // CHUNK:03d}" / f"file-{number % CHUNK:03d}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    parquet.copy(database, given, path, ", ".join(chosen))
    vectors = episode.vectors | {name: values[:, None] for name, values in own.items()}
    return {
        name: stats_of(np.asarray(v, dtype=np.float64)) for name, v in vectors.items()
    } | episode.stats


def _info(
    features: Mapping[str, Any], episodes: int, rows: int, tasks: int, fps: int
) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": "surefoot",
        "total_episodes": episodes,
        "total_frames": rows,
        "total_tasks": tasks,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": dict(features),
    }


def _write_meta(
    database: Any,
    root: Path,
    rows: Sequence[dict[str, Any]],
    tasks: Mapping[str, int],
    stats: Sequence[dict[str, dict[str, Any]]],
    info: Mapping[str, Any],
) -> None:
    """Write everything below meta/."""
    meta = root / "meta"
    (meta / "episodes/chunk-000").mkdir(parents=True)
    (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    (meta / "stats.json").write_text(json.dumps(_together(stats), indent=4), encoding="utf-8")
    given = {name: [_as_json(row[name]) for row in rows] for name in rows[0]}
    chosen = [f'CAST("{name}"::JSON AS {_kind(rows[0][name])}) AS "{name}"' for name in rows[0]]
    parquet.copy(database, given, meta / "episodes/chunk-000/file-000.parquet", ", ".join(chosen))
    index = {
        "index_columns": ["task"], "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": None},
            {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
        ],
        "pandas_version": "2.2.0",
    }  # fmt: skip
    parquet.copy(
        database,
        {"task_index": np.array(list(tasks.values())), "task": list(tasks)},
        meta / "tasks.parquet",
        metadata={"pandas": json.dumps(index)},
    )


def _as_json(value: Any) -> str:
    return json.dumps(value)


def _kind(value: Any) -> str:
    """The type of a value of the table of episodes, in SQL."""
    if isinstance(value, list):
        return f"{_kind(value[0])}[]"
    return {str: "VARCHAR", int: "BIGINT"}.get(type(value), "DOUBLE")


def _together(stats: Sequence[dict[str, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Statistics of all episodes; quantiles are means, weighted by the number of rows, as LeRobot has it."""
    found: dict[str, dict[str, Any]] = {}
    for name in stats[0]:
        every = {kind: np.array([one[name][kind] for one in stats]) for kind in stats[0][name]}
        counts = every.pop("count")[:, 0].astype(np.float64)
        weights = (counts / counts.sum()).reshape(-1, *(1,) * (every["mean"].ndim - 1))
        mean = (weights * every["mean"]).sum(axis=0)
        spread = (weights * (every["std"] ** 2 + (every["mean"] - mean) ** 2)).sum(axis=0)
        joined = {"min": every["min"].min(axis=0), "max": every["max"].max(axis=0), "mean": mean, "std": np.sqrt(spread)}  # fmt: skip
        joined |= {kind: (weights * every[kind]).sum(axis=0) for kind in QUANTILES}
        found[name] = {kind: value.tolist() for kind, value in joined.items()}
        found[name]["count"] = [int(counts.sum())]
    return found
