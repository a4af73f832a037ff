"""Readers of tables (CSV) and trajectories (TUM text)."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.primitives import safe_input
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.safe_input import MissingError, UnreadableError

FARTHEST_M = 1e9  # ours: of a pose from the origin; beyond, squares of errors lose all digits


@dataclass(frozen=True)
class Table:
    """Columns of text by name; error messages name `source`."""

    source: str
    columns: dict[str, list[str]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), []))

    def words(self, name: str) -> list[str]:
        """A column as text."""
        if name not in self.columns:
            raise RecordingError(
                f"{self.source} has no column {name!r} (it has {', '.join(self.columns)}); "
                "was it written by another version?"
            )
        return self.columns[name]

    def numbers(self, name: str) -> Float[np.ndarray, "n"]:
        """A column as numbers, NaN where a cell is empty."""
        values = []
        for row, word in enumerate(self.words(name)):
            try:
                values.append(float(word) if word else np.nan)
            except ValueError:
                raise RecordingError(
                    f"{self.source}, row {row + 2}, column {name}: {word!r} is not a number; correct the file"
                ) from None
        return np.array(values)

    def matrix(self, *names: str) -> Float[np.ndarray, "n k"]:
        """Several columns as numbers, side by side."""
        return np.stack([self.numbers(name) for name in names], axis=-1)


@dataclass(frozen=True)
class Trajectory:
    """Poses over time.

    Args:
        stamps: (n,), s, increasing.
        positions: (n, 3), m.
        quats_xyzw: (n, 4), unit length.
    """

    stamps: Float[np.ndarray, "n"]
    positions: Float[np.ndarray, "n 3"]
    quats_xyzw: Float[np.ndarray, "n 4"]

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def yaws(self) -> Float[np.ndarray, "n"]:
        """Heading of the x axis in the horizontal plane, rad."""
        x, y, z, w = self.quats_xyzw.T
        return np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))

    @staticmethod
    def planar(rows: Float[np.ndarray, "n 4"]) -> Trajectory:
        """Upright poses on the floor from rows of (stamp, x, y, yaw)."""
        zero = np.zeros(len(rows))
        half = rows[:, 3] / 2
        quats = np.column_stack([zero, zero, np.sin(half), np.cos(half)])
        return Trajectory(rows[:, 0], np.column_stack([rows[:, 1:3], zero]), quats)


def read_table(path: Path, unfinished: bool = False) -> Table:
    """Read a CSV file with a header line.

    Args:
        path: The file.
        unfinished: The file is the table of a killed run; an incomplete last line is dropped.

    Raises:
        InputError: The file cannot be opened.
        RecordingError: It has no header, or a row has too few or too many cells.
    """
    lines = text_lines(path)
    if unfinished and lines and not path.read_bytes().endswith(b"\n"):
        lines.pop()
    rows = list(csv.reader(lines))
    if not rows and unfinished:
        return Table(str(path), {})  # killed before the first block was written
    if not rows:
        raise RecordingError(f"{path} is empty; expected a header line")
    header, *body = rows
    for number, row in enumerate(body, start=2):
        if len(row) != len(header):
            raise RecordingError(
                f"{path}, line {number}: {len(row)} cells, expected {len(header)}; is it cut off?"
            )
    return Table(str(path), {name: [row[i] for row in body] for i, name in enumerate(header)})


def read_tum(path: Path) -> Trajectory:
    """Read a trajectory in TUM text (stamp tx ty tz qx qy qz qw), also gzipped.

    Poses are returned in order of time; of two with the same stamp the first is kept.

    Raises:
        InputError: The file cannot be opened.
        RecordingError: A line is not eight numbers, a pose is impossible (`is_pose`), or there are no poses.
    """
    rows = []
    for number, line in enumerate(text_lines(path), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != 8 or not math.isfinite(row[0]) or not is_pose(row[1:4], row[4:]):
            raise RecordingError(
                f"{path}, line {number}: {line.strip()!r} is not a pose; expected eight finite numbers: "
                "stamp tx ty tz qx qy qz qw, with a quaternion of length 1"
            )
        rows.append(row)
    if not rows:
        raise RecordingError(f"{path} holds no poses; expected lines of stamp tx ty tz qx qy qz qw")
    table = np.array(rows)
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    quats = table[:, 4:] / np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    return Trajectory(table[:, 0], table[:, 1:4], quats)


def is_pose(position_m: Sequence[float], quat_xyzw: Sequence[float]) -> bool:
    """Whether the numbers can be a pose: within `FARTHEST_M`, and a quaternion that can be scaled to length 1."""
    near = bool(np.all(np.abs(position_m) <= FARTHEST_M))  # NaN is not
    return near and 1e-6 < math.hypot(*quat_xyzw) < 1e6


def numbers_of(words: list[str]) -> list[float]:
    """The words as numbers; empty if one of them is none."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


def text_lines(path: Path) -> list[str]:
    """The lines of a text file, also gzipped.

    Raises:
        InputError: It does not exist, or is not text.
    """
    try:
        return safe_input.text(path).splitlines()
    except MissingError:
        raise InputError(f"{path} does not exist; check the path") from None
    except UnreadableError as error:
        raise InputError(f"{path} {error}; a text file was expected") from error
