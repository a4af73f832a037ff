"""The Plaza recordings: a mower's dead reckoning and its ranges to radio beacons, with RTK truth.

Source: Djugash, Singh, "Navigating with ranging radios" (Carnegie Mellon University).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from perception.primitives.errors import RecordingError


@dataclass(frozen=True)
class RangeLog:
    """What the mower told.

    Args:
        odometry: (n, 3) stamp, s, way driven, m, and turn, rad, since the row before.
        stamps_s: (m,) of the ranges, rising.
        beacons: (m,) index into `places`.
        ranges_m: (m,) from the antenna to the beacon, as told: every beacon reads long.
        places: (b, 2) of the beacons, m, world frame.
        truth: (k, 4) stamp, s, x, y, m, heading, rad.
    """

    odometry: Float[np.ndarray, "n 3"]
    stamps_s: Float[np.ndarray, "m"]
    beacons: Int[np.ndarray, "m"]
    ranges_m: Float[np.ndarray, "m"]
    places: Float[np.ndarray, "b 2"]
    truth: Float[np.ndarray, "k 4"]


def read_plaza(path: Path) -> RangeLog:
    """Read a Plaza file of MATLAB.

    Raises:
        RecordingError: It is not there, or lacks a table.
    """
    from scipy.io import loadmat  # slow to load
    from scipy.io.matlab import MatReadError

    try:
        tables = loadmat(path)
        odometry, ranges, beacons, truth = (
            np.asarray(tables[name], float) for name in ("DR", "TD", "TL", "GT")
        )
    except (
        OSError,
        ValueError,
        KeyError,
        IndexError,
        MatReadError,
    ) as error:  # IndexError: scipy < 1.16
        raise RecordingError(
            f"{path}: {error}; expected a MATLAB file with tables DR, TD, TL and GT"
        ) from error
    order = np.argsort(ranges[:, 0], kind="stable")
    ranges = ranges[order]
    identities = beacons[:, 0].astype(np.int64).tolist()
    known = np.isin(ranges[:, 2].astype(np.int64), identities) & np.all(np.isfinite(ranges), axis=1)
    ranges = ranges[known]
    index = np.array([identities.index(int(row[2])) for row in ranges], np.int64)
    return RangeLog(odometry, ranges[:, 0], index, ranges[:, 3], beacons[:, 1:3], truth)
