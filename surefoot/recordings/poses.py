"""Poses of recordings: TUM lines, 4x4 matrices, Redwood logs; and association by time.

Poses have a clock of their own. At the stamp of an image one is interpolated: a hand turns a camera by 50 deg/s, and thus by
.25 deg in the 5 ms to the nearest of 100 poses a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation, Slerp

from perception.primitives import safe_input
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.pose import Pose3
from perception.primitives.safe_input import UnreadableError

from .recording import FrameError

_NORM_TOLERANCE = 0.01  # ours: four printed digits leave 1e-4
_FLIP_Y = np.diag([1.0, -1.0, 1.0])
ASSOCIATION_S = 0.02  # TUM's associate.py
SPACING_S = 0.1  # ours: of poses between which one is interpolated
MOST_CANDIDATES = 50  # ours: of one stamp, on either side


def read_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Numbered lines of a text file, split into words; without comments (#) and empty lines.

    Raises:
        RecordingError: The file cannot be read, is not text, or has no lines.
    """
    lines = [
        (number, _plain(line).split())
        for number, line in enumerate(_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise RecordingError(f"{path}: has no lines of data; remove or complete it")
    return lines


def read_comments(path: Path) -> list[str]:
    """The comments of a text file, without #.

    Raises:
        RecordingError: The file cannot be read, or is not text.
    """
    lines = (line.strip() for line in _text(path).splitlines())
    return [line.lstrip("# ") for line in lines if line.startswith("#")]


def _text(path: Path) -> str:
    try:
        return safe_input.text(path)
    except UnreadableError as error:
        raise RecordingError(f"{path}: {error}; lines of numbers were expected") from error


def _plain(line: str) -> str:
    """A line without separators; beside semicolons a comma is that of a decimal."""
    return line.replace(",", ".").replace(";", " ") if ";" in line else line.replace(",", " ")


def numbers(path: Path, line: int, words: list[str], expected: int, meaning: str) -> list[float]:
    """The numbers of one line.

    Raises:
        RecordingError: Their count is wrong, or a word is not a number.
    """
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise RecordingError(
            f"{path}, line {line}: {str(error).split(': ')[-1]} is not a number; expected {meaning}"
        ) from error
    if len(values) != expected:
        raise RecordingError(
            f"{path}, line {line}: {len(values)} numbers, expected {expected}: {meaning}"
        )
    return values


def read_tum(
    path: Path,
) -> tuple[Float[np.ndarray, "n"], list[tuple[float, ...]]]:
    """Stamps, s, and rows (tx, ty, tz, qx, qy, qz, qw) as printed; the poses are not checked.

    Raises:
        RecordingError: A line does not have eight numbers.
    """
    stamps, rows = [], []
    for line, words in read_lines(path):
        values = numbers(path, line, words, 8, "timestamp tx ty tz qx qy qz qw")
        stamps.append(values[0])
        rows.append(tuple(values[1:]))
    return np.array(stamps), rows


def read_log(path: Path) -> list[Float[np.ndarray, "4 4"]]:
    """Matrices of a Redwood trajectory: a line of ids, then four rows.

    Raises:
        RecordingError: The number of lines is not a multiple of five.
    """
    lines = read_lines(path)
    if len(lines) % 5:
        raise RecordingError(
            f"{path}: {len(lines)} lines are not a multiple of 5 (ids, then 4 rows per pose); the file is truncated"
        )
    return [
        np.array([numbers(path, *lines[i + row], 4, "a row of a 4x4 pose") for row in range(1, 5)])
        for i in range(0, len(lines), 5)
    ]


def pose_of_row(row: tuple[float, ...]) -> Pose3:
    """A pose from (tx, ty, tz, qx, qy, qz, qw).

    Raises:
        FrameError: A value is not finite, or the quaternion does not have unit length.
    """
    if not all(math.isfinite(value) for value in row):
        raise FrameError("pose has a value that is not finite")
    norm = math.hypot(*row[3:])
    if abs(norm - 1.0) > _NORM_TOLERANCE:
        raise FrameError(f"pose is invalid: its quaternion has length {norm:.2f}, not 1")
    x, y, z, qx, qy, qz, qw = row
    return Pose3((x, y, z), (qx, qy, qz, qw))


def pose_of_matrix(matrix: Float[np.ndarray, "4 4"]) -> Pose3:
    """A pose from a homogeneous matrix.

    Raises:
        FrameError: A value is not finite, or the matrix is not a rigid transform.
    """
    try:
        return Pose3.from_matrix(matrix)
    except InputError as error:
        raise FrameError(str(error)) from error


def mirrored(pose: Pose3) -> Pose3:
    """A pose whose camera and world both have the y axis the other way, as renderings in left-handed axes."""
    return Pose3.from_rotation(_FLIP_Y @ pose.rotation @ _FLIP_Y, _FLIP_Y @ pose.position)


def poses_at(
    stamps: Float[np.ndarray, "n"],
    others: Float[np.ndarray, "m"],
    pose: Callable[[int], Pose3],
) -> list[Callable[[], Pose3] | None]:
    """Poses at the stamps of images: interpolated, or the nearest one within `ASSOCIATION_S`; None without one.

    Args:
        stamps: Of the images, s.
        others: Of the poses, s, in any order.
        pose: The pose of a number.
    """
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    found: list[Callable[[], Pose3] | None] = []
    for stamp in stamps:
        after = int(np.searchsorted(ordered, stamp))
        near = [k for k in (after - 1, after) if 0 <= k < len(ordered)]
        inside = len(near) == 2 and ordered[after] != stamp
        if inside and ordered[after] - ordered[after - 1] <= SPACING_S:
            share = float((stamp - ordered[after - 1]) / (ordered[after] - ordered[after - 1]))
            found.append(partial(_between, pose, int(order[after - 1]), int(order[after]), share))
            continue
        nearest = min(near, key=lambda k: abs(ordered[k] - stamp), default=None)
        usable = nearest is not None and abs(ordered[nearest] - stamp) <= ASSOCIATION_S
        found.append(partial(pose, int(order[nearest])) if usable else None)
    return found


def _between(pose: Callable[[int], Pose3], first: int, second: int, share: float) -> Pose3:
    return between(pose(first), pose(second), share)


def between(first: Pose3, second: Pose3, share: float) -> Pose3:
    """The pose at a share of the way from one to another: along a line, turning at an even rate."""
    ends = Rotation.from_matrix(np.stack([first.rotation, second.rotation]))
    turned = Slerp([0.0, 1.0], ends)(share)
    place = (1.0 - share) * first.position + share * second.position
    return Pose3.from_rotation(turned.as_matrix(), place)


def associate(
    stamps: Float[np.ndarray, "n"],
    others: Float[np.ndarray, "m"],
    max_s: float = ASSOCIATION_S,
) -> Int[np.ndarray, "n"]:
    """Match stamps: for each stamp the index of its match among the others, -1 without one.

    The closest pairs are matched first, each stamp once, none further apart than `max_s`, s. Of more than
    `MOST_CANDIDATES` on either side of a stamp the farther ones do not count.

    Source: TUM RGB-D benchmark, associate.py.
    """
    order = np.argsort(others, kind="stable")
    nearest = np.searchsorted(others[order], stamps)
    first = np.searchsorted(others[order], stamps - max_s, side="left")
    last = np.searchsorted(others[order], stamps + max_s, side="right")
    first = np.maximum(first, nearest - MOST_CANDIDATES)
    last = np.minimum(last, nearest + MOST_CANDIDATES)
    pairs = [
        (abs(float(stamps[i] - others[j])), i, int(j))
        for i in range(len(stamps))
        for j in order[first[i] : last[i]]
    ]
    match = np.full(len(stamps), -1, dtype=np.int64)
    taken: set[int] = set()
    for _, i, j in sorted(pairs):
        if match[i] < 0 and j not in taken:
            match[i] = j
            taken.add(j)
    return match
