"""The Plaza recordings: dead reckoning of a mower and ranges to radio beacons, with RTK ground truth.

Source: Djugash, Singh, "Navigating with ranging radios" (Carnegie Mellon University).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.errors import RecordingError
from perception.primitives.safe_input import UnreadableError

from .matlab import read_tables
from .mrclam import check_unique


@dataclass(frozen=True)
class RangeLog:
    """Measurements of the mower.

    Args:
        odometry: (n, 3) stamp, s, distance, m, and turn, rad, since the previous row.
        stamps_s: (m,) stamps of the ranges, increasing.
        beacons: (m,) index into `places`.
        ranges_m: (m,) measured ranges from the antenna to the beacon; they have a positive bias.
        places: (b, 2) positions of the beacons, m, world frame.
        truth: (k, 4) stamp, s, x, y, m, heading, rad; empty without a table GT.
    """

    odometry: Float[np.ndarray, "n 3"]
    stamps_s: Float[np.ndarray, "m"]
    beacons: Int[np.ndarray, "m"]
    ranges_m: Float[np.ndarray, "m"]
    places: Float[np.ndarray, "b 2"]
    truth: Float[np.ndarray, "k 4"]


_COLUMNS = {"DR": 3, "TD": 4, "TL": 3, "GT": 4}


def read_plaza(path: Path) -> RangeLog:
    """Read a Plaza file (MATLAB).

    Raises:
        RecordingError: The file does not exist or lacks a table, or a beacon has two places.
    """
    try:
        found = read_tables(path)
    except UnreadableError as error:
        raise RecordingError(f"{path} {error}; expected a MATLAB file") from error
    odometry, ranges, beacons, truth = (_table(path, found, name) for name in _COLUMNS)
    check_unique(f"{path}, table TL", "beacon", beacons[:, 0])
    order = np.argsort(ranges[:, 0], kind="stable")
    ranges = ranges[order]
    identities = beacons[:, 0].astype(np.int64).tolist()
    known = np.isin(ranges[:, 2].astype(np.int64), identities) & np.all(np.isfinite(ranges), axis=1)
    ranges = ranges[known]
    index = np.array([identities.index(int(row[2])) for row in ranges], np.int64)
    truth = _facing_ahead(truth, odometry)
    return RangeLog(odometry, ranges[:, 0], index, ranges[:, 3], beacons[:, 1:3], truth)


def _facing_ahead(
    truth: Float[np.ndarray, "k 4"], odometry: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "k 4"]:
    """The truth with headings of the front: in Plaza2 they are those of the back."""
    way = np.diff(truth[:, 1:3], axis=0)
    heading = truth[:-1, 3]
    ahead = way[:, 0] * np.cos(heading) + way[:, 1] * np.sin(heading)
    backwards = ahead.sum() * odometry[:, 1].sum() < 0.0
    return truth + np.array([0.0, 0.0, 0.0, math.pi]) if backwards else truth


def _table(path: Path, found: dict[str, np.ndarray], name: str) -> Float[np.ndarray, "n k"]:
    """A table of a file; an absent table GT is empty."""
    columns = _COLUMNS[name]
    table = found.get(name, np.empty((0, columns if name == "GT" else 0)))
    if table.shape[1] < columns or (len(table) == 0 and name != "GT"):
        raise RecordingError(
            f"{path}: no table {name} of {columns} columns; expected a MATLAB file with tables DR, TD and TL"
        )
    if name != "TD" and not np.isfinite(table).all():  # ranges that are none are left out
        raise RecordingError(f"{path}: table {name} holds numbers that are not finite")
    return table
