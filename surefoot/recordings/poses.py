"""Poses of recordings: lines of numbers, 4x4 matrices, Redwood logs; and association by time.

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
FORMS = {
    7: "tx ty tz qx qy qz qw",
    12: "the first three rows of a 4x4 matrix, as KITTI has them",
    16: "a 4x4 matrix, row by row",
}
"""What the numbers of one pose are, by their count."""
_STAMPED = {8: "timestamp tx ty tz qx qy qz qw"}
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


def read_matrix(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Read a matrix of numbers, one row per line.

    Raises:
        RecordingError: The shape is wrong, or a word is not a number.
    """
    rows, columns = shape
    lines = read_lines(path)
    if len(lines) != rows:
        raise RecordingError(f"{path}: {len(lines)} rows; a {rows}x{columns} matrix was expected")
    meaning = f"a row of a {rows}x{columns} matrix"
    return np.array([numbers(path, line, words, columns, meaning) for line, words in lines])


def read_tum(
    path: Path,
) -> tuple[Float[np.ndarray, "n"], list[tuple[float, ...]]]:
    """Stamps, s, and rows (tx, ty, tz, qx, qy, qz, qw) as printed; the poses are not checked.

    Raises:
        RecordingError: A line does not have eight numbers.
    """
    stamps, rows = [], []
    for line, words in read_lines(path):
        values = numbers(path, line, words, 8, _STAMPED[8])
        stamps.append(values[0])
        rows.append(tuple(values[1:]))
    return np.array(stamps), rows


def read_trajectory(
    path: Path,
) -> tuple[Float[np.ndarray, "n"] | None, list[tuple[float, ...]]]:
    """Poses, one a line, as printed; they are not checked. The count of numbers in the first line tells what they are.

    Returns:
        Stamps, s, or None if the lines have no stamps; and the numbers of each pose, see `FORMS`.

    Raises:
        RecordingError: The first line has another count of numbers, or a later line another one than the first.
    """
    lines = read_lines(path)
    line, words = lines[0]
    count = len(words)
    if count in _STAMPED:
        return read_tum(path)
    _check_count(f"{path}, line {line}", count, _STAMPED | FORMS)
    return None, [tuple(numbers(path, line, words, count, FORMS[count])) for line, words in lines]


def read_pose(path: Path) -> tuple[float, ...]:
    """The numbers of a file with one pose, in one line or several, see `FORMS`.

    Raises:
        RecordingError: The count is another one, or a word is not a number.
    """
    found: list[float] = []
    for line, words in read_lines(path):
        found += numbers(path, line, words, len(words), "the numbers of a pose")
    _check_count(str(path), len(found), FORMS)
    return tuple(found)


def _check_count(where: str, count: int, forms: dict[int, str]) -> None:
    if count not in forms:
        known = "; ".join(f"{number}: {meaning}" for number, meaning in sorted(forms.items()))
        raise RecordingError(f"{where}: {count} numbers; expected {known}")


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


def is_finite(values: tuple[float, ...]) -> bool:
    """Whether all numbers of a pose are finite; where tracking was lost, trajectories have -inf or NaN."""
    return all(map(math.isfinite, values))


def pose_of(values: tuple[float, ...]) -> Pose3 | None:
    """A pose from its 7, 12 or 16 numbers, see `FORMS`; None if they are not finite, since tracking was lost.

    Raises:
        FrameError: The quaternion does not have unit length, or the matrix is not a rigid transform.
    """
    if not is_finite(values):
        return None
    if len(values) == 7:
        return pose_of_row(values)
    return pose_of_matrix(np.array([*values, 0.0, 0.0, 0.0, 1.0][:16]).reshape(4, 4))


def pose_in(path: Path) -> Pose3 | None:
    """The pose in a file of its own; None as of `pose_of`.

    Raises:
        FrameError: The file does not hold one pose, or it is invalid.
    """
    try:
        values = read_pose(path)
    except RecordingError as error:
        raise FrameError(f"pose file{str(error).removeprefix(str(path))}") from error
    return pose_of(values)


def is_given(pose: Callable[[], Pose3 | None] | None) -> bool:
    """Whether an image has a pose that can be used."""
    try:
        return pose is not None and pose() is not None
    except FrameError:
        return False


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
