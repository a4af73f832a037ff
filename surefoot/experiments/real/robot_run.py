"""One robot's run of the MRCLAM data set as input of the planar filter, and its errors against motion capture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from perception.filtering.consistency import nees
from perception.filtering.models import wrap_angles
from perception.planar.planar import Journey
from perception.primitives.gaussian import Gaussian

from ...recordings import mrclam

START_SIGMA = (0.02, 0.02, 0.02)  # m, m, rad: of the given start pose
GRID_S = 0.1  # interval of the error evaluation


@dataclass(frozen=True)
class RobotRun:
    """A robot's recording with its truth.

    Args:
        log: Odometry and sightings.
        places: Landmark positions, m.
        subjects: Identities of the landmarks, in the same order.
        truth: Stamp, x, y, heading.
        start_s, end_s: Start of odometry, and end of truth or odometry.
    """

    log: mrclam.RobotLog
    places: Float[np.ndarray, "l 2"]
    subjects: tuple[int, ...]
    truth: Float[np.ndarray, "n 4"]
    start_s: float
    end_s: float

    @classmethod
    def read(cls, folder: Path, robot: int) -> RobotRun:
        """Read one robot of an MRCLAM folder."""
        log, truth = mrclam.read_robot(folder, robot), mrclam.read_truth(folder, robot)
        marks: Mapping[int, tuple[float, float]] = mrclam.read_landmarks(folder)
        start = max(float(log.odometry[0, 0]), float(truth[0, 0]))
        end = min(float(log.odometry[-1, 0]) - 1.0, float(truth[-1, 0]))
        return cls(log, np.array(list(marks.values())), tuple(marks), truth, start, end)

    def true_pose(self, stamps_s: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k 3"]:
        """x, y and heading by motion capture, linearly interpolated."""
        return np.stack(
            [np.interp(stamps_s, self.truth[:, 0], self.truth[:, c]) for c in (1, 2, 3)], axis=-1
        )

    def sightings(self) -> Bool[np.ndarray, "m"]:
        """Mask of the log's sightings of landmarks within the evaluated period."""
        known = np.isin(self.log.subjects, self.subjects)
        inside = (self.log.stamps_s >= self.start_s) & (self.log.stamps_s <= self.end_s)
        return np.asarray(known & inside)

    def instants(self, evaluated: bool = True) -> Float[np.ndarray, "n"]:
        """Stamps of all sightings of landmarks; if evaluated, also those of other robots and of a regular grid."""
        if not evaluated:
            return np.unique(self.log.stamps_s[self.sightings()])
        stamps = self.log.stamps_s
        inside = stamps[(stamps >= self.start_s) & (stamps <= self.end_s)]
        return np.unique(np.append(inside, np.arange(self.start_s, self.end_s, GRID_S)))

    def seconds(self) -> Float[np.ndarray, "n"]:
        """Stamps of all sightings of landmarks, and one per second."""
        every = np.arange(self.start_s, self.end_s, 1.0)
        return np.unique(np.append(self.instants(evaluated=False), every))

    def rmse_between(
        self, instants: Float[np.ndarray, "n"], means: Float[np.ndarray, "n 3"]
    ) -> float:
        """Root mean square position error on the evaluation grid, linearly interpolated between instants, m."""
        grid = np.arange(self.start_s, self.end_s, GRID_S)
        there = np.stack([np.interp(grid, instants, means[:, c]) for c in (0, 1)], axis=-1)
        return rms_length(there - self.true_pose(grid)[:, :2])

    def steps(self, instants: Float[np.ndarray, "n"], delay_s: float) -> Float[np.ndarray, "n 3"]:
        """Time, path length and turn before each instant, with odometry delayed by `delay_s`."""
        stamps, speed, rate = self.log.odometry.T
        held = np.diff(stamps)
        at = np.append(self.start_s, instants)
        totals = [
            np.interp(at - delay_s, stamps, np.append(0.0, np.cumsum(held * value[:-1])))
            for value in (speed, rate)
        ]
        return np.stack([np.diff(at), *(np.diff(total) for total in totals)], axis=-1)

    def journey(self, instants: Float[np.ndarray, "n"], delay_s: float) -> Journey:
        """Input of the filter; of the truth it contains the start pose only."""
        chosen = self.sightings()
        stamps = self.log.stamps_s[chosen]
        first = np.append(np.searchsorted(stamps, instants), len(stamps))
        index = {subject: i for i, subject in enumerate(self.subjects)}
        marks = np.array([index[int(s)] for s in self.log.subjects[chosen]], np.int64)
        start = Gaussian(
            self.true_pose(np.array([self.start_s]))[0], np.diag(np.square(START_SIGMA))
        )
        return Journey(
            start,
            self.steps(instants, delay_s),
            first.astype(np.int64),
            marks,
            np.ascontiguousarray(self.log.seen[chosen]),
            self.places,
        )

    def dead_reckoning(self) -> float:
        """Root mean square position error by uncorrected odometry alone, m."""
        instants = self.instants()
        _, path, turn = self.steps(instants, 0.0).T
        x, y, yaw = self.true_pose(np.array([self.start_s]))[0]
        heading = yaw + np.cumsum(turn) - turn / 2.0
        odometry_poses = np.stack(
            [x + np.cumsum(path * np.cos(heading)), y + np.cumsum(path * np.sin(heading))], axis=-1
        )
        return rms_length(odometry_poses - self.true_pose(instants)[:, :2])


@dataclass(frozen=True)
class RunErrors:
    """Errors against motion capture on a regular time grid.

    Args:
        rmse_m: Root mean square position error.
        heading_deg: Median absolute heading error within 1 s after a sighting.
        anees: ANEES of the position per degree of freedom.
        pose_anees: ANEES of position and heading per degree of freedom.
    """

    rmse_m: float
    heading_deg: float
    anees: float
    pose_anees: float


def run_errors(
    run: RobotRun,
    instants: Float[np.ndarray, "n"],
    means: Float[np.ndarray, "n 3"],
    covariances: Float[np.ndarray, "n 3 3"],
) -> RunErrors:
    """Compare the poses at the instants of the time grid with the truth."""
    grid = np.arange(run.start_s, run.end_s, GRID_S)
    on_grid = np.isin(instants, grid)
    stamps, means, covariances = instants[on_grid], means[on_grid], covariances[on_grid]
    errors = means - run.true_pose(stamps)
    errors[:, 2] = wrap_angles(errors[:, 2])
    sighted = run.log.stamps_s[run.sightings()]
    before = np.searchsorted(sighted, stamps, side="right") - 1
    near = (before >= 0) & (stamps - sighted[np.maximum(before, 0)] <= 1.0)
    return RunErrors(
        rms_length(errors[:, :2]),
        float(np.degrees(np.median(np.abs(errors[near, 2])))),
        float(np.mean(nees(errors[:, :2], covariances[:, :2, :2]))) / 2.0,
        float(np.mean(nees(errors, covariances))) / 3.0,
    )


def rms_length(errors: Float[np.ndarray, "n d"]) -> float:
    """Root mean square length of the error vectors."""
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=-1))))
