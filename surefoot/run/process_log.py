"""Process the log of a wheeled robot: where it was at every instant, with covariance, or that it was lost."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np

from perception.planar._planar_kernels import DRIFT, ODOMETRY_SCALE, TURN_SCALE, deviations
from perception.planar.config import PlanarConfig
from perception.planar.log_localiser import LocalisedLog, localise
from perception.primitives.gaussian import Gaussian

from ..config import toml
from ..config.schema import Config
from ..progress import Say
from ..recordings.identity import identity
from ..recordings.robot_log import RobotLog, open_robot_log
from ..results.moment import Moment
from ..results.moments import MomentWriter
from ..results.run_folder import COVARIANCE_HEADER, RunFolder, estimate_row
from ..results.version import commit, version
from .moment_recorder import EVERY_S
from .summary import Summary

MOST_MOMENTS = 3000  # ours: interval of poses in estimates.mcap; logs last many minutes
ELSEWHERE = 0.3  # ours: ignored share of a landmark's sightings for which it is named
STATES_HEADER = ("stamp_s", "state", "sigma_position_m", "sigma_yaw_rad", "rejected_share")


def process_log(path: Path, config: Config, out: Path | None, say: Say) -> Summary:
    """Localise a robot in its log and write a run folder.

    Instants at which the robot is lost have no row in the trajectory, and "lost" in states.csv.

    Args:
        path: As for `open_robot_log`.
        config: Is kept in the folder; noise and biases come from the log.
        out: Run folder; None takes the next free one below runs/.
        say: Progress.

    Raises:
        RecordingError: The log cannot be read.
        OutputError: The folder cannot be written.
    """
    from ..report.page import write_report
    from ..store.run_tables import write_run_tables

    read = open_robot_log(path)
    folder = RunFolder.create(out, name=read.name, reads=path)
    folder.write_text("config.toml", toml.dumps(config))
    found = localise(read.log, say=say)
    _write(folder, found)
    _write_moments(folder, found)
    truth = _truth(read, found.stamps_s)
    if len(truth):
        folder.write_trajectory(
            "truth/trajectory.txt",
            [(row[0], row[1], row[2], 0.0, row[3]) for row in truth.tolist()],
        )
    lost = int(np.sum(found.lost))
    summary = Summary(
        folder.root,
        len(found.stamps_s) - lost,
        float(found.stamps_s[-1] - found.stamps_s[0]),
        skipped={"the robot was lost": lost} if lost else {},
        notes=_notes(found, read),
        lost=lost == len(found.stamps_s),
    )
    places = zip(read.identities, read.log.places.tolist(), strict=True)
    entries = {
        "kind": read.kind,
        "name": read.name,
        "recording": str(path),
        "version": version(),
        "commit": commit(),
        "command": shlex.join(["surefoot", "process", str(path)]),
        "trajectory": "body",
        "recording_identity": identity(path),
        "landmarks": [[identity, x, y, 0.0, 0.0] for identity, (x, y) in places],
    }
    folder.write_json("summary.json", summary.as_dict() | entries)
    write_report(folder)
    write_run_tables(folder)
    return summary


def _write(folder: RunFolder, found: LocalisedLog) -> None:
    """Trajectory with covariance, and the state at every instant."""
    poses = [
        estimate_row(stamp, Gaussian(mean, covariance))
        for stamp, mean, covariance, lost in zip(
            found.stamps_s.tolist(), found.means, found.covariances, found.lost, strict=True
        )
        if not lost
    ]
    if poses:
        folder.write_csv("trajectory_covariance.csv", COVARIANCE_HEADER, poses)
        folder.write_planar_trajectory()
    variances = np.diagonal(found.covariances, axis1=1, axis2=2)
    states = zip(
        found.stamps_s.tolist(),
        ["lost" if lost else "tracked" for lost in found.lost],
        np.sqrt(variances[:, :2].sum(axis=1)).tolist(),
        np.sqrt(variances[:, 2]).tolist(),
        found.rejected.tolist(),
        strict=True,
    )
    folder.write_csv("states.csv", STATES_HEADER, list(states))


def _write_moments(folder: RunFolder, found: LocalisedLog) -> None:
    """Write estimates.mcap: the pose at regular instants, none while the robot was lost."""
    writer = MomentWriter(folder)
    seconds = float(found.stamps_s[-1] - found.stamps_s[0])
    every_s, last_s = max(EVERY_S, seconds / MOST_MOMENTS), -np.inf
    for k, stamp in enumerate(found.stamps_s.tolist()):
        if stamp - last_s >= every_s:
            pose = None if found.lost[k] else Gaussian(found.means[k], found.covariances[k])
            writer.write(Moment(stamp, pose))
            last_s = stamp
    writer.close(())


def _notes(found: LocalisedLog, read: RobotLog) -> tuple[str, ...]:
    """When the robot was lost, landmarks that are elsewhere, and the estimated errors of its odometry and sightings."""
    if found.fixes == 0:
        return ("LOST throughout: more than one pose stayed possible",)
    steps = np.append(np.diff(found.stamps_s), 0.0)
    again = found.fixes - 1
    notes = [
        f"lost for {float(steps[found.lost].sum()):.0f} s"
        + (f"; locked out and found again {again} times" if again else "")
    ]
    if found.lost[-1]:
        notes.append("LOST at the end")
    seen = np.bincount(read.log.marks, minlength=len(read.identities))
    elsewhere = [
        str(identity)
        for identity, ignored, all_of in zip(read.identities, found.ignored, seen, strict=True)
        if ignored > ELSEWHERE * all_of
    ]
    if elsewhere:
        notes.append(
            f"not where the log has them, and ignored: landmarks {', '.join(elsewhere)}; were they moved, or exchanged?"
        )
    if found.final is not None and found.config is not None:
        state, config = found.final, found.config
        notes.append(
            f"odometry: path x {state[ODOMETRY_SCALE]:.3f}, turn x {state[TURN_SCALE]:.3f}, drift "
            f"{np.degrees(state[DRIFT]):.3f} deg/s, {found.delay_s:.2f} s before the motion; {_noise(config, read.log.seen)}"
        )
    return tuple(notes)


def _noise(config: PlanarConfig, seen: np.ndarray) -> str:
    """Standard deviations of a sighting at the usual distance; most of the error may be common to many sightings."""
    far = float(np.nanmedian(np.abs(seen[:, 0])))
    depth, bearing = deviations(far, 0.0, config.parameters)
    noise = f"noise at {far:.1f} m: {depth * math.hypot(1.0, config.depth_shared):.3f} m"
    if np.isnan(seen[:, 1]).all():
        return noise
    return f"{noise}, {math.degrees(math.hypot(bearing, config.bearing_shared)):.2f} deg"


def _truth(read: RobotLog, stamps_s: np.ndarray) -> np.ndarray:
    """True (stamp, x, y, heading) at the instants that it covers, linearly interpolated."""
    if len(read.truth) == 0:
        return read.truth
    inside = stamps_s[(stamps_s >= read.truth[0, 0]) & (stamps_s <= read.truth[-1, 0])]
    columns = [np.interp(inside, read.truth[:, 0], read.truth[:, c]) for c in (1, 2, 3)]
    return np.stack([inside, *columns], axis=-1)
