"""Smooth the trajectory of a run: each pose by all measurements of the run, not only by the earlier ones.

The input is the step odometry, the gyroscope and the landmark measurements of the run, from its tables
`odometry.csv` and `sightings.csv`. A run without these tables is smoothed from its recording, in whose pictures
the landmarks are detected again. The ground truth is not read.

The output is `smoothed.txt` and `smoothed_covariance.csv`, in the format of the filter's own files.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np

from perception.localisation import landmarks
from perception.localisation.legged_poses import STEP_S
from perception.primitives.errors import InputError, RecordingError
from perception.primitives.frame import Imu, StepOdometry
from perception.primitives.gaussian import Gaussian
from perception.primitives.landmark import Sighting
from perception.primitives.pose import Pose2
from perception.smoothing.fixed_lag import smooth_fixed_lag
from perception.smoothing.smoother import SmootherConfig, smooth
from perception.smoothing.walk_factors import Instant, walk_factors, walk_systematics

from ..config import toml
from ..config.schema import Config
from ..recordings.open import open_recording
from ..results.measurement_log import ODOMETRY, ODOMETRY_HEADER, SIGHTINGS, SIGHTINGS_HEADER
from ..results.run_folder import COVARIANCE_HEADER, RECORDING, RunFolder
from ..words import count_of

log = logging.getLogger(__name__)

SMOOTHED, SMOOTHED_COVARIANCE = "smoothed.txt", "smoothed_covariance.csv"


@dataclass(frozen=True)
class WalkData:
    """The measurements of a walk.

    Args:
        instants: Odometry, gyroscope and landmarks of each frame, in order of time.
        start: Pose (x, y, yaw) before the first frame, world frame, m and rad.
        landmarks: Known position of each landmark by identity, world frame, m.
    """

    instants: list[Instant]
    start: Gaussian
    landmarks: dict[int, tuple[float, float]]


def smooth_run(folder: RunFolder, lag_s: float | None = None) -> list[tuple[float, Gaussian]]:
    """Smooth a run and write the result into its folder.

    Args:
        folder: Folder of a complete run.
        lag_s: Each pose uses measurements up to this much later, s; None: all of the run.

    Returns:
        Stamp in s and Gaussian over (x, y, yaw), in m and rad, of every frame.

    Raises:
        InputError: The run has neither the tables nor a recording, or its start is unknown.
        RecordingError: A file of the run is damaged.
    """
    config = (
        toml.read(Config, folder.path("config.toml")) if folder.has("config.toml") else Config()
    )
    walked = read_walk(folder, config)
    poses = smooth_walk(walked, config, lag_s)
    stamped = [(one.stamp_s, pose) for one, pose in zip(walked.instants, poses, strict=True)]
    rows = [
        (stamp, *pose.mean.tolist(), *pose.covariance[np.triu_indices(3)].tolist())
        for stamp, pose in stamped
    ]
    folder.write_csv(SMOOTHED_COVARIANCE, COVARIANCE_HEADER, rows)
    folder.write_trajectory(SMOOTHED, [(r[0], r[1], r[2], 0.0, r[3]) for r in rows])
    return stamped


def smooth_walk(walked: WalkData, config: Config, lag_s: float | None = None) -> list[Gaussian]:
    """The smoothed poses of a walk, one per frame, with the noise parameters of its localiser."""
    raw = walked.instants
    longest = config.prior.longest_step_m
    instants = [
        _plausible(instant, instant.stamp_s - before.stamp_s, longest)
        for before, instant in zip([*raw[:1], *raw], raw, strict=False)
    ]
    frames = walk_factors(instants, walked.landmarks, config.localiser)
    systematics = walk_systematics(config.localiser)
    if len(frames) < 2:
        raise InputError(
            f"smoothing: the walk has {count_of(len(frames), 'frame')}; expected at least 2"
        )
    if lag_s is None:
        factors = [factor for _, of_frame in frames for factor in of_frame]
        return smooth(factors, walked.start, systematics)
    return smooth_fixed_lag(frames, walked.start, systematics, SmootherConfig(lag_s=lag_s))


def read_walk(folder: RunFolder, config: Config) -> WalkData:
    """The measurements of a run: from its tables, else from its recording.

    Raises:
        InputError: The run has neither, or its start is unknown.
    """
    if folder.has(ODOMETRY) and folder.has(SIGHTINGS):
        return _from_tables(folder, config)
    if folder.has(RECORDING):
        return _from_recording(folder, config)
    raise InputError(
        f"run folder {folder.root} has neither {ODOMETRY} and {SIGHTINGS} nor {RECORDING}; "
        "make the run again with --record"
    )


def _from_tables(folder: RunFolder, config: Config) -> WalkData:
    summary = folder.read_json("summary.json") or {}
    if summary.get("start") is None:
        raise InputError(
            f"run folder {folder.root}: the start pose of the walk is unknown (`start` in summary.json); "
            "only walks from a known start can be smoothed"
        )
    odometry, sightings = folder.read_csv(ODOMETRY), folder.read_csv(SIGHTINGS)
    if odometry is None:
        raise RecordingError(f"{folder.path(ODOMETRY)} has no rows; make the run again")
    seen: dict[float, list[Sighting]] = {}
    if sightings is not None:
        for stamp, identity, r, bearing, rr, rb, bb in sightings.matrix(*SIGHTINGS_HEADER):
            which = None if math.isnan(identity) else int(identity)
            P = np.array([[rr, rb], [rb, bb]])
            seen.setdefault(stamp, []).append(Sighting(which, np.array([r, bearing]), P))
    instants = []
    for stamp, *motion, steps, gx, gy, gz in odometry.matrix(*ODOMETRY_HEADER):
        step = StepOdometry(Pose2(*(float(v) for v in motion)), float(steps))
        gyro = np.array([gx, gy, gz])
        instants.append(
            Instant(
                float(stamp),
                None if math.isnan(steps) else step,
                None if np.isnan(gyro).any() else Imu(gyro, np.zeros(3)),
                tuple(seen.get(stamp, ())),
            )
        )
    covariance = summary.get("start_covariance")
    start = np.array(summary["start"], dtype=float)
    return WalkData(
        instants,
        Gaussian(
            start, _start_covariance(None if covariance is None else np.array(covariance), config)
        ),
        {int(mark[0]): (float(mark[1]), float(mark[2])) for mark in summary.get("landmarks", [])},
    )


def _from_recording(folder: RunFolder, config: Config) -> WalkData:
    """The measurements, with landmarks detected in the recorded pictures."""
    recording = open_recording(folder.path(RECORDING))
    info = recording.info
    if info.start is None:
        raise InputError(
            f"{folder.path(RECORDING)}: the start pose of the walk is unknown; "
            "only walks from a known start can be smoothed"
        )
    instants = []
    for frame in recording.frames():
        sightings = (
            landmarks.detect(frame.colour, info.landmarks, config.landmarks).sightings
            if frame.colour is not None and info.landmarks
            else []
        )
        instants.append(Instant(frame.stamp_s, frame.odometry, frame.imu, tuple(sightings)))
    return WalkData(
        instants,
        Gaussian(info.start.vector, _start_covariance(info.start_covariance, config)),
        {mark.identity: (mark.position[0], mark.position[1]) for mark in info.landmarks},
    )


def _start_covariance(given: np.ndarray | None, config: Config) -> np.ndarray:
    """The covariance of the start pose that the run's localiser used."""
    if given is not None:
        return given
    metres, radians = config.prior.start_m, math.radians(config.prior.start_deg)
    return np.diag(np.square([metres, metres, radians]))


def _plausible(instant: Instant, elapsed_s: float, longest_step_m: float) -> Instant:
    """The instant without its step odometry if the motion is longer than legs can make."""
    if instant.odometry is None:
        return instant
    motion = instant.odometry.motion
    steps = max(1.0, abs(instant.odometry.steps), elapsed_s / STEP_S)
    if math.hypot(motion.x, motion.y) <= longest_step_m * steps:
        return instant
    log.warning("implausible odometry %s at %.2f s ignored", motion, instant.stamp_s)
    return replace(instant, odometry=None)
