"""Trajectories as other systems write them: TUM, KITTI and EuRoC, recognised by what the file holds.

| format | a line | stamps |
|---|---|---|
| TUM | stamp tx ty tz qx qy qz qw | s; other units are recognised (`seconds`) |
| KITTI | the 12 numbers of a 3x4 matrix, row by row | none: the number of the line |
| EuRoC | stamp, tx, ty, tz, qw, qx, qy, qz and further columns, with commas | ns |

Where a header names the columns of the quaternion, its order is that of the names.

Source: Sturm et al. 2012 (TUM), Geiger et al. 2012 (KITTI), Burri et al. 2016 (EuRoC).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from perception.primitives.errors import InputError

from ..results.tables import FARTHEST_M, Trajectory, text_lines
from .metrics.trajectory import MAX_DIFFERENCE_S, associate

TUM, KITTI, EUROC = "TUM", "KITTI", "EuRoC"
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SINCE_1970_S = (9e8, 5e9)  # years 1998 to 2128
SPACING_S = (1e-3, 10.0)  # ours: of poses, on a clock that began elsewhere
WIDEST_S = 100.0  # ours: of poses, on a clock that began in 1970
_ORDER = {TUM: [4, 5, 6, 7], EUROC: [5, 6, 7, 4]}  # columns of qx, qy, qz, qw
_QUATERNION = re.compile(r"(?:q|.*quat|.*orient|.*rot|r_?(?=[wxyz]$)).*?([wxyz])$")
_TOLERANCE = 0.01  # ours: of lengths of quaternions and of R R^T; four printed digits leave 1e-4


@dataclass(frozen=True)
class ForeignTrajectory:
    """A trajectory and how it was written.

    Args:
        source: Path of the file.
        format: `TUM`, `KITTI` or `EUROC`.
        poses: In order of time; without stamps in the file these are the numbers of the lines.
        rows: Which line of data each pose is.
        lines: Number of lines of data.
    """

    source: str
    format: str
    poses: Trajectory
    rows: Int[np.ndarray, "n"]
    lines: int

    @property
    def has_stamps(self) -> bool:
        """Whether the file holds stamps."""
        return self.format != KITTI


def read_trajectory(path: Path) -> ForeignTrajectory:
    """Read a trajectory in any of the three formats.

    Raises:
        InputError: The file cannot be read, is in none of the formats, or a line is not a pose.
    """
    lines = data_lines(path)
    if not lines:
        raise InputError(f"{path} holds no poses; expected lines of TUM, KITTI or EuRoC")
    kind = _kind(path, lines)
    width = 12 if kind == KITTI else 8
    numbers = []
    for line, found, _ in lines:
        row = numbers_of(found)
        right = len(row) >= width if kind == EUROC else len(row) == width
        if not right or not np.all(np.isfinite(row[:width])):
            raise InputError(
                f"{path}, line {line}: {' '.join(found)[:60]!r} is not a pose; "
                f"expected {width} finite numbers as in the lines before ({kind})"
            )
        numbers.append(row[:width])
    table = np.array(numbers)
    positions = table[:, [3, 7, 11]] if kind == KITTI else table[:, 1:4]
    far = np.flatnonzero(np.abs(positions).max(axis=1) > FARTHEST_M)
    if len(far):
        raise InputError(
            f"{path}, line {lines[far[0]][0]}: the position is more than {FARTHEST_M:g} m away; expected metres"
        )
    if kind == KITTI:
        return ForeignTrajectory(
            str(path), kind, _of_matrices(path, table, lines), np.arange(len(table)), len(table)
        )
    stamps = seconds(path, table[:, 0])
    order = _named_order(path, len(lines[0][1])) or _ORDER[kind]
    quats = table[:, order]
    lengths = np.linalg.norm(quats, axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > _TOLERANCE)
    if len(wrong):
        raise InputError(
            f"{path}, line {lines[wrong[0]][0]}: the quaternion has length {lengths[wrong[0]]:.3f}, not 1; "
            f"read as {kind} ({'qw qx qy qz' if order == _ORDER[EUROC] else 'qx qy qz qw'} after the position)"
        )
    rows = np.unique(stamps, return_index=True)[1]
    poses = Trajectory(stamps, table[:, 1:4], quats / lengths[:, None])
    return ForeignTrajectory(str(path), kind, _picked(poses, rows), rows, len(table))


def data_lines(path: Path) -> list[tuple[int, list[str], bool]]:
    """Number, words, and whether there are commas, of each line that is no comment or header.

    The header is one line of words before the numbers. Raises InputError if the file cannot be read.
    """
    found: list[tuple[int, list[str], bool]] = []
    header = False
    for number, line in enumerate(text_lines(path), start=1):
        text = line.split("#", 1)[0].strip().rstrip(",;")
        words = text.replace(",", " ").replace(";", " ").split()
        if words and not (found or header or any(numbers_of([word]) for word in words)):
            header = True
        elif words:
            found.append((number, words, "," in text or ";" in text))
    return found


def column_names(path: Path, width: int) -> list[str]:
    """Names of the columns: the last line of as many words above the numbers, a comment or not; empty without one."""
    found: list[str] = []
    for line in text_lines(path):
        text = line.strip().lstrip("#").strip().replace(";", ",").rstrip(",")
        names = [word.strip() for word in (text.split(",") if "," in text else text.split())]
        if numbers_of(names):
            break
        if len(names) == width:
            found = names
    return found


def _named_order(path: Path, width: int) -> list[int]:
    """Columns of qx, qy, qz, qw by the header; empty if it names none.

    Raises:
        InputError: The names contradict the formats.
    """
    names = [re.sub(r"[\[(].*", "", name).strip().lower() for name in column_names(path, width)]
    found = {i: name[-1] for i, name in enumerate(names[:8]) if _QUATERNION.match(name)}
    if not found:
        return []
    if sorted(found) != [4, 5, 6, 7] or sorted(found.values()) != list("wxyz"):
        raise InputError(
            f"{path}: the header names the columns {', '.join(names)}; expected a stamp, the position x, y, z, then "
            "qx, qy, qz and qw in any order; reorder or rename the columns"
        )
    return sorted(found, key=lambda i: "xyzw".index(found[i]))


def numbers_of(words: list[str]) -> list[float]:
    """The words as numbers; empty if one of them is none."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


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
        if len(estimate.poses) != len(truth.poses):
            raise InputError(
                f"{estimate.source} ({estimate.format}) has {len(estimate.poses)} poses and {truth.source} "
                f"({truth.format}) has {len(truth.poses)}; without stamps in both, pose by pose, "
                "the numbers must be equal: give TUM or EuRoC files"
            )
        every = np.arange(len(estimate.poses))
        return every, every
    mine, theirs = associate(estimate.poses.stamps, truth.poses.stamps)
    if len(mine) == 0:
        a, b = estimate.poses.stamps, truth.poses.stamps
        raise InputError(
            f"{truth.source} has no stamp within {MAX_DIFFERENCE_S:g} s of a stamp of {estimate.source}: "
            f"it covers {b[0]:.3f} to {b[-1]:.3f} s, the trajectory {a[0]:.3f} to {a[-1]:.3f} s; "
            "give a truth of the same recording and clock"
        )
    return mine, theirs


def _kind(path: Path, lines: list[tuple[int, list[str], bool]]) -> str:
    number, words, commas = lines[0]
    row = numbers_of(words)
    if commas and len(row) >= 8:
        firsts = np.array([float(one[0]) for _, one, _ in lines if numbers_of(one[:1])])
        if units_of(firsts[np.isfinite(firsts)]) == ["ns"]:
            return EUROC
    if len(row) == 8:
        return TUM
    if len(row) == 12:
        return KITTI
    raise InputError(
        f"{path}, line {number}: {len(row) or 'no'} numbers; expected 8 (TUM: stamp tx ty tz qx qy qz qw), "
        "12 (KITTI: rows of a 3x4 matrix), or at least 8 with commas and a stamp in ns "
        "(EuRoC: stamp, tx, ty, tz, qw, qx, qy, qz)"
    )


def _of_matrices(
    path: Path, table: Float[np.ndarray, "n 12"], lines: list[tuple[int, list[str], bool]]
) -> Trajectory:
    matrices = table.reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    faults = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((faults > _TOLERANCE) | (np.linalg.det(rotations) < 0.0))
    if len(wrong):
        raise InputError(
            f"{path}, line {lines[wrong[0]][0]}: the first three columns of the 3x4 matrix are no rotation; "
            "12 numbers were read as KITTI"
        )
    quats = Rotation.from_matrix(rotations).as_quat()
    return Trajectory(np.arange(len(table), dtype=np.float64), matrices[:, :, 3], quats)


def _picked(poses: Trajectory, order: Int[np.ndarray, "k"]) -> Trajectory:
    return Trajectory(poses.stamps[order], poses.positions[order], poses.quats_xyzw[order])
