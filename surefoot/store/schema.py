"""The tables of a run: their columns, types, units and meaning.

Every value that is not known is NULL. A table without rows has no file. In a store and in queries every table begins with
the column `run`, the path of the run folder below the folder that was asked.
"""

from __future__ import annotations

from typing import NamedTuple

SCHEMA_VERSION = 1
"""Rises when a column changes its name, type or meaning; new columns do not raise it."""
FOLDER = "tables"  # in a run folder
COMMIT = f"{FOLDER}/runs.parquet"
"""Is written last: a run has tables if it is there."""
RUN = "run"
PLANE = ("P00", "P01", "P02", "P11", "P12", "P22")
POSE = ("P_xx", "P_xy", "P_xyaw", "P_yy", "P_yyaw", "P_yawyaw")
STATE = ("P_xx", "P_xy", "P_xvx", "P_xvy", "P_yy", "P_yvx", "P_yvy", "P_vxvx", "P_vxvy", "P_vyvy")


class Column(NamedTuple):
    """A column: its name, its type in SQL, and what it holds, with the unit."""

    name: str
    kind: str
    meaning: str


def _numbers(meaning: str, *names: str) -> tuple[Column, ...]:
    return tuple(Column(name, "DOUBLE", meaning) for name in names)


STAMP = Column("stamp_s", "DOUBLE", "stamp on the clock of the recording, s")
METRICS = (
    Column("frames", "BIGINT", "frames used"),
    Column("skipped", "BIGINT", "frames that could not be used"),
    *_numbers("length of the run, s", "seconds"),
    *_numbers("length of the path, m", "path_m"),
    *_numbers("position error, RMS, in the axes of the truth, m", "position_rmse_m"),
    *_numbers("heading error, RMS, in the axes of the truth, deg", "heading_rmse_deg"),
    *_numbers("position error, RMS, after rigid alignment (ATE), m", "ate_m"),
    *_numbers("position error over 1 s, RMS (RPE), m", "rpe_1s_m"),
    *_numbers("mean NEES of the pose by its degrees of freedom; 1 if consistent", "pose_nees"),
    *_numbers("mean NIS of landmarks and of tracks by their degrees of freedom; 1 if consistent",
              "landmark_nis", "track_nis"),
    *_numbers("share of the frames with a floor", "floor_share"),
    *_numbers("claimed standard deviation of the floor's tilt, larger axis, median, deg", "tilt_sigma_deg"),
    *_numbers("error of the floor's tilt, median of its camera with the most frames, deg", "tilt_error_deg"),
    Column("tracks", "BIGINT", "tracks of obstacles"),
    Column("movers", "BIGINT", "tracks that count as moving"),
    Column("false_movers", "BIGINT", "tracks that count as moving and followed nothing that moves, by the truth"),
    *_numbers("OSPA of the moving obstacles, cut-off 0.5 m, m", "ospa_m"),
    *_numbers("share of the observed cells of the map that are correct", "grid_correct_share"),
    *_numbers("F-score of the surface at 2 cm", "surface_fscore"),
    *_numbers("smallest distance from any object, m", "min_clearance_m"),
    Column("contacts", "BIGINT", "contacts with objects"),
    Column("falls", "BIGINT", "falls"),
    Column("goals_missed", "BIGINT", "goals not reached"),
    Column("doubts", "BIGINT", "how often the run began to doubt something"),
    *_numbers("processing time of a frame: median and 95 %, ms", "frame_ms", "frame_p95_ms"),
    Column("figures", "MAP(VARCHAR, DOUBLE)", "every number of metrics.json by its name, true as 1"),
)  # fmt: skip
TABLES: dict[str, tuple[Column, ...]] = {
    "runs": (
        Column("schema", "INTEGER", "version of these tables"),
        Column("version", "VARCHAR", "version of surefoot"),
        Column("commit", "VARCHAR", "commit of the checkout, with + if files differ from it"),
        Column("kind", "VARCHAR", "simulation, map, panorama, monocular, or the format of the recording"),
        Column("name", "VARCHAR", "name of the run"),
        Column("recording", "VARCHAR", "path of the recording"),
        Column("recording_hash", "VARCHAR", "digest of the recording, the same wherever it lies"),
        Column("scene", "VARCHAR", "scene of a simulation"),
        Column("seed", "BIGINT", "seed of the run"),
        Column("config_hash", "VARCHAR", "digest of config.toml"),
        Column("planner", "VARCHAR", "planner of a simulation"),
        Column("body", "VARCHAR", "kinematic or dynamic, of a simulation"),
        Column("interrupted", "BOOLEAN", "stopped before its end"),
        *_numbers("when the robot fell, s", "fell_at_s"),
        Column("notes", "VARCHAR[]", "remarks for the user"),
    ),
    "frames": (
        STAMP,
        *_numbers("position of the body, or of the camera, m", "x_m", "y_m", "z_m"),
        *_numbers("its orientation", "qx", "qy", "qz", "qw"),
        *_numbers("its heading, rad", "yaw_rad"),
        *_numbers("covariance of (x, y, yaw)", *POSE),
        *_numbers("position error against the truth, m", "error_m"),
        Column("state", "VARCHAR", "of odometry without poses and of robots' logs: tracked, lost, ..."),
        *_numbers("probability that the pose is wrong, of odometry without poses", "failure_probability"),
        *_numbers("measured motion since the previous frame, body frame, m and rad", "ahead_m", "left_m", "turn_rad"),
        *_numbers("footsteps since the previous frame", "steps"),
        *_numbers("processing time, ms", "total_ms"),
    ),
    "tracks": (
        STAMP,
        Column("track", "BIGINT", "number of the track"),
        *_numbers("position, world frame, m", "x_m", "y_m"),
        *_numbers("velocity, world frame, m/s", "vx_mps", "vy_mps"),
        *_numbers("covariance of (x, y, vx, vy)", *STATE),
        *_numbers("radius and height of the covering cylinder, m", "radius_m", "height_m"),
        *_numbers("probability that the obstacle moves", "moving"),
        *_numbers("stamp of its last detection, s", "seen_s"),
        Column("modes", "MAP(VARCHAR, DOUBLE)", "probability of each mode of motion"),
    ),
    "floors": (
        STAMP,
        Column("camera", "VARCHAR", "tof, depth or stereo"),
        *_numbers("unit normal of the floor, camera frame", "nx", "ny", "nz"),
        *_numbers("distance of the camera from the floor, m", "height_m"),
        *_numbers("covariance of (tilt, tilt, height), rad and m", *PLANE),
        *_numbers("share of the points on the floor", "share"),
        Column("state", "VARCHAR", "seen or expected"),
    ),
    "steps": (
        STAMP,
        *_numbers("footstep asked for, body frame, m and rad", "forward_m", "lateral_m", "turn_rad"),
    ),
    "decisions": (
        STAMP,
        Column("why", "VARCHAR", "reason of the decision"),
        *_numbers("probability of contact with what may move, in the next 2.6 s", "risk"),
        *_numbers("head angles, rad", "pan_rad", "tilt_rad"),
    ),
    "metrics": METRICS,
    "config": (
        Column("setting", "VARCHAR", "dotted name of the setting"),
        Column("value", "VARCHAR", "its value as JSON"),
    ),
}  # fmt: skip


def selection(table: str) -> str:
    """The columns of a table with their types, for a SELECT over plain values; lists and maps are JSON there."""
    return ", ".join(
        f'CAST("{one.name}"{"::JSON" if one.kind[-1] in "])" else ""} AS {one.kind}) AS "{one.name}"'
        for one in TABLES[table]
    )


def empty(table: str) -> str:
    """A SELECT of no rows with the columns of a table, `run` first."""
    return f"SELECT CAST(NULL AS VARCHAR) AS {RUN}, " + ", ".join(
        f'CAST(NULL AS {one.kind}) AS "{one.name}"' for one in TABLES[table]
    ) + " LIMIT 0"  # fmt: skip


def describe() -> str:
    """All tables and their columns, one line a table, for messages."""
    return "\n".join(
        f"  {name}: {RUN}, {', '.join(one.name for one in columns)}"
        for name, columns in TABLES.items()
    )
