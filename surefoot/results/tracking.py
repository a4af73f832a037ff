"""How well the odometry of a camera without poses tracked: tracking.csv, and a sentence or two on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from perception.odometry.depth_bend import MotionBend
from perception.odometry.odometry import LOST, RESTARTED
from perception.odometry.vergence import Vergence

from ..words import count_of
from .run_folder import RunFolder
from .tables import Table

TRACKING = "tracking.csv"
TRACKING_HEADER = ("stamp_s", "state", "failure_probability", "alarm")
WITHOUT_POSE = (LOST, RESTARTED)
ADVICE = (
    "; odometry needs images that overlap; if they do, and their depth is noisier than that of a structured-light "
    "camera, take the settings of `surefoot calibrate-noise`"
)
SAID_BEND = 0.005  # ours: a smaller bend is within what is claimed
FAR_M = 30.0  # ours: where the effect of a vergence is told
SAID_SIGMAS = 5.0  # ours: sure enough to ask for a calibration
SAID_TURNED = 3.0
"""The same of the vergence, whose first estimate is half of it or less; chosen on KITTI's highway, where it is 4.7."""


def write_tracking(
    folder: RunFolder,
    stamps: Sequence[float],
    states: Sequence[str],
    failures: Sequence[float],
    threshold: float,
    bend: MotionBend,
    vergence: Vergence,
) -> str:
    """Write the table.

    Args:
        folder: Run folder.
        stamps: Of the depth images, s.
        states: Of `perception.odometry.odometry.Step`.
        failures: Probability that the pose is wrong, of each image.
        threshold: Probability from which an image raises the alarm.
        bend: What the motion tells of the bend of the depth.
        vergence: What it tells of the calibration of a stereo pair.

    Returns:
        For the summary; empty without images.
    """
    alarms = [failure >= threshold for failure in failures]
    folder.write_csv(
        TRACKING, TRACKING_HEADER, list(zip(stamps, states, failures, alarms, strict=True))
    )
    if not alarms:
        return ""
    of = f"of {count_of(len(alarms), 'frame')}"
    if not any(alarms):
        return f"odometry doubtful in none {of}{_on_bend(bend)}{_on_vergence(vergence)}"
    first = stamps[alarms.index(True)] - stamps[0]
    found = f"odometry doubtful in {sum(alarms)} {of}, from {first:.1f} s on"
    if 2 * sum(state in WITHOUT_POSE for state in states) > len(states):
        return found + ADVICE
    return found + _on_bend(bend) + _on_vergence(vergence)


def _on_bend(bend: MotionBend) -> str:
    """Advice if the depth surely bends."""
    size = np.abs(bend.bend.coefficients)
    sure = size > SAID_SIGMAS * np.sqrt(np.diag(bend.covariance))
    if not np.any(sure & (size > SAID_BEND)):
        return ""
    return (
        f"; depth bends by at least {100.0 * float(size[sure].max()):.1f} % towards the edge of the picture: "
        "take it out with the settings of `surefoot calibrate-noise`"
    )


def _on_vergence(vergence: Vergence) -> str:
    """Advice if the cameras of a pair surely stand otherwise than calibrated."""
    size = abs(vergence.angle)
    if size <= vergence.usual or size <= SAID_TURNED * vergence.sigma:
        return ""
    small = "small" if vergence.angle > 0.0 else "large"
    return (
        f"; the cameras of the pair are turned by at least {math.degrees(size):.2f} deg against their calibration: depth "
        f"at {FAR_M:.0f} m is {100.0 * FAR_M * abs(vergence.share_per_m):.0f} % too {small}, and so may be the path: take it "
        "out with the settings of `surefoot calibrate-noise`"
    )


def tracking_metrics(table: Table | None) -> dict[str, float]:
    """Empty without a table; odometry_frames, odometry_alarms (frames with an alarm), odometry_lost (frames without a pose)."""
    if table is None:
        return {}
    states = table.words("state")
    return {
        "odometry_frames": float(len(states)),
        "odometry_alarms": float(np.sum(table.numbers("alarm"))),
        "odometry_lost": float(sum(state in WITHOUT_POSE for state in states)),
    }
