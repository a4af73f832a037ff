"""A run folder: everything one run leaves behind, in files that other tools open.

Every file is written under a temporary name beside its place and then renamed, so that whoever looks,
even after a kill, finds either a complete file or none. A folder that was not made here is never written
into; a run that is repeated into its own folder first loses what the earlier one said, so that results
of two runs never lie side by side.
"""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import json
import math
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from perception.primitives.errors import InputError, OutputError, RecordingError
from perception.primitives.gaussian import Gaussian

from .tables import Table, Trajectory, read_table, read_tum

MARK = ".surefoot-run"
RECORDING = "recording.mcap"
COVARIANCE_HEADER = (
    "stamp_s", "x_m", "y_m", "yaw_rad", "P_xx", "P_xy", "P_xyaw", "P_yy", "P_yyaw", "P_yawyaw",
)  # fmt: skip
ERRORS = "aligned_errors.csv"
SPACE_HEADER = (
    "stamp_s",
    *(f"{kind}_{i}{j}" for kind in ("start", "aligned") for i in range(6) for j in range(i, 6)),
)
_PART = ".part-"  # begins the name of everything unfinished
_OURS = (  # what a repeated run takes away before it starts
    "summary.json", "metrics.json", "report.html", "config.toml", "trajectory.txt",
    "trajectory_covariance.csv", "space_covariance.csv", ERRORS, "map.yaml", "map.pgm", "cloud.ply", "obstacles.json", "floor.csv",
    "timing.csv", "commands.csv", "innovations.csv", "terrain.npz", "odometry.csv", "sightings.csv",
    "smoothed.txt", "smoothed_covariance.csv", "views.json", "mesh.ply", "graph.g2o", "layers.npz",
    "figures", "views", "truth",
)  # fmt: skip


@dataclass(frozen=True)
class RunFolder:
    """One run on disk; `root` is its folder."""

    root: Path

    @staticmethod
    def create(path: Path | None = None, name: str = "run", reads: Path | None = None) -> RunFolder:
        """Make the folder of a new run, or clear that of an earlier one.

        A recording that lies in the folder of an earlier run is kept as recording.previous.mcap.

        Args:
            path: Where; None takes the first free runs/<name>-<n> below the working folder.
            name: Of the run, for that.
            reads: The recording that the run will read, so that it is not overwritten.

        Raises:
            OutputError: The path is taken by something else, holds what the run reads, or cannot be
                written.
        """
        if path is None:
            return RunFolder(_next_free(Path("runs"), name))
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
            if taken:
                _clear(path)
            (path / MARK).write_text("1\n", encoding="utf-8")
        except OSError as error:
            refuse(error, path)
        return RunFolder(path)

    @staticmethod
    def open(path: Path) -> RunFolder:
        """The folder of a run that ended, to look at it.

        Raises:
            InputError: There is none, or its run never came to an end.
        """
        if not path.is_dir():
            what = "is a file, not the folder of a run" if path.exists() else "does not exist"
            raise InputError(f"run folder {path} {what}; `surefoot simulate` makes one")
        if not (path / "trajectory.txt").is_file() and not (path / "summary.json").is_file():
            cause = (
                "its run was interrupted; run it again"
                if (path / MARK).is_file()
                else "expected summary.json and trajectory.txt in it; is this the right folder?"
            )
            raise InputError(f"run folder {path} holds no results: {cause}")
        return RunFolder(path)

    def path(self, name: str) -> Path:
        """Where the file of that name (with / between folders) is or will be."""
        place = self.root / name
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise OutputError(f"file name {name!r} leads out of the run folder; give a plain name")
        return place

    def has(self, name: str) -> bool:
        """Whether the run has a file of that name."""
        return self.path(name).is_file()

    @contextlib.contextmanager
    def staged(self) -> Iterator[Path]:
        """An empty folder to write files into, under their own names; each moves to its place at the end.

        If anything goes wrong inside, nothing of it remains. For writers that open files by themselves
        (clouds, maps, figures).

        Raises:
            OutputError: Disk full, folder read-only.
        """
        stage = self.root / f"{_PART}{os.getpid()}-{os.urandom(4).hex()}"
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
        """Write one file, whole or not at all.

        Raises:
            OutputError: Disk full, folder read-only.
        """
        place = self.path(name)
        with self.staged() as stage:
            part = stage / name
            part.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(data)
        return place

    def write_text(self, name: str, text: str) -> Path:
        """Write one text file, UTF-8, whole or not at all."""
        return self.write_bytes(name, text.encode())

    def write_json(self, name: str, value: Any) -> Path:
        """Write JSON as the standard has it: what is not a finite number becomes null."""
        return self.write_text(
            name, json.dumps(plain_json(value), indent=1, allow_nan=False) + "\n"
        )

    def write_csv(self, name: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
        """Write a table; numbers so that reading gives the same bits, None and NaN as empty cells."""
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
            name: Of the file.
            poses: (stamp in s, x, y, z in m, yaw in rad) each.
        """
        return self.write_text(
            name, "# stamp tx ty tz qx qy qz qw\n" + "".join(_tum_line(*pose) for pose in poses)
        )

    def write_estimates(self, poses: Sequence[tuple[float, Gaussian]]) -> None:
        """Write where the body believed to be: trajectory.txt and trajectory_covariance.csv, if anywhere.

        Args:
            poses: (stamp in s, Gaussian over x, y in m and yaw in rad) each.
        """
        if poses:
            rows = [estimate_row(stamp, pose) for stamp, pose in poses]
            self.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, rows)
            self.write_way()

    def write_way(self) -> None:
        """Write trajectory.txt from trajectory_covariance.csv, line by line, for tools that read TUM text."""
        part = self.root / f"{_PART}trajectory.txt"
        try:
            with (
                self.path("trajectory_covariance.csv").open(encoding="utf-8", newline="") as table,
                part.open("w", encoding="utf-8") as text,
            ):
                text.write("# stamp tx ty tz qx qy qz qw\n")
                for row in csv.DictReader(table):
                    stamp, x, y, yaw = (float(row[name]) for name in COVARIANCE_HEADER[:4])
                    text.write(_tum_line(stamp, x, y, 0.0, yaw))
            os.replace(part, self.path("trajectory.txt"))
        except OSError as error:
            refuse(error, self.root)

    def adopt_truth(self, recording: Path) -> bool:
        """Copy the truth that lies beside a recording (or inside its folder), if there is any.

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

    def read_json(self, name: str) -> Any | None:
        """What a JSON file of the run says; None if the run has none of that name.

        Raises:
            RecordingError: It is not JSON.
        """
        if not self.has(name):
            return None
        try:
            return json.loads(self.path(name).read_text(encoding="utf-8"))
        except ValueError as error:
            raise RecordingError(
                f"{self.path(name)} is not JSON ({error}); make the run again"
            ) from error

    def read_csv(self, name: str) -> Table | None:
        """A table of the run; None if the run has none of that name, or an empty one."""
        table = read_table(self.path(name)) if self.has(name) else None
        return table if table is not None and len(table) else None

    def read_trajectory(self, name: str) -> Trajectory | None:
        """A TUM file of the run; None if the run has none of that name."""
        return read_tum(self.path(name)) if self.has(name) else None


def _tum_line(stamp_s: float, x: float, y: float, z: float, yaw: float) -> str:
    numbers = (stamp_s, x, y, z, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return " ".join(repr(float(number)) for number in numbers) + "\n"


def estimate_row(stamp_s: float, pose: Gaussian) -> tuple[float, ...]:
    """A row under `COVARIANCE_HEADER`: stamp, mean, upper triangle of the covariance."""
    return (stamp_s, *pose.mean.tolist(), *pose.covariance[np.triu_indices(3)].tolist())


def _next_free(parent: Path, name: str) -> Path:
    """Make parent/<name>-<n> for the first n that is free, also while others do the same."""
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
    """Take away what an earlier run wrote, its verdict first; what others put there stays."""
    for name in _OURS:
        place = path / name
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        else:
            place.unlink(missing_ok=True)
    for part in sorted(path.glob(f"{_PART}*")):
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)
    for pattern in (
        ".map-*.*",
        ".cloud-*.ply",
        ".checkpoint*.pickle",
    ):  # what the writers of mapping left when killed
        for part in sorted(path.glob(pattern)):
            part.unlink(missing_ok=True)
    if (path / RECORDING).is_file():
        os.replace(path / RECORDING, path / "recording.previous.mcap")


def _within(inner: Path, outer: Path) -> bool:
    inner, outer = inner.resolve(), outer.resolve()
    return inner == outer or outer in inner.parents


def refuse(error: OSError, path: Path) -> NoReturn:
    """Say in one line why nothing can be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        reason = "the disk is full; free some space or choose another --out"
    elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        reason = "the folder is read-only for you; choose another --out or change its permissions"
    elif error.errno == errno.ENOTDIR:
        reason = "a part of its path is a file; choose another --out"
    else:
        reason = f"{error.strerror or error}; choose another --out"
    raise OutputError(f"cannot write into {error.filename or path}: {reason}") from error


def cell(value: object) -> str:
    """A value as a CSV cell; reading a number gives the same bits."""
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return "" if math.isnan(value) else repr(float(value))
    return str(value)


def plain_json(value: Any) -> Any:
    """Standard JSON values from ours and NumPy's."""
    if isinstance(value, dict):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_json(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, np.generic):
        return plain_json(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value
