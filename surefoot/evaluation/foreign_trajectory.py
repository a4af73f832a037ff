"""Trajectories as other systems write them: TUM, KITTI and EuRoC, recognised by what the file holds.

| format | a line | stamps |
|---|---|---|
| TUM | stamp tx ty tz qx qy qz qw | s; other units are recognised (`seconds`) |
| KITTI | the 12 numbers of a 3x4 matrix, row by row, or the 16 of a 4x4 one | none: the number of the line |
| KITTI with stamps | the same after a stamp | as of TUM |
| EuRoC | stamp, tx, ty, tz, qw, qx, qy, qz and further columns, with commas | ns |
| positions | stamp x y z, or as a header of four names says: without rotations | as of TUM |
| g2o | the vertices of a pose graph, in the order of their numbers | none |
| named columns | a header names the columns of stamp, position and quaternion, as of ROS topics and OpenVINS | as of TUM |

Where a header names the columns of the quaternion, names count and not the order. A line with a stamp whose pose is not
finite is one at which the system was lost: it is counted and has no pose.

Source: Sturm et al. 2012 (TUM), Geiger et al. 2012 (KITTI), Burri et al. 2016 (EuRoC), Kümmerle et al. 2011 (g2o).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError

from ..results.tables import FARTHEST_M, Trajectory, numbers_of, text_lines
from .foreign_graph import is_graph, read_vertices
from .metrics.trajectory import MAX_DIFFERENCE_S, associate

TUM, KITTI, EUROC, G2O = "TUM", "KITTI", "EuRoC", "g2o"
STAMPED, NAMED, POSITIONS = "KITTI with stamps", "named columns", "positions"
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SINCE_1970_S = (9e8, 5e9)  # years 1998 to 2128
SPACING_S = (1e-3, 10.0)  # ours: of poses, on a clock that began elsewhere
WIDEST_S = 100.0  # ours: of poses, on a clock that began in 1970
_ORDER = {TUM: [4, 5, 6, 7], EUROC: [5, 6, 7, 4]}  # columns of qx, qy, qz, qw
_MATRICES = {12: KITTI, 16: KITTI, 13: STAMPED, 17: STAMPED}
_STAMP = re.compile(r"(?:.*[._/ ])?(?:time_?stamp|time|stamp|t)(?:_[mun]?s)?")
_SECONDS = re.compile(r"(.*stamp[._/])secs?")
_NANOSECONDS = ("nsecs", "nsec", "nanosec", "nanosecs")
_POSITION = re.compile(r"(?:t_?|p_?|pos_?|p_rs_r_|.*(?:position|translation)[._/])?([xyz])")
_QUATERNION = re.compile(r"(?:q|.*quat|.*orient|.*rot|r_?(?=[wxyz]$)).*?([wxyz])$")
_TOLERANCE = 0.01  # ours: of lengths of quaternions and of R R^T; four printed digits leave 1e-4


@dataclass(frozen=True)
class ForeignTrajectory:
    """A trajectory and how it was written.

    Args:
        source: Path of the file.
        format: `TUM`, `KITTI`, `STAMPED`, `EUROC`, `G2O`, `NAMED` or `POSITIONS`.
        poses: In order of time; without stamps in the file these are the numbers of the lines. Without rotations in the
            file these are one.
        rows: Which line of data each pose is.
        lines: Number of lines of data.
        lost: Number of those without a finite pose.
    """

    source: str
    format: str
    poses: Trajectory
    rows: Int[np.ndarray, "n"]
    lines: int
    lost: int = 0

    @property
    def has_stamps(self) -> bool:
        """Whether the file holds stamps."""
        return self.format not in (KITTI, G2O)

    @property
    def has_rotations(self) -> bool:
        """Whether the file holds rotations."""
        return self.format != POSITIONS


def read_trajectory(path: Path) -> ForeignTrajectory:
    """Read a trajectory in any of the formats.

    Raises:
        InputError: The file cannot be read, is in none of the formats, or a line is not a pose.
    """
    if is_graph(path):
        return _of_vertices(path)
    lines = data_lines(path)
    if not lines:
        raise InputError(f"{path} holds no poses; expected lines of TUM, KITTI or EuRoC, or g2o")
    width = len(lines[0][1])
    names = column_names(path, width)
    columns = _named(path, names)
    kind = _kind(path, lines, bool(columns))
    matrices = kind in (KITTI, STAMPED)
    if kind == POSITIONS:
        columns = _four(names)
    elif not columns:
        columns = list(range(width)) if matrices else [0, 1, 2, 3, *_ORDER[kind]]
    last = width if matrices or kind == TUM else max(columns) + 1
    timed = 0 if kind == KITTI else 1 if matrices or kind == POSITIONS else len(columns) - 7
    numbers = []
    for line, found, _ in lines:
        row = numbers_of([found[i] for i in columns]) if len(found) >= last else []
        right = kind == EUROC or len(found) == width
        if not (row and right and all(map(math.isfinite, row[:timed]))):
            raise InputError(
                f"{path}, line {line}: {' '.join(found)[:60]!r} is not a pose; "
                f"expected {len(columns)} numbers as in the lines before ({kind})"
            )
        numbers.append(row)
    table = np.array(numbers)
    count, kept = len(table), np.flatnonzero(np.isfinite(table).all(axis=1))
    if not len(kept):
        raise InputError(f"{path} holds no poses: none of its {count} lines is finite")
    table, lines = table[kept], [lines[k] for k in kept]
    stamps = kept.astype(np.float64)
    if timed:
        stamps, table = stamps_of(path, table[:, :timed]), table[:, timed:]
    if kind == POSITIONS:
        quats = np.tile([0.0, 0.0, 0.0, 1.0], (len(table), 1))
    else:
        quats = _of_matrices(path, table, lines, width) if matrices else table[:, 3:]
    positions = table[:, [3, 7, 11]] if matrices else table[:, :3]
    far = np.flatnonzero(np.abs(positions).max(axis=1) > FARTHEST_M)
    if len(far):
        raise InputError(
            f"{path}, line {lines[far[0]][0]}: the position is more than {FARTHEST_M:g} m away; expected metres"
        )
    lengths = np.linalg.norm(quats, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > _TOLERANCE)
    if len(wrong):
        order = "qw qx qy qz" if columns[-4:] == _ORDER[EUROC] else "qx qy qz qw"
        raise InputError(
            f"{path}, line {lines[wrong[0]][0]}: the quaternion has length {lengths[wrong[0]]:.3f}, not 1; "
            f"read as {kind} ({'by the names of the header' if kind == NAMED else f'{order} after the position'})"
        )
    rows = np.unique(stamps, return_index=True)[1]
    poses = Trajectory(stamps, positions, quats / lengths[:, None])
    return ForeignTrajectory(
        str(path), kind, _picked(poses, rows), kept[rows], count, count - len(kept)
    )


def _of_vertices(path: Path) -> ForeignTrajectory:
    table = read_vertices(path)
    far = np.abs(table[:, :3]).max(axis=1) > FARTHEST_M
    wrong = np.abs(np.linalg.norm(table[:, 3:], axis=1) - 1.0) > _TOLERANCE
    if np.any(far | wrong):
        raise InputError(
            f"{path}: vertex {int(np.argmax(far | wrong))} (counted from 0) is more than {FARTHEST_M:g} m away or its "
            "quaternion has not length 1; expected the number, x y z qx qy qz qw"
        )
    every = np.arange(len(table))
    poses = Trajectory(every.astype(np.float64), table[:, :3], table[:, 3:])
    return ForeignTrajectory(str(path), G2O, poses, every, len(table))


def data_lines(path: Path) -> list[tuple[int, list[str], bool]]:
    """Number, words, and whether there are commas, of each line that is no comment or header.

    The header is one line of words before the numbers. Raises InputError if the file cannot be read.
    """
    found: list[tuple[int, list[str], bool]] = []
    header = False
    for number, line in enumerate(text_lines(path), start=1):
        text = line.split("#", 1)[0].strip().rstrip(",;")
        words = text.split()
        if "," in text or ";" in text:  # a cell may be empty
            cells = text.replace(";", ",").split(",")
            words = [word for cell in cells for word in cell.split() or [""]]
        if words and not (found or header or any(numbers_of([word]) for word in words)):
            header = True
        elif words:
            found.append((number, words, "," in text or ";" in text))
    return found


def column_names(path: Path, width: int) -> list[str]:
    """Names of the columns: the last line of as many words above the numbers, a comment or not; empty without one."""
    found: list[str] = []
    for line in text_lines(path):
        text = line.strip().lstrip("#%").strip().replace(";", ",").rstrip(",")
        names = [word.strip() for word in (text.split(",") if "," in text else text.split())]
        comment = line.lstrip().startswith(("#", "%"))
        if numbers_of(names) or (not comment and any(numbers_of([name]) for name in names)):
            break  # the data
        if len(names) == width:
            found = names
    return found


def _plain(names: list[str]) -> list[str]:
    """The names in small letters, without a unit in brackets."""
    return [re.sub(r"\s*[\[(][^\[(]*[\])]$", "", name).strip().lower() for name in names]


def stamp_columns(names: list[str]) -> list[int]:
    """The column of the stamps, or two, of s and of ns in them, by the names of a header; empty if it names none.

    Of several, that of the measurement (ROS: `header.stamp`), else the first.
    """
    plain = _plain(names)
    for i, name in enumerate(plain):
        if one := _SECONDS.fullmatch(name):
            rest = [plain.index(one[1] + word) for word in _NANOSECONDS if one[1] + word in plain]
            return [i, *rest[:1]]
    found = [i for i, name in enumerate(plain) if _STAMP.fullmatch(name)]
    return [i for i in found if plain[i].endswith("stamp") and "header" in plain[i]][:1] or found[
        :1
    ]


def stamps_of(path: Path, columns: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n"]:
    """Stamps in s from the one or two columns of `stamp_columns`."""
    if columns.shape[1] == 2:
        return np.asarray(columns[:, 0] + 1e-9 * columns[:, 1])
    return seconds(path, columns[:, 0])


def _named(path: Path, names: list[str]) -> list[int]:
    """Columns of the stamps, x, y, z, qx, qy, qz, qw by the header; empty if it names no quaternion.

    Raises:
        InputError: The names contradict the formats.
    """
    plain = _plain(names)
    quats, positions = (
        {one[1]: i for i, name in reversed(list(enumerate(plain))) if (one := kind.fullmatch(name))}
        for kind in (_QUATERNION, _POSITION)
    )
    if not quats:
        return []
    place = [positions[axis] for axis in "xyz"] if len(positions) == 3 else [1, 2, 3]
    timed = stamp_columns(names) or [0]
    found = [*timed, *place, *(quats[axis] for axis in "xyzw" if axis in quats)]
    if len(quats) != 4 or len(set(found)) != len(found):
        raise InputError(
            f"{path}: the header names the columns {', '.join(plain)}; expected names of a stamp, of the position x, y, z, "
            "and of qx, qy, qz and qw, in any order; rename the columns"
        )
    return found


def _four(names: list[str]) -> list[int]:
    """Columns of the stamp, x, y and z among four."""
    plain = _plain(names)
    found = {one[1]: i for i, name in enumerate(plain) if (one := _POSITION.fullmatch(name))}
    columns = [*stamp_columns(names)[:1], *(found[axis] for axis in "xyz" if axis in found)]
    return columns if len(set(columns)) == 4 else [0, 1, 2, 3]


def seconds(path: Path, stamps: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Stamps in s, from stamps of the file in s, ms, us or ns.

    Raises:
        InputError: The unit is not clear.
    """
    units = units_of(stamps)
    if len(units) != 1:
        step, last = _spacing(stamps), float(np.max(np.abs(stamps)))
        raise InputError(
            f"{path}: stamps up to {last:g} that are {step:g} apart (median) may be in {' or '.join(units)}; give them in s"
            if units
            else f"{path}: stamps up to {last:g} that are {step:g} apart (median) are in none of {', '.join(UNITS)}; give them in s"
        )
    return stamps * UNITS[units[0]]


def units_of(stamps: Float[np.ndarray, "n"]) -> list[str]:
    """Units in which stamps may be, by their size and spacing.

    On a clock that began in 1970 the size tells. On another one the spacing tells: up to `SPACING_S` they are s, beyond
    it what puts them into `SPACING_S`.
    """
    size, step = float(np.median(np.abs(stamps))), _spacing(stamps)
    since_1970 = [
        unit
        for unit, scale in UNITS.items()
        if SINCE_1970_S[0] <= size * scale <= SINCE_1970_S[1] and step * scale <= WIDEST_S
    ]
    if since_1970 or step <= SPACING_S[1]:
        return since_1970 or ["s"]
    return [unit for unit, scale in UNITS.items() if SPACING_S[0] <= step * scale <= SPACING_S[1]]


def _spacing(stamps: Float[np.ndarray, "n"]) -> float:
    steps = np.diff(np.unique(stamps))
    return float(np.median(steps)) if len(steps) else 0.0


def pairs(
    estimate: ForeignTrajectory, truth: ForeignTrajectory
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Indices of the poses of both at the same instants.

    Raises:
        InputError: Their stamps do not overlap, or one has no stamps and their numbers of poses differ.
    """
    if not (estimate.has_stamps and truth.has_stamps):
        if estimate.lines != truth.lines:
            raise InputError(
                f"{estimate.source} ({estimate.format}) has {estimate.lines} poses and {truth.source} "
                f"({truth.format}) has {truth.lines}; without stamps in both, pose by pose, "
                "the numbers must be equal: give TUM or EuRoC files, or put the stamps before the poses of KITTI "
                "(paste -d ' ' times.txt poses.txt)"
            )
        _, mine, theirs = np.intersect1d(estimate.rows, truth.rows, return_indices=True)
        return mine, theirs
    mine, theirs = associate(estimate.poses.stamps, truth.poses.stamps)
    if len(mine) == 0:
        a, b = estimate.poses.stamps, truth.poses.stamps
        raise InputError(
            f"{truth.source} has no stamp within {MAX_DIFFERENCE_S:g} s of a stamp of {estimate.source}: "
            f"it covers {b[0]:.3f} to {b[-1]:.3f} s, the trajectory {a[0]:.3f} to {a[-1]:.3f} s; "
            "give a truth of the same recording and clock"
        )
    return mine, theirs


def _kind(path: Path, lines: list[tuple[int, list[str], bool]], named: bool) -> str:
    number, words, commas = lines[0]
    row = numbers_of(words)
    if commas and len(row) >= 8:
        firsts = np.array([float(one[0]) for _, one, _ in lines if numbers_of(one[:1])])
        if units_of(firsts[np.isfinite(firsts)]) == ["ns"]:
            return EUROC
    if len(row) == 8:
        return TUM
    if named:
        return NAMED
    if len(row) in _MATRICES:
        return _MATRICES[len(row)]
    if len(row) == 4:
        return POSITIONS
    raise InputError(
        f"{path}, line {number}: {len(row) or 'no'} numbers; expected 8 (TUM: stamp tx ty tz qx qy qz qw), "
        "12 or 16 (KITTI: rows of a 3x4 or 4x4 matrix; 13 or 17 with a stamp), at least 8 with commas and a stamp in ns "
        "(EuRoC: stamp, tx, ty, tz, qw, qx, qy, qz), 4 (positions: stamp x y z), or a header that names the columns (stamp, x, y, z, qx, qy, qz, qw)"
    )


def _of_matrices(
    path: Path,
    table: Float[np.ndarray, "n c"],
    lines: list[tuple[int, list[str], bool]],
    width: int,
) -> Float[np.ndarray, "n 4"]:
    matrices = table.reshape(len(table), -1, 4)
    rotations = matrices[:, :3, :3]
    faults = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (faults > _TOLERANCE) | (np.linalg.det(rotations) < 0.0)
    wrong |= np.any(matrices[:, 3:] != [0.0, 0.0, 0.0, 1.0], axis=(1, 2))
    if wrong.any():
        raise InputError(
            f"{path}, line {lines[int(np.argmax(wrong))][0]}: the first three columns of the 3x4 matrix are no rotation; "
            f"{width} numbers were read as {_MATRICES[width]}"
        )
    return np.asarray(Rotation.from_matrix(rotations).as_quat())


def _picked(poses: Trajectory, order: Int[np.ndarray, "k"]) -> Trajectory:
    return Trajectory(poses.stamps[order], poses.positions[order], poses.quats_xyzw[order])
