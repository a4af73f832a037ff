"""Tables of covariances as systems write them: CSV with or without a header.

One line per pose, row by row, with or without a header and a first column of stamps (as of trajectories). The count tells
what a line holds: 36 a full 6x6 matrix, 21 its upper triangle, over (x, y, z, rotation vector); 9 and 6 the same of a
3x3 matrix, over (x, y, yaw) if a name of the header contains "yaw" or "theta", else over (x, y, z). Units are m and rad.

Columns whose names in the header begin with "sigma", "std", "sd" or "var" are the standard deviations or variances of
x, y, z (or x, y, yaw, or x, y, z, roll, pitch, yaw), without correlations. Of a table with other columns, those count
whose names begin with "P_", P and a digit, "cov" or "aligned_", and those of `pose.covariance` of a ROS topic. `Pt11` to
`Pt33` and `Pr11` to `Pr33` are 3x3 blocks as OpenVINS writes them, of the position in world axes and of the rotation in
those of the body.

Source: ours.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.errors import InputError

from ..results.tables import numbers_of
from .foreign_trajectory import column_names, data_lines, stamp_columns, stamps_of

SIZES = {36: (6, False), 21: (6, True), 9: (3, False), 6: (3, True)}
"""Number of numbers: size of the matrix, and whether they are those of its upper triangle."""
_COVARIANCE = re.compile(r"P[_\d]|(?i:cov|.*\bpose[._/]cov)")
_OPENVINS = [f"P{part}{i}{j}" for part in "tr" for i in (1, 2, 3) for j in range(i, 4)]
_SPREAD = re.compile(
    r"(?P<kind>sigma|std|stddev|sd|var|variance)_?(?P<part>.*?)(_(m|rad)2?| ?\[(m|rad)\^?2?\])?",
    re.IGNORECASE,
)
_DIAGONALS = (["x", "y", "z"], ["x", "y", "yaw"], ["x", "y", "theta"], ["x", "y", "z", "roll", "pitch", "yaw"])  # fmt: skip


@dataclass(frozen=True)
class CovarianceTable:
    """Numbers of covariances, line by line.

    Args:
        stamps: If there are any, s.
        names: Of the columns of `values`, if there are any.
        values: As many columns as in `SIZES`.
        lines: Numbers of the lines in the file.
        openvins: Whether they are the blocks of OpenVINS.
    """

    stamps: Float[np.ndarray, "n"] | None
    names: list[str]
    values: Float[np.ndarray, "n c"]
    lines: Int[np.ndarray, "n"]
    openvins: bool = False


def read_covariances(path: Path) -> CovarianceTable:
    """Read the numbers of covariances.

    Raises:
        InputError: The file has no such table, or a line has another number of numbers.
    """
    lines = data_lines(path)
    if not lines:
        raise InputError(f"{path} holds no covariances; expected CSV or g2o")
    width = len(lines[0][1])
    names = column_names(path, width)
    spread = [i for i, name in enumerate(names) if _SPREAD.fullmatch(name)]
    openvins = set(_OPENVINS) <= set(names)
    chosen = [names.index(name) for name in _OPENVINS] if openvins else []
    chosen = chosen or [i for i, name in enumerate(names) if name.startswith("aligned_")]
    chosen = chosen or [i for i, name in enumerate(names) if _COVARIANCE.match(name)]
    sigmas = bool(spread) and (len(spread) >= width - 1 or not chosen)
    if sigmas:
        timed, chosen = stamp_columns(names) or [0], spread
    elif len(chosen) in SIZES or openvins:
        timed = stamp_columns(names)
    elif width in SIZES or width - 1 in SIZES:
        chosen = list(range(0 if width in SIZES else 1, width))
        timed = [0]
    else:
        raise InputError(
            f"{path}: {width} numbers per line; expected a stamp or none, and 36 (6x6), 21 (its upper triangle), "
            "9 (3x3) or 6 (its upper triangle), or a header that names the columns of the covariance"
        )
    timed = [i for i in timed if i not in chosen]
    rows = []
    for number, words, _ in lines:
        row = numbers_of([words[i] for i in (*timed, *chosen)]) if len(words) == width else []
        if not row:
            counted = len(numbers_of(words)) or "no"
            raise InputError(
                f"{path}, line {number}: {counted} numbers; expected {width} as in the lines before"
            )
        rows.append(row)
    table = np.array(rows)
    stamps = stamps_of(path, table[:, : len(timed)]) if timed else None
    values, picked = table[:, len(timed) :], [names[i] for i in chosen if names]
    if sigmas:
        picked, values = _of_sigmas(path, picked, values)
    if openvins:
        blocks = matrices(values.reshape(-1, 6), 3, True).reshape(-1, 2, 3, 3)
        both = np.zeros((len(values), 6, 6))
        both[:, :3, :3], both[:, 3:, 3:] = blocks[:, 0], blocks[:, 1]
        values = both.reshape(-1, 36)
    return CovarianceTable(stamps, picked, values, np.array([line[0] for line in lines]), openvins)


def _of_sigmas(
    path: Path, names: list[str], values: Float[np.ndarray, "n c"]
) -> tuple[list[str], Float[np.ndarray, "n k"]]:
    """Names and upper triangles of the covariances of columns of standard deviations or variances."""
    spreads = [_SPREAD.fullmatch(name) for name in names]
    parts = [one["part"].lower() for one in spreads if one]
    if parts not in _DIAGONALS:
        raise InputError(
            f"{path}: the header names the columns {', '.join(names)}; of standard deviations or variances "
            "x, y, z (m), or x, y, yaw, or x, y, z, roll, pitch, yaw (rad) were expected; rename or reorder the columns"
        )
    squared = [
        values[:, i] if one["kind"].lower().startswith("var") else values[:, i] ** 2
        for i, one in enumerate(one for one in spreads if one)
    ]
    found = np.zeros((len(values), len(parts), len(parts)))
    found[:, range(len(parts)), range(len(parts))] = np.stack(squared, axis=1)
    return parts, found[:, *np.triu_indices(len(parts))]


def matrices(
    values: Float[np.ndarray, "n c"], size: int, upper: bool
) -> Float[np.ndarray, "n k k"]:
    """Matrices from their numbers row by row, or from those of their upper triangles."""
    if not upper:
        return values.reshape(-1, size, size)
    found = np.zeros((len(values), size, size))
    rows, columns = np.triu_indices(size)
    found[:, rows, columns] = found[:, columns, rows] = values
    return found
