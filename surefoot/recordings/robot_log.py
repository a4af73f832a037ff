"""Logs of wheeled robots without pictures: odometry with sightings of landmarks (MRCLAM) or ranges (Plaza).

Source: ours.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from perception.planar.planar_log import PlanarLog
from perception.primitives.errors import RecordingError

from . import mrclam
from .folder import pictures
from .plaza import read_plaza

_ODOMETRY = re.compile(r"Robot(\d+)_Odometry\.dat(\.gz)?")


@dataclass(frozen=True)
class RobotLog:
    """A log as `perception.planar` takes it.

    Args:
        name: For the run folder.
        kind: "mrclam" or "plaza".
        log: Odometry and sightings.
        identities: Of the landmarks, in the order of `log.places`.
        truth: (k, 4) stamp, s, x, y, m, heading, rad, unwrapped; empty if the log has none.
    """

    name: str
    kind: str
    log: PlanarLog
    identities: tuple[int, ...]
    truth: Float[np.ndarray, "k 4"]


def robot_files(path: Path) -> list[Path]:
    """The logs at a path: the file itself, or the odometry of each robot of an MRCLAM folder; no content is read."""
    if path.is_file():
        return [path] if path.suffix == ".mat" or _ODOMETRY.fullmatch(path.name) else []
    if not path.is_dir():
        return []
    found = [one for one in sorted(path.iterdir()) if _ODOMETRY.fullmatch(one.name)]
    alone = not any(one.is_dir() for one in path.iterdir()) and not pictures(path)
    return found or (sorted(path.glob("*.mat")) if alone else [])


def open_robot_log(path: Path) -> RobotLog:
    """Read the log of one robot: a Plaza file, the odometry file of an MRCLAM robot, or a folder with one of them.

    Raises:
        RecordingError: A file is missing or damaged, or a folder holds several robots.
    """
    files = robot_files(path)
    if len(files) != 1:
        listed = ", ".join(str(one) for one in files) or "nothing"
        raise RecordingError(f"{path}: one log was expected, found {listed}; give one of these")
    match = _ODOMETRY.fullmatch(files[0].name)
    return _mrclam(files[0].parent, int(match[1])) if match else _plaza(files[0])


def _mrclam(folder: Path, robot: int) -> RobotLog:
    read, places = mrclam.read_robot(folder, robot), mrclam.read_landmarks(folder)
    identities = tuple(places)
    known = np.isin(read.subjects, identities)
    index = {subject: i for i, subject in enumerate(identities)}
    stamps, rates = read.odometry[:, 0], read.odometry[:, 1:]
    moved = np.diff(stamps)[:, None] * rates[:-1]
    truth = np.empty((0, 4))
    if list(folder.glob(f"Robot{robot}_Groundtruth.dat*")):
        truth = mrclam.read_truth(folder, robot)
    log = PlanarLog(
        stamps.copy(),
        np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)]),
        read.stamps_s[known],
        np.array([index[int(subject)] for subject in read.subjects[known]], np.int64),
        read.seen[known],
        np.array(list(places.values())),
    )
    return RobotLog(f"{folder.name}-robot{robot}", "mrclam", log, identities, truth)


def _plaza(path: Path) -> RobotLog:
    read = read_plaza(path)
    truth = read.truth.copy()
    if len(truth):
        truth[:, 3] = np.unwrap(truth[:, 3])
    log = PlanarLog(
        read.odometry[:, 0].copy(),
        np.cumsum(read.odometry[:, 1:], axis=0),
        read.stamps_s,
        read.beacons,
        np.stack([read.ranges_m, np.full(len(read.ranges_m), np.nan)], axis=-1),
        read.places,
    )
    return RobotLog(path.stem.strip("_"), "plaza", log, tuple(range(len(read.places))), truth)
