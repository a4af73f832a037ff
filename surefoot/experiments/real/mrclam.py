"""Self-localisation on real recordings: two robots among landmarks, a mower among beacons, an IMU at rest.

Parameters are found without truth, by the likelihood of a robot's own innovations, and judged on the other
robot: what is reported of robot 1 was fitted on robot 3, and the other way round. A robot is told where it
starts, and nothing else of the truth. The position's errors are taken ten times a second from the start of
odometry to the end of the truth, also in the gaps of up to 55 s in which nothing is seen.

A likelihood of innovations sees one step at a time, and all landmarks of one direction share errors that no landmark
reveals; it makes a filter too sure, and another robot has another camera. So all deviations of a sighting get a
margin: the one that makes the *other* robot, the one of the fit, consistent with its own truth. It changes the
error by a few per cent and the consistency by a factor of two; `anees_as_fitted` is the figure without it.

Consistency (ANEES) is judged on the position: the motion capture's heading of robot 1 jumps by two degrees and
more while its wheels stand, which no covariance of ours should explain; `pose_anees` has the heading too.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from perception.planar.association import filter_unknown
from perception.planar.config import PlanarConfig
from perception.planar.planar import FilteredJourney, filter_journey
from perception.planar.planar_fit import fit
from perception.primitives.gaussian import Gaussian

from ...recordings import mrclam
from ...recordings.plaza import read_plaza
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target
from .inertial import tilt
from .journeys import Course, Verdict, judge, rms
from .range_only import follow_ranges
from .robot_tracks import RobotTracks
from .smoothed import smooth_journey

ROBOTS = (1, 3)
LARGEST_MARGIN = 4.0
WITH_MARGIN = ("place", "depth_near", "depth_far", "bearing_sigma")


@dataclass(frozen=True)
class Fitted:
    """Parameters from one robot, for the other.

    Args:
        config: As the likelihood has them.
        delay_s: By which the robot follows its odometry.
        margin: Factor on the deviations of sightings.
    """

    config: PlanarConfig
    delay_s: float
    margin: float = 1.0

    @property
    def cautious(self) -> PlanarConfig:
        """The parameters with the margin."""
        wider = {name: self.margin * getattr(self.config, name) for name in WITH_MARGIN}
        return dataclasses.replace(self.config, **wider)

    @classmethod
    def to(cls, course: Course) -> Fitted:
        """By the likelihood of a robot's innovations; the margin by its truth."""
        found = cls(*fit(partial(course.journey, course.instants(judged=False))))
        instants = course.instants()
        journey = course.journey(instants, found.delay_s)
        low, high = 1.0, LARGEST_MARGIN
        for _ in range(6):
            tried = dataclasses.replace(found, margin=(low * high) ** 0.5)
            poses = filter_journey(journey, tried.cautious)
            consistent = judge(course, instants, poses.means, poses.covariances).anees <= 1.0
            low, high = (low, tried.margin) if consistent else (tried.margin, high)
        return dataclasses.replace(found, margin=high)


def run(seeds: int, say: Say) -> Outcome:
    """Both robots, their companions, the mower and the IMU; nothing here is random."""
    folder = real_data.folder("mrclam6")
    courses = {robot: Course.read(folder, robot) for robot in ROBOTS}
    fitted = {}
    for robot, course in courses.items():
        say(f"parameters that make the innovations of robot {robot} likeliest")
        fitted[robot] = Fitted.to(course)
    figures: dict[str, float] = {}
    table = [
        "robot  rmse m  heading deg  ANEES  pose ANEES  unknown m  dead reckoning m  rejected",
    ]
    track_errors: list[np.ndarray] = []
    for robot, other in (ROBOTS, ROBOTS[::-1]):
        say(f"robot {robot} with the parameters of robot {other}")
        course, use = courses[robot], fitted[other]
        instants = course.instants()
        journey = course.journey(instants, use.delay_s)
        fitted_only = filter_journey(journey, use.config)
        as_fitted = judge(course, instants, fitted_only.means, fitted_only.covariances)
        known = filter_journey(journey, use.cautious)
        verdict = judge(course, instants, known.means, known.covariances)
        unknown = judge(course, instants, *filter_unknown(journey, use.cautious))
        figures.update(_figures(f"r{robot}", verdict, unknown, course.dead_reckoning()))
        say(f"robot {robot} smoothed")
        figures.update(smoothed(f"r{robot}", course, use, verdict))
        errors, rejected = companions(folder, course, instants, known, use.cautious)
        track_errors.append(errors)
        figures[f"r{robot}_anees_as_fitted"] = as_fitted.anees
        figures[f"r{robot}_outliers"] = float(np.sum(known.status != 1))
        figures[f"r{robot}_phantoms"] = float(rejected)
        table.append(
            f"{robot:5d}  {verdict.rmse_m:6.3f}  {verdict.heading_deg:11.2f}  {verdict.anees:5.2f}  "
            f"{verdict.pose_anees:10.2f}  {unknown.rmse_m:9.3f}  "
            f"{figures[f'r{robot}_dead_reckoning_m']:16.2f}  {int(np.sum(known.status != 1)):8d}"
        )
    figures["robot_track_rmse_m"] = rms(np.concatenate(track_errors))
    say("the mower among its beacons")
    mower = follow_ranges(read_plaza(real_data.folder("plaza1_range") / "Plaza1_.mat"))
    figures["plaza1_rmse_m"] = mower.rmse_m
    figures["plaza1_dead_reckoning_m"] = mower.dead_reckoning_m
    figures["plaza1_scale"] = mower.scale
    say("the IMU at rest and in flight")
    up = tilt(real_data.folder("euroc_v101_stereo"))
    figures["euroc_tilt_deg"] = up.rest_deg
    figures["euroc_flight_tilt_deg"] = up.flight_deg
    table += [
        f"mower  {mower.rmse_m:.2f} m, ranges {100 * (mower.scale - 1):.1f} % long, "
        f"{100 * mower.rejected_share:.1f} % of them rejected",
        f"IMU    gyro bias {np.round(up.gyro_bias, 4)} rad/s, "
        f"accelerometer bias {np.round(up.force_bias, 3)} m/s^2",
        *(f"fitted on robot {robot}: {use}" for robot, use in fitted.items()),
    ]
    return Outcome(figures, table)


def smoothed(name: str, course: Course, use: Fitted, known: Verdict) -> dict[str, float]:
    """Error of the smoothed journey, and against the filter's."""
    instants = course.seconds()
    journey = course.journey(instants, use.delay_s)
    means, _ = smooth_journey(journey, filter_journey(journey, use.cautious), use.cautious)
    error = course.rmse_between(instants, means)
    return {f"{name}_smoother_m": error, f"{name}_smoother_over_filter": error / known.rmse_m}


def companions(
    folder: Path,
    course: Course,
    instants: np.ndarray,
    own: FilteredJourney,
    config: PlanarConfig,
) -> tuple[np.ndarray, int]:
    """Errors (n, 2) of the other robots' tracks, whenever one is seen and sure, and sightings rejected."""
    tracks, errors = RobotTracks(config), []
    truth = {subject: mrclam.read_truth(folder, subject) for subject in mrclam.ROBOTS}
    log = course.log
    for stamp, subject, seen in zip(log.stamps_s, log.subjects, log.seen, strict=True):
        if subject not in mrclam.ROBOTS or not course.start_s <= stamp <= course.end_s:
            continue
        now = int(np.searchsorted(instants, stamp))
        robot = Gaussian(own.means[now], own.covariances[now])
        found = tracks.update(int(subject), float(stamp), seen, robot)
        true = truth[int(subject)]
        if found is not None and stamp <= true[-1, 0]:
            there = [np.interp(stamp, true[:, 0], true[:, column]) for column in (1, 2)]
            errors.append(found.mean[:2] - there)
    return np.array(errors), tracks.rejected


def _figures(
    name: str, known: Verdict, unknown: Verdict, dead_reckoning_m: float
) -> dict[str, float]:
    return {
        f"{name}_rmse_m": known.rmse_m,
        f"{name}_dead_reckoning_m": dead_reckoning_m,
        f"{name}_heading_deg": known.heading_deg,
        f"{name}_unknown_ratio": unknown.rmse_m / known.rmse_m,
        f"{name}_anees": known.anees,
        f"{name}_anees_inverse": 1.0 / known.anees,
        f"{name}_pose_anees": known.pose_anees,
    }


EXPERIMENT = Experiment(
    id="mrclam",
    title="Self-localisation of real robots: landmarks known and unknown, other robots, beacons, IMU",
    run=run,
    targets={
        "r1_rmse_m": Target("<=", 0.14),
        "r3_rmse_m": Target("<=", 0.11),
        "r1_heading_deg": Target("<=", 2.0),
        "r3_heading_deg": Target("<=", 2.0),
        "r1_unknown_ratio": Target("<=", 2.0),
        "r3_unknown_ratio": Target("<=", 1.2),
        "r1_smoother_over_filter": Target("<", 1.0),
        "r3_smoother_over_filter": Target("<", 1.0),
        "r1_anees": Target("<=", 1.8),
        "r3_anees": Target("<=", 1.8),
        "r1_anees_inverse": Target("<=", 1.0 / 0.6),
        "r3_anees_inverse": Target("<=", 1.0 / 0.6),
        "robot_track_rmse_m": Target("<=", 0.16),
        "plaza1_rmse_m": Target("<=", 0.35),
        "euroc_tilt_deg": Target("<=", 1.0),
    },
    seeds=1,
)
