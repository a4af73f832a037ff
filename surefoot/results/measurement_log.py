"""Tables of step odometry, gyroscope and landmark measurements of a run; input of the smoother."""

from __future__ import annotations

from collections.abc import Sequence

from perception.primitives.frame import Frame
from perception.primitives.landmark import Sighting

ODOMETRY = "odometry.csv"
ODOMETRY_HEADER = (
    "stamp_s", "ahead_m", "left_m", "turn_rad", "steps", "gyro_x_radps", "gyro_y_radps", "gyro_z_radps",
)  # fmt: skip
SIGHTINGS = "sightings.csv"
SIGHTINGS_HEADER = ("stamp_s", "identity", "range_m", "bearing_rad", "P_rr", "P_rb", "P_bb")


def odometry_row(stamp_s: float, frame: Frame) -> tuple[float | None, ...]:
    """The row of `odometry.csv` of one frame, at its time by the clock of the run; cells without a measurement stay empty."""
    step: tuple[float | None, ...] = (None,) * 4
    if frame.odometry is not None:
        step = (*frame.odometry.motion.vector.tolist(), frame.odometry.steps)
    gyro = (None,) * 3 if frame.imu is None else frame.imu.angular_velocity.tolist()
    return (stamp_s, *step, *gyro)


def sighting_rows(
    stamp_s: float, sightings: Sequence[Sighting]
) -> list[tuple[float | int | None, ...]]:
    """The rows of `sightings.csv` of one frame."""
    rows = []
    for sighting in sightings:
        P = sighting.covariance
        upper = (float(P[0, 0]), float(P[0, 1]), float(P[1, 1]))
        rows.append((stamp_s, sighting.identity, *sighting.measured.tolist(), *upper))
    return rows
