"""Self-localisation on real recordings: two robots among landmarks, a mower among radio beacons, an IMU.

Parameters are fitted without truth, by the likelihood of a robot's innovations, and evaluated on the other robot: the
figures of robot 1 use parameters fitted on robot 3 and vice versa. The start pose is given; otherwise no truth is used.
Position errors are taken at 10 Hz from the start of odometry to the end of the truth, including gaps of up to 55 s
without sightings.

The likelihood of innovations considers single steps, while all landmarks in one direction share errors that cannot be
observed; a filter fitted that way is overconfident, and the other robot has another camera. All standard deviations of
a sighting are therefore multiplied by a margin: the smallest for which the robot of the fit is consistent with its own
truth. It changes the error by a few per cent and the consistency by a factor of two; `anees_as_fitted` is without it.

Consistency (ANEES) is evaluated on the position: the motion-capture heading of robot 1 jumps by more than two degrees
while its wheels stand still, which no covariance should explain; `pose_anees` includes the heading.

The same logs are then localised without start and without fitted parameters, as `surefoot process` does, and broken on
purpose (`perturbed_logs`).

Source: ours; data sets MRCLAM, Plaza and EuRoC.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from perception.planar.association import filter_unknown
from perception.planar.config import PlanarConfig
from perception.planar.log_localiser import localise
from perception.planar.planar import FilteredJourney, filter_journey
from perception.planar.planar_fit import fit
from perception.primitives.gaussian import Gaussian

from ...recordings import mrclam
from ...recordings.plaza import read_plaza
from ...recordings.robot_log import open_robot_log, robot_files
from ..support import real_data
from ..support.experiment import Experiment, Outcome, Say, Target
from .perturbed_logs import HEADER, perturbed, simulated, worst
from .planar_smoother import smooth_journey
from .range_only import follow_ranges
from .robot_run import RobotRun, RunErrors, rms_length, run_errors
from .robot_tracks import RobotTracks
from .tilt_filter import tilt

ROBOTS = (1, 3)
LARGEST_MARGIN = 4.0
WITH_MARGIN = ("place", "depth_near", "depth_far", "bearing_sigma")


@dataclass(frozen=True)
class Fitted:
    """Parameters fitted on one robot, to be used for the other.

    Args:
        config: Maximum-likelihood parameters.
        delay_s: Delay of the robot's motion after its odometry.
        margin: Factor on the standard deviations of sightings.
    """

    config: PlanarConfig
    delay_s: float
    margin: float = 1.0

    @property
    def with_margin(self) -> PlanarConfig:
        """Parameters with the margin applied."""
        wider = {name: self.margin * getattr(self.config, name) for name in WITH_MARGIN}
        return dataclasses.replace(self.config, **wider)

    @classmethod
    def to(cls, recorded: RobotRun) -> Fitted:
        """Fit the parameters to a robot's innovations, and the margin to its truth."""
        found = cls(*fit(partial(recorded.journey, recorded.instants(evaluated=False))))
        instants = recorded.instants()
        journey = recorded.journey(instants, found.delay_s)
        low, high = 1.0, LARGEST_MARGIN
        for _ in range(6):
            tried = dataclasses.replace(found, margin=(low * high) ** 0.5)
            poses = filter_journey(journey, tried.with_margin)
            consistent = run_errors(recorded, instants, poses.means, poses.covariances).anees <= 1.0
            low, high = (low, tried.margin) if consistent else (tried.margin, high)
        return dataclasses.replace(found, margin=high)


def run(seeds: int, say: Say, robot_logs: bool = True) -> Outcome:
    """Both robots, the tracks of other robots, the mower and the IMU; independent of the seeds.

    Args:
        seeds: Without effect.
        say: Takes lines of progress.
        robot_logs: Also the two robots, and perturbed and simulated logs, which take most of the time.
    """
    figures, table = _robots(say) if robot_logs else ({}, [])
    say("mower among radio beacons")
    mower = follow_ranges(read_plaza(real_data.folder("plaza1_range") / "Plaza1_.mat"))
    figures["plaza1_rmse_m"] = mower.rmse_m
    figures["plaza1_dead_reckoning_m"] = mower.dead_reckoning_m
    figures["plaza1_scale"] = mower.scale
    say("IMU at rest and in flight")
    up = tilt(real_data.folder("euroc_v101_stereo"))
    figures["euroc_tilt_deg"] = up.rest_deg
    figures["euroc_flight_tilt_deg"] = up.flight_deg
    table += [
        f"mower  {mower.rmse_m:.2f} m, ranges {100 * (mower.scale - 1):.1f} % long, "
        f"{100 * mower.rejected_share:.1f} % of them rejected",
        f"IMU    gyro bias {np.round(up.gyro_bias, 4)} rad/s, "
        f"accelerometer bias {np.round(up.force_bias, 3)} m/s^2",
    ]
    return Outcome(figures, table)


def _robots(say: Say) -> tuple[dict[str, float], list[str]]:
    """Figures and table lines of the two robots, and of logs that nobody tuned."""
    folder = real_data.folder("mrclam6")
    recordings = {robot: RobotRun.read(folder, robot) for robot in ROBOTS}
    fitted = {}
    for robot, recorded in recordings.items():
        say(f"fitting parameters to the innovations of robot {robot}")
        fitted[robot] = Fitted.to(recorded)
    figures: dict[str, float] = {}
    table = [
        "robot  rmse m  heading deg  ANEES  pose ANEES  unknown m  dead reckoning m  rejected",
    ]
    track_errors: list[np.ndarray] = []
    for robot, other in (ROBOTS, ROBOTS[::-1]):
        say(f"robot {robot} with the parameters of robot {other}")
        recorded, parameters = recordings[robot], fitted[other]
        instants = recorded.instants()
        journey = recorded.journey(instants, parameters.delay_s)
        fitted_only = filter_journey(journey, parameters.config)
        as_fitted = run_errors(recorded, instants, fitted_only.means, fitted_only.covariances)
        known = filter_journey(journey, parameters.with_margin)
        known_errors = run_errors(recorded, instants, known.means, known.covariances)
        unknown = run_errors(recorded, instants, *filter_unknown(journey, parameters.with_margin))
        figures.update(_figures(f"r{robot}", known_errors, unknown, recorded.dead_reckoning()))
        say(f"robot {robot}: smoother")
        figures.update(smoothed(f"r{robot}", recorded, parameters, known_errors))
        errors, rejected = other_robots(folder, recorded, instants, known, parameters.with_margin)
        track_errors.append(errors)
        figures[f"r{robot}_anees_as_fitted"] = as_fitted.anees
        figures[f"r{robot}_outliers"] = float(np.sum(known.status != 1))
        figures[f"r{robot}_phantoms"] = float(rejected)
        table.append(
            f"{robot:5d}  {known_errors.rmse_m:6.3f}  {known_errors.heading_deg:11.2f}  {known_errors.anees:5.2f}  "
            f"{known_errors.pose_anees:10.2f}  {unknown.rmse_m:9.3f}  "
            f"{figures[f'r{robot}_dead_reckoning_m']:16.2f}  {int(np.sum(known.status != 1)):8d}"
        )
    figures["robot_track_rmse_m"] = rms_length(np.concatenate(track_errors))
    table += [f"fitted on robot {robot}: {parameters}" for robot, parameters in fitted.items()]
    for found, lines in (untuned(folder, fitted[ROBOTS[0]].config, say), simulated(say)):
        figures.update(found)
        table += lines
    return figures, table


def untuned(folder: Path, of_robots: PlanarConfig, say: Say) -> tuple[dict[str, float], list[str]]:
    """Robots and mower localised as logs that nobody tuned, and with each perturbation; figures and table lines."""
    mower = open_robot_log(real_data.folder("plaza1_range"))
    of_mower = localise(mower.log).config or PlanarConfig()
    reads = [*(open_robot_log(robot) for robot in robot_files(folder)), mower]
    table, logs = [HEADER], {}
    for read in reads:
        other = of_robots if read is mower else of_mower
        logs[read.name], lines = perturbed(read, other, say)
        table += lines
    return worst(logs), table


def smoothed(
    name: str, recorded: RobotRun, parameters: Fitted, known: RunErrors
) -> dict[str, float]:
    """Error of the smoothed trajectory, and its ratio to the filter's error."""
    instants = recorded.seconds()
    journey = recorded.journey(instants, parameters.delay_s)
    means, _ = smooth_journey(
        journey, filter_journey(journey, parameters.with_margin), parameters.with_margin
    )
    error = recorded.rmse_between(instants, means)
    return {f"{name}_smoother_m": error, f"{name}_smoother_over_filter": error / known.rmse_m}


def other_robots(
    folder: Path,
    recorded: RobotRun,
    instants: np.ndarray,
    own: FilteredJourney,
    config: PlanarConfig,
) -> tuple[np.ndarray, int]:
    """Errors (n, 2) of the confirmed tracks of other robots at their sightings, and the rejected sightings."""
    tracks, errors = RobotTracks(config), []
    truth = {subject: mrclam.read_truth(folder, subject) for subject in mrclam.ROBOTS}
    log = recorded.log
    for stamp, subject, seen in zip(log.stamps_s, log.subjects, log.seen, strict=True):
        if subject not in mrclam.ROBOTS or not recorded.start_s <= stamp <= recorded.end_s:
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
    name: str, known: RunErrors, unknown: RunErrors, dead_reckoning_m: float
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
    title="Self-localisation of real robots: known and unknown landmarks, other robots, beacons, IMU",
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
        "perturbed_ratio_max": Target("<=", 2.0),
        "beyond_5sigma_longest_s": Target("<=", 10.0),
        "perturbed_lost_share_max": Target("<=", 0.1),
        "simulated_ranges_beyond_5sigma_s": Target("<=", 10.0),
        "simulated_tags_beyond_5sigma_s": Target("<=", 10.0),
        "simulated_ranges_recovered_share": Target(">=", 1.0),
        "simulated_tags_recovered_share": Target(">=", 1.0),
    },
    seeds=1,
)
