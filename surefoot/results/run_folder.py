"""A run folder: all files that one run writes, in formats that other tools open (docs/outputs.md lists them).

Each file is written under a temporary name in the same folder and then renamed, so a reader always finds
either a complete file or none, even if the run was killed. A folder that surefoot did not create is never
written to. A run that is repeated into its own folder first deletes the results of the earlier run.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from mapping.io.atomic_write import PART
from perception.primitives import safe_input
from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.gaussian import Gaussian
from perception.primitives.safe_input import UnreadableError

from ..words import printable
from . import run_json, run_lock
from .formats import TUM_HEADER, cell, parse_json_lines, plain_json, refuse, tum_line
from .tables import Table, Trajectory, read_table, read_tum

MARK = ".surefoot-run"
RECORDING = "recording.mcap"
BATCH_TABLE = "summary.csv"  # of a folder of runs, one row per recording
COVARIANCE_HEADER = (
    "stamp_s", "x_m", "y_m", "yaw_rad", "P_xx", "P_xy", "P_xyaw", "P_yy", "P_yyaw", "P_yawyaw",
)  # fmt: skip
ERRORS = "aligned_errors.csv"
SPACE_HEADER = (
    "stamp_s",
    *(f"{kind}_{i}{j}" for kind in ("start", "aligned") for i in range(6) for j in range(i, 6)),
)
SIMULATION, PLAYBACK, MAP, PANORAMA, MONOCULAR, BATCH = (
    "simulation", "recording", "map", "panorama", "monocular", "batch",
)  # fmt: skip
_OUTPUTS = (  # files and folders that a repeated run deletes before it starts
    "summary.json", "tables/runs.parquet", "tables", "metrics.json", "report.html", "replay.html", "config.toml", "trajectory.txt",
    "trajectory_covariance.csv", "space_covariance.csv", ERRORS, "errors.csv", "tracking.csv", "map.yaml", "map.pgm", "cloud.ply",
    "map_probability.yaml", "map_probability.png", "map_layers.tif", "rooms.json",
    "obstacles.json", "floor.csv", "timing.csv", "commands.csv", "innovations.csv", "terrain.npz", "states.csv",
    "status.csv", "odometry.csv", "sightings.csv", "smoothed.txt", "smoothed_covariance.csv", "views.json", "mesh.ply",
    "graph.g2o", "layers.npz", "panorama.json", "panorama.npz", "panorama.ply", "panorama_obstacles.png",
    "ground.json", "footsteps.csv", "heights.csv", "monocular.json", "sessions.json", "changes.json", "figures", "views", "truth", "estimates.mcap", "film.webp", "film.json",
)  # fmt: skip
_OUTPUT_PATTERNS = (f"{PART}*", "stages-*.png", ".checkpoint*", "part-[0-9]*")


@dataclass(frozen=True)
class RunFolder:
    """One run on disk; `root` is its folder."""

    root: Path

    @staticmethod
    def create(path: Path | None = None, name: str = "run", reads: Path | None = None) -> RunFolder:
        """Make the folder of a new run, or clear that of an earlier run.

        A recording in the folder of an earlier run is kept as recording.previous.mcap, further ones as
        recording.previous-2.mcap and so on.

        Args:
            path: Folder to create; None takes the first free runs/<name>-<n> in the working directory.
            name: Name of the run, used if path is None.
            reads: The recording that the run reads; the folder must not contain it.

        Raises:
            OutputError: The path holds other files or the recording that is read, or cannot be written.
        """
        if path is None:
            return RunFolder.held(_next_free(Path("runs"), name))
        if reads is not None and _within(reads, path):
            raise OutputError(
                f"output folder {path} holds the recording that is read ({reads}); choose another --out"
            )
        if path.exists() and not path.is_dir():
            raise OutputError(f"output folder {path} is a file; choose another --out")
        try:
            taken = path.is_dir() and any(path.iterdir())
            if taken and not (path / MARK).is_file():
                raise OutputError(
                    f"output folder {path} is not empty and not a run of surefoot; "
                    "choose another --out, or empty it"
                )
            path.mkdir(parents=True, exist_ok=True)
            (path / MARK).write_text("1\n", encoding="utf-8")
            folder = RunFolder.held(path)
            if taken:
                _clear(path)
        except OSError as error:
            refuse(error, path)
        return folder

    @staticmethod
    def held(path: Path) -> RunFolder:
        """A run folder that exists, for the one process that writes into it.

        Raises:
            OutputError: Another process writes into it, or it is no run folder.
        """
        folder = RunFolder(path)
        if not folder.has(MARK):
            raise OutputError(
                f"{path} is not the folder of a run of surefoot; choose another --out"
            )
        return folder.hold()

    def hold(self) -> RunFolder:
        """Keep other processes from writing into the folder for as long as this object is there; returns it.

        Raises:
            OutputError: Another process writes into it.
        """
        run_lock.hold(self, self.root)
        return self

    def sweep(self, below: str = "") -> None:
        """Delete what writers that were killed have left unfinished, in the folder or in one below it."""
        for left in (self.root / below).glob(f"{PART}*"):
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)

    @staticmethod
    def open(path: Path) -> RunFolder:
        """The folder of an earlier run, complete or interrupted, or of a batch of runs.

        Raises:
            InputError: There is no such folder, or it holds no results.
        """
        if not path.is_dir():
            what = "is a file, not the folder of a run" if path.exists() else "does not exist"
            raise InputError(
                f"run folder {path} {what}; expected the output of an earlier command, such as `surefoot simulate` or `map`"
            )
        run = RunFolder(path)
        results = ("summary.json", "trajectory.txt", "panorama.json", "monocular.json", BATCH_TABLE)
        if any(run.has(name) for name in results) or run.unfinished():
            return run
        inside = sorted(child.parent.name for child in path.glob("*/summary.json"))
        cause = "expected summary.json and trajectory.txt in it; is this the right folder?"
        if run.has(MARK):
            cause = "it was interrupted before its first frame; run it again"
        elif inside:
            cause = (
                f"but the runs in it do ({', '.join(inside[:6])}); give one of them, or "
                f"`surefoot batch evaluate {path} --out OUT` for all"
            )
        raise InputError(f"run folder {path} holds no results: {cause}")

    @property
    def kind(self) -> str:
        """One of "simulation", "recording", "map", "panorama", "monocular" and "batch".

        Runs of older versions do not record their kind; their files show it.
        """
        named = str((self.read_json("summary.json") or {}).get("kind", ""))
        if named in (SIMULATION, MAP, PANORAMA, MONOCULAR):
            return named
        if self.has("panorama.json"):
            return PANORAMA
        if self.has("monocular.json"):
            return MONOCULAR
        if self.has("layers.npz"):
            return MAP
        if self.has(BATCH_TABLE) and not named:
            return BATCH
        return PLAYBACK if named or self.read_csv("commands.csv") is None else SIMULATION

    @property
    def interrupted(self) -> bool:
        """Whether the run was stopped before its end, by Ctrl-C or a kill."""
        if self.has("summary.json"):
            return bool((self.read_json("summary.json") or {}).get("interrupted", False))
        return bool(self.unfinished())

    def unfinished(self) -> list[Path]:
        """Tables under their temporary names, which a killed run leaves."""
        return sorted(
            part
            for ending in ("csv", "json")
            for part in self.root.glob(f"{PART}*.{ending}")
            if part.is_file()
        )

    def stages(self) -> list[tuple[int, Path]]:
        """Frame and picture of every stages-NNNNNN.png of a monocular run, in order."""
        found = (
            (safe_input.whole(path.stem.removeprefix("stages-")), path)
            for path in self.root.glob("stages-*.png")
            if path.is_file()
        )
        return sorted((number, path) for number, path in found if number is not None)

    def path(self, name: str) -> Path:
        """Path of a file of this run; "/" separates folders."""
        place = self.root / name
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise OutputError(f"file name {name!r} leads out of the run folder; give a plain name")
        return place

    def has(self, name: str) -> bool:
        """Whether the run has a complete file of this name."""
        return self.path(name).is_file()

    @contextlib.contextmanager
    def staged(self) -> Iterator[Path]:
        """A temporary folder whose files move into the run folder when the context ends.

        After an exception nothing of it remains. Use it for writers that open files by themselves (clouds,
        maps, figures).

        Raises:
            OutputError: The disk is full or the folder is read-only.
        """
        stage = self.root / f"{PART}{os.getpid()}-{os.urandom(4).hex()}"
        try:
            stage.mkdir()
            yield stage
            for part in sorted(p for p in stage.rglob("*") if p.is_file()):
                place = self.root / part.relative_to(stage)
                place.parent.mkdir(parents=True, exist_ok=True)
                os.replace(part, place)
        except OSError as error:
            refuse(error, self.root)
        finally:
            shutil.rmtree(stage, ignore_errors=True)

    def write_bytes(self, name: str, data: bytes) -> Path:
        """Write one file atomically.

        Raises:
            OutputError: The disk is full or the folder is read-only.
        """
        place = self.path(name)
        with self.staged() as stage:
            part = stage / name
            part.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(data)
        return place

    def write_text(self, name: str, text: str) -> Path:
        """Write one UTF-8 text file atomically."""
        return self.write_bytes(name, printable(text).encode())

    def write_json(self, name: str, value: Any) -> Path:
        """Write standard JSON; NaN and infinity become null."""
        return self.write_text(
            name, json.dumps(plain_json(value), indent=1, allow_nan=False) + "\n"
        )

    def write_csv(self, name: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
        """Write a table; floats are written without loss, None and NaN as empty cells."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            if len(row) != len(header):
                raise ValueError(f"{name}: a row of {len(row)} under a header of {len(header)}")
            writer.writerow([cell(value) for value in row])
        return self.write_text(name, text.getvalue())

    def write_trajectory(
        self, name: str, poses: Sequence[tuple[float, float, float, float, float]]
    ) -> Path:
        """Write upright poses as TUM text: stamp tx ty tz qx qy qz qw.

        Args:
            name: File name.
            poses: (stamp in s, x, y, z in m, yaw in rad) of each pose.
        """
        return self.write_text(name, f"{TUM_HEADER}\n" + "".join(tum_line(*pose) for pose in poses))

    def write_planar_trajectory(self) -> None:
        """Convert trajectory_covariance.csv to trajectory.txt (TUM text), line by line."""
        part = self.root / f"{PART}trajectory.txt"
        try:
            with (
                self.path("trajectory_covariance.csv").open(encoding="utf-8", newline="") as table,
                part.open("w", encoding="utf-8") as text,
            ):
                text.write(f"{TUM_HEADER}\n")
                for row in csv.DictReader(table):
                    stamp, x, y, yaw = (float(row[name]) for name in COVARIANCE_HEADER[:4])
                    text.write(tum_line(stamp, x, y, 0.0, yaw))
            os.replace(part, self.path("trajectory.txt"))
        except OSError as error:
            refuse(error, self.root)

    def adopt_truth(self, recording: Path) -> bool:
        """Copy the ground truth of a recording: the folder truth/ inside it or beside it.

        Args:
            recording: File or folder of the recording.

        Returns:
            Whether there was any.
        """
        beside = (recording if recording.is_dir() else recording.parent) / "truth"
        if not beside.is_dir() or beside.resolve() == self.path("truth").resolve():
            return False
        for source in sorted(p for p in beside.rglob("*") if p.is_file()):
            self.write_bytes(f"truth/{source.relative_to(beside).as_posix()}", source.read_bytes())
        return True

    def read_text(self, name: str) -> str | None:
        """A text file of the run; None if there is none that can be read."""
        try:
            return safe_input.text(self.path(name))
        except UnreadableError:
            return None

    def read_json(self, name: str) -> Any | None:
        """Content of a JSON file of the run that `run_json` knows; None if there is no such file.

        An unfinished list of a killed run (obstacles.json) is read as far as it goes.

        Raises:
            RecordingError: The file is not JSON, or of another shape.
        """
        part = self.root / f"{PART}{name}"
        if not self.has(name) and part.is_file():
            return {"tracks": parse_json_lines(part, run_json.TRACK), "footprints": []}
        if not self.has(name):
            return None
        try:
            found = safe_input.json(safe_input.text(self.path(name)))
            run_json.check(found, run_json.SHAPES[name])
        except UnreadableError as error:
            raise RecordingError(f"{self.path(name)} {error}; make the run again") from error
        return found

    def read_csv(self, name: str) -> Table | None:
        """A table of the run; None if it is absent or has no rows.

        The unfinished table of a killed run is read as far as it has complete rows.
        """
        part = self.root / f"{PART}{name}"
        table = None
        if self.has(name):
            table = read_table(self.path(name))
        elif part.is_file():
            table = read_table(part, unfinished=True)
        return table if table is not None and len(table) else None

    def read_trajectory(self, name: str) -> Trajectory | None:
        """A TUM file of the run; None if there is no such file.

        Of a killed run, trajectory.txt is taken from the unfinished trajectory_covariance.csv.
        """
        if self.has(name):
            return read_tum(self.path(name))
        if name != "trajectory.txt" or self.has("trajectory_covariance.csv"):
            return None
        table = self.read_csv("trajectory_covariance.csv")
        return None if table is None else Trajectory.planar(table.matrix(*COVARIANCE_HEADER[:4]))

    def sessions(self, stamps: Float[np.ndarray, "n"]) -> dict[int, Bool[np.ndarray, "n"]]:
        """Which stamps belong to each session of a merged map that has any, by number; of another run all to one."""
        content = self.read_json("sessions.json")
        if content is None:
            return {1: np.ones(len(stamps), bool)}
        here = [one for one in content["sessions"] if one["part"] == content["part"]]
        spans = {one["session"]: (one["from_s"], one["to_s"]) for one in here}
        each = {k: (stamps >= begin) & (stamps <= end) for k, (begin, end) in spans.items()}
        return {k: mine for k, mine in each.items() if mine.any()}


def estimate_row(stamp_s: float, pose: Gaussian) -> tuple[float, ...]:
    """One row of `COVARIANCE_HEADER`: stamp, mean, upper triangle of the covariance."""
    return (stamp_s, *pose.mean.tolist(), *pose.covariance[np.triu_indices(3)].tolist())


def _next_free(parent: Path, name: str) -> Path:
    """Create parent/<name>-<n> for the first free n; safe while other processes do the same."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "run"
    try:
        parent.mkdir(parents=True, exist_ok=True)
        number = 1
        while True:
            path = parent / f"{plain}-{number}"
            try:
                path.mkdir()
            except FileExistsError:
                number += 1
                continue
            (path / MARK).write_text("1\n", encoding="utf-8")
            return path
    except OSError as error:
        refuse(error, parent)


def _clear(path: Path) -> None:
    """Delete the outputs of an earlier run, summary first; files of the user stay."""
    found = [path / name for name in _OUTPUTS]
    found += [part for pattern in _OUTPUT_PATTERNS for part in sorted(path.glob(pattern))]
    for place in found:
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        else:
            place.unlink(missing_ok=True)
    if (path / RECORDING).is_file():
        names = (
            "recording.previous.mcap",
            *(f"recording.previous-{k}.mcap" for k in range(2, 10_000)),
        )
        os.replace(path / RECORDING, next(p for p in map(path.joinpath, names) if not p.exists()))


def _within(inner: Path, outer: Path) -> bool:
    inner, outer = inner.resolve(), outer.resolve()
    return inner == outer or outer in inner.parents
