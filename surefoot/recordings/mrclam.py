"""UTIAS multi-robot recordings (MRCLAM): odometry, landmarks and robots with barcodes, Vicon ground truth.

The range in the files is the depth along the optical axis. Odometry contains the commanded velocities, which the
robot follows about 0.2 s later. Measurements name the barcode, not the subject.

Source: Leung, Halpern, Barfoot, Liu, "The UTIAS multi-robot cooperative localization and mapping dataset",
International Journal of Robotics Research 30 (2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from perception.primitives import safe_input
from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError

ROBOTS = range(1, 6)
"""Subjects 1 to 5 are robots, the others landmarks."""

_MOST = 2**53  # whole numbers that a float can hold
BESIDE = 0.01  # ours: share of misread bearings that is left to the localiser


@dataclass(frozen=True)
class RobotLog:
    """Measurements of one robot.

    Args:
        odometry: (n, 3) stamp, s, forward velocity, m/s, turn rate, rad/s; each is valid until the next.
        stamps_s: (m,) stamps of the measurements, increasing.
        subjects: (m,) measured subject, 0 for an unknown barcode.
        seen: (m, 2) depth along the optical axis, m, and bearing, rad, left positive.
    """

    odometry: Float[np.ndarray, "n 3"]
    stamps_s: Float[np.ndarray, "m"]
    subjects: Int[np.ndarray, "m"]
    seen: Float[np.ndarray, "m 2"]


def read_landmarks(folder: Path) -> dict[int, tuple[float, float]]:
    """Position of each landmark by subject, m, world frame.

    Raises:
        RecordingError: The file is missing or damaged, or a landmark has two places.
    """
    rows = _table(folder / "Landmark_Groundtruth.dat", 5)
    check_unique(folder / "Landmark_Groundtruth.dat", "landmark", rows[:, 0])
    return {int(row[0]): (float(row[1]), float(row[2])) for row in rows}


def read_truth(folder: Path, robot: int) -> Float[np.ndarray, "n 4"]:
    """True (stamp, s, x, y, m, heading, rad, unwrapped) of a robot, from motion capture."""
    truth = _table(folder / f"Robot{robot}_Groundtruth.dat", 4)
    truth[:, 3] = np.unwrap(truth[:, 3])
    return truth


def read_robot(folder: Path, robot: int) -> RobotLog:
    """Odometry and measurements of a robot.

    Raises:
        RecordingError: A file is missing, a row is not finite or not in order of time, a barcode is no whole number or has
            two subjects, or bearings are none of a camera.
    """
    codes = _table(folder / "Barcodes.dat", 2)
    check_unique(folder / "Barcodes.dat", "barcode", codes[:, 1])
    subject = {int(code): int(number) for number, code in codes}
    seen = _table(folder / f"Robot{robot}_Measurement.dat", 4)
    subjects = np.array([subject.get(int(code), 0) for code in seen[:, 1]], np.int64)
    odometry = _table(folder / f"Robot{robot}_Odometry.dat", 3)
    for name, stamps in (("odometry", odometry[:, 0]), ("measurements", seen[:, 0])):
        back = np.flatnonzero(np.diff(stamps) < 0.0)
        if len(back):
            raise RecordingError(
                f"{folder}: {name} of robot {robot} go back in time at row {back[0] + 1}; sort them"
            )
    beside = np.flatnonzero(np.abs(seen[:, 3]) >= math.pi / 2.0)
    if len(beside) > BESIDE * len(seen):
        raise RecordingError(
            f"{folder}: bearing {seen[beside[0], 3]:g} in row {beside[0] + 1} of the measurements of robot {robot}, and in "
            f"{len(beside)} rows more than a quarter turn; expected rad, and depths of what is ahead of a camera. Convert "
            "degrees; give the ranges of a scanner all round without bearings, as a Plaza file (docs/recordings.md)"
        )
    return RobotLog(odometry, seen[:, 0].copy(), subjects, seen[:, 2:4].copy())


def check_unique(where: Path | str, what: str, numbers: np.ndarray) -> None:
    """Refuse a number that is not whole, or stands for two things, since each of its sightings may be of either."""
    odd = np.flatnonzero((numbers != np.rint(numbers)) | (np.abs(numbers) > _MOST))
    if len(odd):
        raise RecordingError(
            f"{where}: {what} {numbers[odd[0]]:g} in row {odd[0] + 1}; expected whole numbers"
        )
    found, counts = np.unique(numbers.astype(np.int64), return_counts=True)
    if np.any(counts > 1):
        raise RecordingError(
            f"{where}: {what} {found[counts > 1][0]} is listed {counts.max()} times; expected once: give each its own "
            f"number, or leave out all lines of {what}s that cannot be told apart"
        )


def _table(path: Path, columns: int) -> Float[np.ndarray, "n c"]:
    """Numbers of a file, gzipped or not."""
    packed = path.with_name(path.name + ".gz")
    if not path.exists() and not packed.exists():
        raise RecordingError(f"{path}: no such file, nor {packed.name}; is this an MRCLAM folder?")
    try:
        table = safe_input.table(path if path.exists() else packed)
    except UnreadableError as error:
        raise RecordingError(f"{path}: {error}; expected {columns} numbers per line") from error
    if table.shape[1] != columns or not np.all(np.isfinite(table)):
        raise RecordingError(
            f"{path}: {columns} finite numbers per line were expected, found {table.shape[1]} columns"
        )
    return table
