"""Localisation of a mower by odometry and by ranges to four radio beacons that have a common scale error.

The scale of the ranges is a state. Ranges with multipath errors are rejected by gating. Noise parameters maximise the
likelihood of the recording's innovations.

Source: ours; data set Plaza 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from perception.filtering.consistency import chi_square_quantile
from perception.filtering.square_root import SquareRootFilter
from perception.primitives.gaussian import Gaussian

from ...recordings.plaza import RangeLog
from .robot_run import rms_length

SCALE = 3  # entry of the state, after x, y, yaw
GATE = chi_square_quantile(0.99, 1)  # radio ranges have a heavy tail
RANGE_SIGMA_M = 0.53  # maximum likelihood
SCALE_SIGMA = 0.1  # ours: ranges are up to 10 % too long
PATH_SIGMA = 0.07  # m per root of a metre, maximum likelihood
TURN_SIGMA, TURN_WALK = 3e-4, 3e-5  # rad per root of a metre and of a second, likewise


@dataclass(frozen=True)
class RangeOutcome:
    """Position errors, m, estimated scale, and share of rejected ranges."""

    rmse_m: float
    dead_reckoning_m: float
    scale: float
    rejected_share: float


def follow_ranges(log: RangeLog) -> RangeOutcome:
    """Filter the recording from its true start; heading is not evaluated, since its truth comes from odometry."""
    start = np.append(log.truth[0, 1:4], 1.0)
    sigma = np.array([0.1, 0.1, 0.02, SCALE_SIGMA])
    robot = SquareRootFilter(Gaussian(start, np.diag(sigma**2)), angles=(2,))
    dead_reckoned = start[None]
    errors, dead_reckoning_errors = [], []
    row = rejected = 0
    stamp = float(log.truth[0, 0])
    for now, path, turn in log.odometry.tolist():
        dt, stamp = max(now - stamp, 0.0), now
        move = partial(_driven, path=path, turn=turn)
        away = PATH_SIGMA**2 * abs(path)
        noise = [away, away, TURN_SIGMA**2 * abs(path) + TURN_WALK**2 * dt, 1e-10 * dt]
        robot.predict(move, np.diag(noise))
        dead_reckoned = move(dead_reckoned)
        while row < len(log.stamps_s) and log.stamps_s[row] <= now:
            see = partial(_ranged, place=log.places[log.beacons[row]])
            used, _ = robot.update(
                see, log.ranges_m[row : row + 1], np.array([[RANGE_SIGMA_M**2]]), gate=GATE
            )
            rejected += int(not used)
            row += 1
        true = [np.interp(now, log.truth[:, 0], log.truth[:, c]) for c in (1, 2)]
        errors.append(robot.mean[:2] - true)
        dead_reckoning_errors.append(dead_reckoned[0, :2] - true)
    return RangeOutcome(
        rms_length(np.array(errors)),
        rms_length(np.array(dead_reckoning_errors)),
        float(robot.mean[SCALE]),
        rejected / max(row, 1),
    )


def _driven(points: np.ndarray, path: float, turn: float) -> np.ndarray:
    """States (k, 4) after a path, m, and a turn, rad, on an arc."""
    moved = points.copy()
    heading = points[:, 2] + turn / 2.0
    moved[:, 0] += path * np.cos(heading)
    moved[:, 1] += path * np.sin(heading)
    moved[:, 2] += turn
    return moved


def _ranged(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Predicted range of each state (k, 4) to a beacon, (k, 1), m."""
    distance = np.hypot(points[:, 0] - place[0], points[:, 1] - place[1])
    return np.asarray((points[:, SCALE] * distance)[:, None])
