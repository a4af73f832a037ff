"""How well the odometry of a camera without poses tracked: tracking.csv, and one sentence on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.odometry.odometry import LOST, RESTARTED

from ..words import count_of
from .run_folder import RunFolder
from .tables import Table

TRACKING = "tracking.csv"
TRACKING_HEADER = ("stamp_s", "state", "failure_probability", "alarm")
WITHOUT_POSE = (LOST, RESTARTED)
ADVICE = "; if its depth is noisier than that of a structured-light camera, take the settings of `surefoot calibrate-noise`"


def write_tracking(
    folder: RunFolder,
    stamps: Sequence[float],
    states: Sequence[str],
    failures: Sequence[float],
    threshold: float,
) -> str:
    """Write the table.

    Args:
        folder: Run folder.
        stamps: Of the depth images, s.
        states: Of `perception.odometry.odometry.Step`.
        failures: Probability that the pose is wrong, of each image.
        threshold: Probability from which an image raises the alarm.

    Returns:
        The sentence for the summary; empty without images.
    """
    alarms = [failure >= threshold for failure in failures]
    folder.write_csv(
        TRACKING, TRACKING_HEADER, list(zip(stamps, states, failures, alarms, strict=True))
    )
    if not alarms:
        return ""
    of = f"of {count_of(len(alarms), 'frame')}"
    if not any(alarms):
        return f"odometry doubtful in none {of}"
    first = stamps[alarms.index(True)] - stamps[0]
    found = f"odometry doubtful in {sum(alarms)} {of}, from {first:.1f} s on"
    if 2 * sum(state in WITHOUT_POSE for state in states) > len(states):
        found += ADVICE
    return found


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
